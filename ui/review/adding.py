"""A new point by hand: chosen in the ortho, predicted and measured in every scan that shows it."""

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from core.block.block import Measurement, Peak
from core.block.registration.likeness import OPERATOR, Likeness
from core.doubts import Failure
from core.progress import Progress
from sessions.decisions import AddPoint, Recorded
from sessions.replay import HAND_SIGMA_PX
from ui.review.compare import HeightSource, LikenessSource, PlanePoints
from ui.review.state import DeskState

NAME = re.compile(r"H(\d+)")
EDGE_MM = 2.0
"""So near the border of the frame nothing is measured."""


def next_name(state: DeskState, recorded: Sequence[Recorded]) -> str:
    """H1, H2 and so on: never a name that was given before, withdrawn points included."""
    names = [item.decision.point_id for item in recorded if isinstance(item.decision, AddPoint)]
    found = [NAME.fullmatch(name) for name in (*names, *state.block.surveyed)]
    return f"H{1 + max((int(match[1]) for match in found if match), default=0)}"


def seen_in(state: DeskState, plane: PlanePoints, dem: HeightSource) -> dict[str, np.ndarray]:
    """Oriented photos whose frame shows a place (1, 2), with the pixel where they should."""
    position = np.column_stack([plane, dem.heights(plane)])
    oriented, found = state.oriented, dict[str, np.ndarray]()
    if not np.isfinite(position).all():
        return found
    for name, photo in oriented.photos.items():
        camera = oriented.camera_of(name)
        pixel = photo.pixel_from_object(position, camera)
        if not photo.oriented or not np.isfinite(pixel).all():
            continue
        inside = np.abs(photo.interior.film_from_pixel(pixel)[0]) < (
            np.array(camera.frame_mm) / 2 - EDGE_MM
        )
        on_scan = np.all((pixel[0] > 0) & (pixel[0] < np.array(photo.size_px)))
        if inside.all() and on_scan:
            found[name] = pixel
    return found


def measured_point(
    state: DeskState,
    name: str,
    place: tuple[float, float],
    sources: tuple[HeightSource, LikenessSource | None],
    sigma_m: tuple[float, float, float],
    progress: Progress,
) -> AddPoint:
    """The point with a measurement in every scan that shows it.

    Where reference and scan are not alike near the predicted place, the measurement is dubious and
    lies there, to be placed by hand; one no more alike than chance has it is dubious as well.

    Args:
        state: The block with its newest adjustment.
        name: Name of the new point.
        place: Easting and northing, metres.
        sources: Heights; and what compares reference and scan.
        sigma_m: Accuracy of reference ortho and DEM, metres.
        progress: Told of every scan.
    """
    dem, likeness = sources
    plane = np.array([place])
    height = float(dem.heights(plane)[0])
    oriented, shown = state.oriented, seen_in(state, plane, dem)
    measured: list[Measurement] = []
    for number, (photo_id, pixel) in enumerate(shown.items()):
        progress.report(number, len(shown), photo_id)
        photo, camera = oriented.photos[photo_id], oriented.camera_of(photo_id)
        found: Likeness | Failure = Failure("there is nothing to compare with")
        if likeness is not None:
            found = likeness(photo, camera, np.array([[*place, height]]))
        measured.append(_measured(name, photo_id, pixel, found))
    return AddPoint(name, *place, height, sigma_m, tuple(measured))


def renamed(found: AddPoint, name: str) -> AddPoint:
    """The same point under another name."""
    measured = tuple(replace(item, point_id=name) for item in found.measured)
    return replace(found, point_id=name, measured=measured)


def _measured(
    name: str, photo_id: str, pixel: np.ndarray, likeness: Likeness | Failure
) -> Measurement:
    """On the peak of likeness beside the predicted place; there, and dubious, without one.

    A peak no higher than chance brings in such a window is dubious too: not used until the operator
    accepts it.
    """
    refined = likeness if isinstance(likeness, Failure) else likeness.refined(pixel)
    if isinstance(likeness, Failure) or isinstance(refined, Failure):
        column, row = (float(value) for value in pixel[0])
        return Measurement(
            name, photo_id, column, row, HAND_SIGMA_PX, 0.0, "dubious",
            "predicted only: not found by likeness",
        )  # fmt: skip
    column, row = (float(value) for value in refined[0])
    height, least = likeness.height_at(refined), likeness.chance_height
    score = float(np.clip(likeness.value_at(refined), 0.0, 1.0))
    sigma = HAND_SIGMA_PX * max(1.0, likeness.reduction / 2)
    found = Measurement(
        name, photo_id, column, row, sigma, score,
        peaks=(Peak(column, row, sigma, height, OPERATOR),),
    )  # fmt: skip
    if height >= least:
        return found
    return replace(
        found,
        status="dubious",
        reason=f"its peak is {height:.1f} sigma high; chance alone brings up to {least:.1f} here",
    )
