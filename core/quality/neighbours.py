"""Neighbouring blocks compared: photos and points that both hold, and ground that both show.

A difference is judged by what both adjustments predict of it. What both blocks took over alike, the
reference's own error first of all, moves both and is not in the difference. Nothing found here
steers an adjustment.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Literal

import numpy as np
from jaxtyping import Float64
from scipy.spatial import KDTree
from scipy.special import chdtrc

from core.adjustment.adjusted import AdjustmentReport
from core.adjustment.common_errors import CommonErrors
from core.adjustment.equations import PLACES, nine_places
from core.adjustment.influence import Influence
from core.arrays import ObjectPoints, Position, Scalars
from core.block import ground_of
from core.geometry.crs import SAME_PLACE_M
from core.geometry.exterior import turn_between

Verdict = Literal["agree", "differ", "disagree", "unknown"]
"""differ: by more than is predicted, within what both blocks may be off."""
Moved = Callable[[ObjectPoints], ObjectPoints]
"""Object points of the second block's CRS in that of the first."""
# source: Baarda 1968.
LEVEL = 0.001
"""Probability that a pair of sound blocks is told for anything that both hold."""
# design: a name may be used twice in an archive, by points that have nothing to do with each other.
SAME_POINT_M = 20.0
"""Points of one name that lie further apart are two points."""
# design: far more than coordinates are rounded by, and less than any map scale changes.
STEP_M = 100.0
"""Axes of another CRS are seen over this length."""
# source: two coordinates of a plane.
PLANE = 2
# design: a mean of fewer says little.
FEWEST_VECTORS = 6
"""Mosaics are compared where both have so many vectors of misfit in their overlap."""


@dataclass(frozen=True, slots=True, eq=False)
class NeighbourBlock:
    """One of two blocks that are compared."""

    report: AdjustmentReport
    """The adjusted block."""
    influence: Influence | None
    """Its equations; None where no photo took part."""


@dataclass(frozen=True, slots=True)
class Difference:
    """The second block less the first, against what is predicted."""

    length_m: float
    """RMS in plan over a photo's nine places, length of a point's or a mosaic's shift, metres."""
    sigma_m: float
    """Predicted RMS of the same, metres; NaN where it is not known."""
    chance: float
    """Probability that two sound blocks differ by more; NaN where it is not known."""

    @property
    def ratio(self) -> float:
        """Observed over predicted; about one between sound blocks."""
        return self.length_m / self.sigma_m if self.sigma_m > 0 else float("nan")

    def verdict(self, compared: int, limit_m: float) -> Verdict:
        """What it says at `LEVEL`.

        What is significant and matters to nobody is not called a disagreement: small blocks predict
        themselves somewhat too well.

        Args:
            compared: In so many ways the two blocks are compared.
            limit_m: Position error up to which both are released, metres.
        """
        if not isfinite(self.chance):
            return "unknown"
        if self.chance >= LEVEL / max(compared, 1):
            return "agree"
        return "disagree" if self.length_m > limit_m else "differ"


@dataclass(frozen=True, slots=True, eq=False)
class SharedPhoto:
    """One photo of two blocks."""

    photo_id: str
    """Its name in the first block."""
    other_id: str
    """Its name in the second."""
    difference: Difference
    """Of the ground it shows."""
    ground_m: Float64[np.ndarray, "9 2"]
    """Shift (E, N) of nine places on the ground, upper left to lower right on the film, metres."""
    shift_m: Position
    """Of the perspective centre, metres."""
    shift_sigma_m: Position
    """Predicted standard deviations of that, metres."""
    turn: Position
    """Rotation about the image's axes, radians."""
    turn_sigma: Position
    """Predicted standard deviations of that, radians."""


@dataclass(frozen=True, slots=True, eq=False)
class SharedPoint:
    """One surveyed or new point of two blocks."""

    point_id: str
    """Its name in both."""
    roles: tuple[str, str]
    """What it is for in the first block and in the second."""
    difference: Difference
    """Of its computed place, all three coordinates together."""
    shift_m: Position
    """Second less first (E, N, H), metres."""
    sigma_m: Position
    """Predicted standard deviations of that, metres; NaN where they are not known. Rays in shared
    photos count as independent: it is then an upper limit."""
    residuals_m: tuple[Position | None, Position | None]
    """Computed less given coordinates in both, metres; None for a new point."""
    sigmas_m: tuple[Position | None, Position | None]
    """Standard deviations of the computed coordinates in both, metres."""


