"""A block without a reference ortho, positioned by ties, priors, and points measured by hand.

Each connected part becomes one body (`core.localisation.free_block`) and is then adjusted with the
exterior orientations its sources give as weighted observations. Until surveyed points are
measured, it is no more accurate than those. It keeps the position of its sources until three
measured points span a triangle; from then on the points hold it, and the sources are ignored. A
photo that neither reference nor ties hold is resected once four surveyed points are measured in it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from core.adjustment.adjusted import AdjustmentOptions, AdjustmentReport
from core.adjustment.block_adjustment import adjust_block
from core.adjustment.positioning import MEASURED_M, MEASURED_RAD
from core.arrays import ObjectPoints, PixelPoints
from core.block import UNKNOWN_M, Block, Measurement, Photo, TiePoints
from core.doubts import Doubt, Failure
from core.geometry.exterior import ExteriorOrientation
from core.geometry.transforms import apply_affine, fit_similarity, rotation_and_scale
from core.localisation.free_block import FreeBlock, connected_photos, free_blocks
from core.localisation.initial_orientation import vertical_over
from core.localisation.priors import free_from_archive
from core.said import say

# source: three points give six equations for six unknowns; the fourth checks them.
LEAST_RESECTED = 4
"""A photo is resected from so many measured points."""
# source: definition of a similarity in space, seven unknowns.
LEAST_DATUM = 3
"""A block lies on so many points."""
# design: narrower, and the block could turn about the line they lie on.
LEAST_SPREAD = 0.1
"""Points span a triangle when they reach so far to either side of their line, as a share of it."""
# design: film, lens and clicks together stay within a few.
MOST_SIGMA_NOUGHT = 20.0
"""A resection with larger residuals, in standard deviations, rests on a wrong point."""
HELD = AdjustmentOptions(estimate_cameras=False, robust=False)
"""A photo by itself tells nothing of its camera."""


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """Surveyed control in some photos: where it is and where it was measured."""

    measurements: tuple[Measurement, ...]
    """One a point and photo."""
    points: ObjectPoints
    """Known places, one a measurement, metres."""

    @staticmethod
    def in_photos(block: Block, names: Sequence[str]) -> "Measured":
        """All that counts as control and is known in plan and height."""
        found = tuple(
            item
            for item in block.measurements.values()
            if item.used and item.photo_id in names and _is_full_control(block, item.point_id)
        )
        places = [block.surveyed[item.point_id].position for item in found]
        return Measured(found, np.array(places).reshape(-1, 3))

    @property
    def pixels(self) -> PixelPoints:
        """Where they were measured."""
        return np.array([(item.column, item.row) for item in self.measurements]).reshape(-1, 2)

    @property
    def count(self) -> int:
        """Number of points."""
        return len({item.point_id for item in self.measurements})

    @property
    def spans(self) -> bool:
        """Whether the points span a triangle in plan."""
        plan = self.points[:, :2] - self.points[:, :2].mean(axis=0)
        long, short = np.linalg.svd(plan, compute_uv=False)[:2]
        return bool(short > LEAST_SPREAD * long)


def stand_by_ties(
    block: Block,
    hypotheses: Mapping[str, Sequence[ExteriorOrientation]],
    options: AdjustmentOptions,
) -> tuple[Block, tuple[Doubt, ...]]:
    """The photos where their ties and their sources put them, and a doubt for each left out.

    A photo is oriented when ties hold it to others, or when its exterior orientation was measured
    in flight.

    Args:
        block: Photos with approximate orientations and priors, and rough ties.
        hypotheses: By photo, all orientations its source leaves open.
        options: The adjustment.
    """
    photos = {
        name: _begun(photo, part)
        for part in free_blocks(block, hypotheses, options)
        for name, photo in part.block.photos.items()
    }
    standing = block.with_photos(photos)
    # Steps that did not settle were better all the same.
    standing = standing.with_photos(adjusted_by_ties(standing, options).block.photos)
    doubts = [_left_out(name) for name, photo in standing.photos.items() if not photo.oriented]
    return standing, tuple(doubts)


def adjusted_by_ties(block: Block, options: AdjustmentOptions) -> AdjustmentReport:
    """The block adjusted by its ties and priors, the cameras held."""
    return adjust_block(block, replace(options, estimate_cameras=False))


def on_tied_ground(block: Block, options: AdjustmentOptions) -> Block:
    """The block with the mean height under each photo that its tie points tell.

    Photos without tie points lie over the mean of all.
    """
    heights = adjusted_by_ties(block, options).tie_positions[:, 2]
    if not np.isfinite(heights).any():
        return block
    own = heights[block.ties.point]
    photos: dict[str, Photo] = {}
    for name, photo in block.photos.items():
        seen = (
            []
            if name not in block.ties.photo_ids
            else own[block.ties.photo == block.ties.photo_ids.index(name)]
        )
        known = np.asarray(seen)[np.isfinite(seen)]
        level = np.median(known) if len(known) else np.nanmedian(heights)
        photos[name] = replace(photo, ground_height_m=float(level))
    return block.with_photos(photos)


def is_measured(photo: Photo) -> bool:
    """Whether both centre and angles of a photo are known as GNSS and IMU know them."""
    return bool(
        np.all(photo.prior.sigma_centre_m <= MEASURED_M)
        and np.all(photo.prior.sigma_angles <= MEASURED_RAD)
    )


def _begun(photo: Photo, part: FreeBlock) -> Photo:
    """A photo as the adjustment begins: as it was measured in flight, else as ties have it."""
    if is_measured(photo):
        return photo.with_exterior(photo.approximate, True)
    return replace(photo, oriented=part.tied)


def _left_out(name: str) -> Doubt:
    """The doubt of a photo that nothing holds."""
    message = say(
        "Photo {name} is not tied to any other, and its source says only roughly where it lies; it "
        "is left out until four surveyed points are measured in it.",
        name=name,
    )
    # design: as a photo that is left out on a reference.
    return Doubt("photo-orientation", name, message, 0.9)


def stand_on_points(block: Block, unwanted: frozenset[str] = frozenset()) -> Block:
    """The block with what its measured surveyed points orient.

    Args:
        block: With all measurements laid over it.
        unwanted: Photos that somebody has taken out.
    """
    if not any(point.source in ("surveyed", "hand") for point in block.surveyed.values()):
        return block
    photos = {
        name: photo if photo.oriented or name in unwanted else _resected(block, photo)
        for name, photo in block.photos.items()
    }
    block = block.with_photos(photos)
    if any(point.source in ("junction", "salient") for point in block.surveyed.values()):
        # What was proposed holds the block already.
        return block
    for names in connected_photos(block):
        block = _freed(block, [name for name in names if block.photos[name].oriented])
    return block


def _is_full_control(block: Block, point_id: str) -> bool:
    """Whether a point is control with all three coordinates."""
    point = block.surveyed[point_id]
    return point.role == "control" and bool(np.all(point.sigma_m < UNKNOWN_M))


def _resected(block: Block, photo: Photo) -> Photo:
    """A photo on the points measured in it; as it was where these are too few or contradict."""
    measured = Measured.in_photos(block, [photo.photo_id])
    if measured.count < LEAST_RESECTED or not measured.spans:
        return photo
    start = vertical_over(block, photo.photo_id, measured.pixels, measured.points)
    if isinstance(start, Failure):
        return photo
    ground = float(measured.points[:, 2].mean())
    start = replace(start, approximate=start.exterior, ground_height_m=ground, oriented=True)
    alone = replace(
        block,
        photos={photo.photo_id: start},
        measurements={item.key: item for item in measured.measurements},
        ties=TiePoints.none(),
    )
    report = adjust_block(alone, HELD)
    if not report.converged or not report.sigma_nought < MOST_SIGMA_NOUGHT:
        return photo
    return replace(start, exterior=report.block.photos[photo.photo_id].exterior)


def _freed(block: Block, names: Sequence[str]) -> Block:
    """The block with some photos, which ties join, laid on their points, without their sources."""
    measured = Measured.in_photos(block, names)
    if measured.count < LEAST_DATUM or not measured.spans:
        return block
    shown = np.concatenate(
        [
            block.photos[item.photo_id].object_from_pixel(
                item.pixel, point[2:], block.camera_of(item.photo_id)
            )
            for item, point in zip(measured.measurements, measured.points, strict=True)
        ]
    )[:, :2]
    fit = fit_similarity(shown, np.ascontiguousarray(measured.points[:, :2]))
    if isinstance(fit, Failure):
        return block
    turn, scale = rotation_and_scale(fit.matrix)
    ground = float(measured.points[:, 2].mean())
    laid: dict[str, Photo] = {}
    for name in names:
        photo = block.photos[name]
        known = photo.exterior
        plan = apply_affine(fit.matrix, known.centre[None, :2])[0]
        centre = np.array([*plan, ground + scale * (float(known.centre[2]) - ground)])
        exterior = ExteriorOrientation(centre, known.omega, known.phi, known.kappa + turn)
        laid[name] = photo.with_exterior(exterior, True)
    own = free_from_archive(replace(block, photos=laid), frozenset(), lambda _: float("nan"))
    freed = {
        name: own.photos[name] if own.photos[name] is not laid[name] else block.photos[name]
        for name in names
    }
    return block.with_photos({**block.photos, **freed})
