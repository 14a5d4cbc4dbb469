"""Places where one more control point would help most, before it is searched for."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from core.adjustment.equations import REACH
from core.adjustment.influence import Influence
from core.arrays import PixelPoints, Position
from core.block import Block, Measurement

# design: the worst places count most, and the measure stays smooth.
POWER = 4
"""What is made small is the mean of the variances to this power: the worst places count most."""
# design: each costs a solution of the block; the next ones are near these.
CANDIDATES = 40
"""Places that are weighed, the least certain first."""
# design: closer points hold nearly the same ground.
APART = 0.25
"""Places nearer to each other than this share of a photo's side are one."""
# design: what a hand measures to.
USUAL_PX = 1.0
"""Standard deviation of a measurement where the block has none to go by, pixels."""
# design: the reference's 0.25 m and as much for change, heights half as good again.
USUAL_M = (0.4, 0.4, 0.6)
"""Standard deviation of a known point where the block has none to go by, metres."""


@dataclass(frozen=True, slots=True, eq=False)
class Want:
    """A place where control would help."""

    photo_id: str
    """The photo that shows it farthest from what is known."""
    place: int
    """Which of the photo's nine places, upper left to lower right on the film."""
    position: Position
    """Where it lies on the ground, metres, the height that of the photo's mean ground."""
    photos: tuple[str, ...]
    """All photos that show it."""
    sigma_now_m: float
    """Standard deviation of position there now, metres, for a sigma nought of one."""
    sigma_then_m: float
    """The same with this point and those before it measured in all these photos."""
    worst_then_m: float
    """The largest of the whole block then."""


@dataclass(frozen=True, slots=True, eq=False)
class _Site:
    """A place that is weighed, with what its point would say."""

    photo_id: str
    place: int
    position: Position
    photos: tuple[str, ...]
    rows: Float64[np.ndarray, "rows unknowns"]
    by_point: Float64[np.ndarray, "rows 3"]


# design: what one looks for in an afternoon.
def wanted_control(influence: Influence, count: int = 5) -> tuple[Want, ...]:
    """The places where control would make the block's least certain ground most certain.

    One after the other: each is chosen as if those before it were there. A point is taken to be
    measured in every photo that shows it, as well as the block's control is in the median.

    Args:
        influence: The equations of an adjusted block.
        count: How many places at most.
    """
    equations, ground = influence.equations, influence.ground
    corners = influence.corner_sigmas()
    variances = np.array([sigma**2 for sigma in corners.values()])
    sites = _sites(influence, list(corners), variances)
    columns = [equations.cofactors(site.rows) for site in sites]
    row_of = {name: row for row, name in enumerate(corners)}
    wants: list[Want] = []
    while sites and len(wants) < count:
        gains = [
            _gain(ground.of(column), _inverse(site, column))
            for site, column in zip(sites, columns, strict=True)
        ]
        left = [_badness(variances - gain) for gain in gains]
        best = int(np.argmin(left))
        site, column, gain = sites.pop(best), columns.pop(best), gains[best]
        at = row_of[site.photo_id], site.place
        now, variances = variances, variances - gain
        wants.append(
            Want(site.photo_id, site.place, site.position, site.photos,
                 float(_length(now[at])), float(_length(variances[at])),
                 float(_length(variances).max()))
        )  # fmt: skip
        taken = column @ _inverse(site, column)
        columns = [other - taken @ (site.rows @ other) for other in columns]
    return tuple(wants)


def _length(variances: np.ndarray) -> np.ndarray:
    """Standard deviation of position from those of east and north."""
    return np.asarray(np.sqrt(np.maximum(variances.sum(axis=-1), 0.0)))


def _badness(variances: Float64[np.ndarray, "photos 9 2"]) -> float:
    return float(np.mean(variances.sum(axis=2) ** POWER))


def _inverse(site: _Site, column: Float64[np.ndarray, "unknowns rows"]) -> np.ndarray:
    """Weight of what a site's point says against what the block says of it already."""
    said = np.eye(len(site.rows)) + site.rows @ column + site.by_point @ site.by_point.T
    return np.linalg.inv(said)


def _gain(moved: np.ndarray, inverse: np.ndarray) -> Float64[np.ndarray, "photos 9 2"]:
    """By how much the variances of all places become less."""
    return np.sum((moved @ inverse) * moved, axis=3)


def _sites(
    influence: Influence, names: list[str], variances: Float64[np.ndarray, "photos 9 2"]
) -> list[_Site]:
    """Candidate places, the least certain first, none near another."""
    block, equations = influence.block, influence.equations
    sigma_px, sigma_m = _usual(block)
    chosen: list[_Site] = []
    for flat in np.argsort(-variances.sum(axis=2), axis=None, kind="stable").tolist():
        # source: nine places a photo.
        photo_id, place = names[flat // 9], flat % 9
        position, side = _ground_place(block, photo_id, place)
        if any(np.hypot(*(position - other.position)[:2]) < APART * side for other in chosen):
            continue
        shown = _showing(block, names, position)
        parts = [
            equations.of_free_ray(
                names.index(name),
                Measurement("wanted", name, float(pixel[0, 0]), float(pixel[0, 1]), sigma_px),
                position,
            )
            for name, pixel in shown
        ]
        chosen.append(
            _Site(
                photo_id,
                place,
                position,
                tuple(name for name, _ in shown),
                np.concatenate([part[0] for part in parts]),
                np.concatenate([part[1] for part in parts]) * sigma_m,
            )
        )
        if len(chosen) == CANDIDATES:
            break
    return chosen


def _usual(block: Block) -> tuple[float, Position]:
    """Median standard deviations of the control in use: of a measurement, of a point."""
    used = [item for item in block.measurements.values() if block.steers(item)]
    points = [point for point in block.surveyed.values() if point.role == "control"]
    pixels = float(np.median([item.sigma_px for item in used])) if used else USUAL_PX
    metres = np.median([point.sigma_m for point in points], axis=0) if points else USUAL_M
    return pixels, np.asarray(metres, dtype=np.float64)


def _ground_place(block: Block, photo_id: str, place: int) -> tuple[Position, float]:
    """One of a photo's nine places on its mean ground, and the photo's side there, metres."""
    photo, camera = block.photos[photo_id], block.camera_of(photo_id)
    half = np.array(camera.frame_mm) / 2
    share = REACH * np.array([place % 3 - 1.0, 1.0 - place // 3])
    pixels = photo.interior.pixel_from_film(np.array([share * half, [0.0, 0.0], [half[0], 0.0]]))
    found = photo.object_from_pixel(pixels, np.full(3, photo.ground_height_m), camera)
    return found[0], 2 * float(np.hypot(*(found[2] - found[1])[:2]))


def _showing(
    block: Block, names: Sequence[str], position: Position
) -> list[tuple[str, PixelPoints]]:
    """The photos whose frame holds a place on the ground, with its pixel."""
    found: list[tuple[str, PixelPoints]] = []
    for name in names:
        photo, camera = block.photos[name], block.camera_of(name)
        pixels: PixelPoints = photo.pixel_from_object(position[None], camera)
        film = photo.interior.film_from_pixel(pixels)[0]
        if np.isfinite(film).all() and np.all(np.abs(film) < np.array(camera.frame_mm) / 2):
            found.append((name, pixels))
    return found