@dataclass(frozen=True, slots=True)
class SharedGround:
    """Ground that the mosaics of two blocks show, by what each misfits the reference."""

    difference: Difference
    """Of the mean shift."""
    shift_m: tuple[float, float]
    """Mean, second less first (E, N), metres."""
    rms_m: float
    """RMS of the differences at the same place, metres."""
    places: int
    """Places at which both were measured."""


@dataclass(frozen=True, slots=True, eq=False)
class MisfitParts:
    """What is needed of a mosaic's misfit, in the CRS of the first block."""

    positions: Float64[np.ndarray, "n 2"]
    """Easting, northing, metres."""
    shifts_m: Float64[np.ndarray, "n 2"]
    """Mosaic minus reference, metres."""
    variances: Float64[np.ndarray, "n 2"]
    """Predicted variances (E, N) without those of the reference, square metres."""


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """All that two blocks share."""

    photos: tuple[SharedPhoto, ...] = ()
    """Oriented in both, the least likely first."""
    points: tuple[SharedPoint, ...] = ()
    """Computed in both, the least likely first."""
    ground: SharedGround | None = None
    """None where mosaics were not compared."""
    measurements: int = 0
    """Measurements in shared photos that took part in both."""
    correlation: float = 0.0
    """Their mean correlation."""
    one_sided: tuple[str, ...] = ()
    """Shared photos, by their first name, that one of the blocks does not orient."""

    @property
    def compared(self) -> int:
        """How many differences are judged together."""
        return sum(isfinite(one.difference.chance) for one in self.every)

    @property
    def every(self) -> tuple["SharedPhoto | SharedPoint | SharedGround", ...]:
        """Photos, points and ground."""
        return *self.photos, *self.points, *(() if self.ground is None else (self.ground,))


def compare_photos(
    one: NeighbourBlock,
    other: NeighbourBlock,
    names: Mapping[str, str],
    moved: Moved | None = None,
    reference_sigma_m: float = 0.0,
) -> Comparison:
    """Photos that two blocks hold: the ground each shows, and its exterior orientations.

    Args:
        one: The first block.
        other: The second.
        names: Each shared photo, by its name in the first block and in the second.
        moved: Brings object points of the second block into the CRS of the first; None where both
            have one.
        reference_sigma_m: Standard deviation per axis of what the references of both are off
            against each other, metres; 0 where they are the same.
    """
    oriented = {
        name: there
        for name, there in names.items()
        if one.report.block.photos[name].oriented and other.report.block.photos[there].oriented
    }
    one_sided = tuple(name for name in names if name not in oriented)
    if not oriented or one.influence is None or other.influence is None:
        return Comparison(one_sided=one_sided)
    common = CommonErrors(
        one.influence,
        other.influence,
        (one.report.unit, other.report.unit),
        oriented,
        same_axes=moved is None,
    )
    shared = [
        found
        for pair in oriented.items()
        if (found := _compare_photo(one, other, pair, (common, moved, reference_sigma_m)))
    ]
    shared.sort(key=lambda photo: photo.difference.chance)
    return Comparison(tuple(shared), (), None, common.measurements, common.correlation, one_sided)


def _compare_photo(
    one: NeighbourBlock,
    other: NeighbourBlock,
    names: tuple[str, str],
    by: tuple[CommonErrors, Moved | None, float],
) -> SharedPhoto | None:
    common, moved, reference_sigma_m = by
    blocks = one.report.block, other.report.block
    photos = tuple(block.photos[name] for block, name in zip(blocks, names, strict=True))
    cameras = tuple(block.camera_of(name) for block, name in zip(blocks, names, strict=True))
    pixels = photos[0].interior.pixel_from_film(nine_places(cameras[0].frame_mm))
    # Heights are those of the first: two blocks may take the ground for level at another height.
    heights = np.full(PLACES, photos[0].ground_height_m)
    here = ground_of(photos[0], cameras[0], pixels)
    there = photos[1].object_from_pixel(pixels, heights, cameras[1])
    turn, scale = _axes_at(there[0], moved)
    errors = common.of_photo(names, (here, there), turn)
    if errors is None:
        return None
    apart = ((there if moved is None else moved(there)) - here)[:, :2]
    alike = np.kron(np.ones((PLACES, PLACES)), np.eye(PLANE))
    ground = errors.ground + reference_sigma_m**2 * alike
    centre = photos[1].exterior.centre[None]
    shift = (centre if moved is None else moved(centre))[0] - photos[0].exterior.centre
    shift[2] += (scale - 1) * (centre[0, 2] - heights[0])
    rotations = [photo.exterior.object_from_image for photo in photos]
    off = [reference_sigma_m**2] * PLANE + [0.0] * 4
    sigmas = np.sqrt(np.maximum(np.diag(errors.exterior) + off, 0.0))
    return SharedPhoto(
        *names,
        difference=_of_places(apart, ground),
        ground_m=apart,
        shift_m=shift,
        shift_sigma_m=sigmas[:3],
        turn=turn_between(rotations[0], turn @ rotations[1]),
        turn_sigma=sigmas[3:],
    )


def _axes_at(place: Position, moved: Moved | None) -> tuple[Float64[np.ndarray, "3 3"], float]:
    """Axes of the first CRS from those of the second at one place, and its scale there.

    A photo that fits the ground of either map stands higher by that scale.
    """
    turn = np.eye(3)
    if moved is None:
        return turn, 1.0
    steps = np.array([[0.0, 0.0, 0.0], [STEP_M, 0.0, 0.0], [0.0, STEP_M, 0.0]])
    there = moved(place + steps)
    left, lengths, right = np.linalg.svd((there[1:, :2] - there[0, :2]).T / STEP_M)
    turn[:2, :2] = left @ right
    return turn, float(lengths.mean())


def _of_places(
    apart: Float64[np.ndarray, "n 2"], covariance: Float64[np.ndarray, "m m"]
) -> Difference:
    """Test of correlated shifts by their RMS: freedom tr(C)^2 / tr(C^2) (Satterthwaite 1946).

    Their weighted form would ask for the smallest eigenvalues of C, which nobody knows.
    """
    length = float(np.sqrt(np.mean(np.sum(apart**2, axis=1))))
    total = float(np.trace(covariance))
    if not (np.isfinite(total) and total > 0):
        return Difference(length, float("nan"), float("nan"))
    freedom = total**2 / float(np.sum(covariance**2))
    chance = chdtrc(freedom, freedom * length**2 * len(apart) / total)
    return Difference(length, float(np.sqrt(total / len(apart))), float(chance))


@dataclass(frozen=True, slots=True, eq=False)
class _Computed:
    """What a block says of one point."""

    role: str
    position: Position
    sigma_m: Position | None
    given: Position | None
    given_sigma_m: Position | None


def compare_points(
    one: AdjustmentReport,
    other: AdjustmentReport,
    moved: Moved | None = None,
    reference_sigma_m: float = 0.0,
) -> tuple[SharedPoint, ...]:
    """Points of the user that both blocks compute, the least likely difference first.

    The coordinates that both took over are common: for control in both blocks, with standard
    deviations s of the results and g of the given coordinate, C = s1^2 + s2^2 - 2 s1^2 s2^2 / g^2.

    Args:
        one: The first block.
        other: The second.
        moved: As in `compare_photos`.
        reference_sigma_m: As there, for new points, which hang on the reference.
    """
    here, there = _computed(one), _computed(other)
    found: list[SharedPoint] = []
    for name in sorted(here.keys() & there.keys()):
        first, second = here[name], there[name]
        position = second.position if moved is None else moved(second.position[None])[0]
        turn, _ = _axes_at(second.position, moved)
        shift = position - first.position
        if float(np.linalg.norm(shift)) > SAME_POINT_M:
            continue
        variances = _variances(first, second, (one.unit, other.unit), moved)
        if first.given is None or second.given is None:
            variances = variances + np.array([reference_sigma_m**2] * PLANE + [0.0])
        residuals = [None if p.given is None else p.position - p.given for p in (first, second)]
        if residuals[1] is not None:
            residuals[1] = turn @ residuals[1]
        found.append(
            SharedPoint(
                name,
                (first.role, second.role),
                _of_coordinates(shift, variances),
                shift,
                np.sqrt(variances),
                (residuals[0], residuals[1]),
                (first.sigma_m, second.sigma_m),
            )
        )
    return tuple(sorted(found, key=lambda point: _worst(point.difference)))


def _worst(difference: Difference) -> tuple[bool, float]:
    unknown = not np.isfinite(difference.chance)
    return unknown, 0.0 if unknown else difference.chance


def _computed(report: AdjustmentReport) -> dict[str, _Computed]:
    """Points of the user with what the block makes of them; those the program found are not."""
    known = {
        name: point
        for name, point in report.block.surveyed.items()
        if point.source in ("surveyed", "hand")
    }
    found = {
        name: _Computed(
            "control",
            position,
            report.surveyed_sigmas_m.get(name),
            known[name].position,
            known[name].sigma_m,
        )
        for name, position in report.surveyed_positions.items()
        if name in known
    }
    for check in report.checks:
        if check.point_id in known:
            given = known[check.point_id]
            told = check.position, check.sigma_m, given.position, given.sigma_m
            found[check.point_id] = _Computed("check", *told)
    for new in report.new_points:
        found[new.point_id] = _Computed("new", new.position, new.sigma_m, None, None)
    return found


def _variances(
    first: _Computed, second: _Computed, units: tuple[float, float], moved: Moved | None
) -> Position:
    """Predicted variances of the difference of one point's coordinates; NaN where not known."""
    if first.sigma_m is None or second.sigma_m is None:
        return np.full(3, np.nan)
    # What a block took over as it was given has no error of its own.
    one, other = (np.where(s > 0, s, np.nan) ** 2 for s in (first.sigma_m, second.sigma_m))
    same = (
        moved is None
        and first.role == second.role == "control"
        and first.given is not None
        and second.given is not None
        and bool(np.all(np.abs(first.given - second.given) < SAME_PLACE_M))
    )
    if not same or first.given_sigma_m is None:
        return one + other
    given = first.given_sigma_m**2
    return np.maximum(one + other - 2 * one * other / (units[0] * units[1] * given), 0.0)


def _of_coordinates(shift: Scalars, variances: Scalars) -> Difference:
    """Test of independent coordinates; those without a variance do not count."""
    known = np.isfinite(variances) & (variances > 0)
    length = float(np.linalg.norm(shift))
    if not known.any():
        return Difference(length, float("nan"), float("nan"))
    squares = float(np.sum(shift[known] ** 2 / variances[known]))
    chance = float(chdtrc(int(known.sum()), squares))
    return Difference(length, float(np.sqrt(variances[known].sum())), chance)


def compare_misfits(
    one: MisfitParts, other: MisfitParts, apart_m: float, reference_sigma_m: float = 0.0
) -> SharedGround | None:
    """Two mosaics by what each misfits its reference, where both were measured.

    The variance of a mean is taken to be that of one place: photos of a block err alike over the
    little ground that two blocks share. The scatter of the differences is added, over their number.

    Args:
        one: The first mosaic.
        other: The second.
        apart_m: Places of both lie no further apart, metres.
        reference_sigma_m: As in `compare_photos`.

    Returns:
        None where they have too few places in common.
    """
    if min(len(one.positions), len(other.positions)) < FEWEST_VECTORS:
        return None
    apart, nearest = KDTree(other.positions).query(one.positions)
    rows = np.flatnonzero(np.asarray(apart) < apart_m)
    if len(rows) < FEWEST_VECTORS:
        return None
    match = np.asarray(nearest)[rows]
    shifts = other.shifts_m[match] - one.shifts_m[rows]
    mean = shifts.mean(axis=0)
    variances = one.variances[rows].mean(axis=0) + other.variances[match].mean(axis=0)
    variances = variances + shifts.var(axis=0, ddof=1) / len(rows) + reference_sigma_m**2
    difference = _of_coordinates(mean, variances)
    rms = float(np.sqrt(np.mean(np.sum(shifts**2, axis=1))))
    return SharedGround(difference, (float(mean[0]), float(mean[1])), rms, len(rows))


def disagreements(
    found: Comparison, limit_m: float
) -> Sequence[SharedPhoto | SharedPoint | SharedGround]:
    """What tells two blocks apart, photos first; `limit_m` as in `Difference.verdict`."""
    count = found.compared
    return [one for one in found.every if one.difference.verdict(count, limit_m) == "disagree"]
