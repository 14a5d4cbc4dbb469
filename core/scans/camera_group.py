"""Scans of one camera judged together: what a single scan cannot determine, all of them may."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float64

from core.arrays import FilmPoints, PixelPoints
from core.doubts import Doubt, Failure
from core.geometry.camera import Camera
from core.geometry.transforms import PlaneTransform, apply_affine, fit_similarity
from core.said import say
from core.scans.fiducials import SQUARE
from core.scans.film_area import STRIP_SIDES, area_from_interior
from core.scans.interior_orientation import ScanOrientation, pooled_factor
from core.scans.judging import (
    REPEATED,
    FiducialMeasurement,
    doubts_of_fit,
    interior_of,
    places_of,
)
from core.scans.naming import (
    CORNERS,
    SIDES,
    UPRIGHT,
    WAYS,
    Way,
    lying,
    name_marks,
    strip_on_film,
    turned_words,
    ways_of_strip,
)
from core.scans.scan_pairs import front_is, sides_shown

Oriented = Mapping[str, ScanOrientation]
ROUNDS = 20  # design: generalised Procrustes of a few marks settles in less than ten
BAD_MM = 0.15  # design: three times what symmetric cameras are built to
"""A mark of one photo that lies so far from its place in the others is left out."""
LONE_SIGMA_MM = 0.05  # design: how symmetric cameras are built
"""How well one photo alone tells where its marks are."""
PRINCIPAL_POINT_SIGMA_MM = 0.15  # design: certificates have it within a tenth or two of the marks
"""How well the middle of the marks stands for the principal point (METHODS 2)."""
LEAST_AGREED = 2  # design: the ground beside a mark is another in every photo
"""Photos that must show a mark of no listed kind at one place for it to be the camera's."""
FEW = 3  # design: two cannot tell which of them is wrong
"""With fewer photos the marks are taken to lie symmetrically."""
Places = Mapping[str, tuple[float, float]]
Stack = Float64[np.ndarray, "photos marks 2"]


@dataclass(frozen=True, slots=True)
class EstimatedMarks:
    """The marks of a camera as its photos show them."""

    places_mm: Places
    """Film frame: origin where lines between opposite marks meet, millimetres."""
    sigma_mm: float
    """Standard deviation of a place per axis, millimetres."""
    photos: int
    """Photos they rest on."""
    left_out: tuple[tuple[str, str], ...]
    """(photo, mark) of marks that lie elsewhere than in the other photos."""
    agreed: frozenset[tuple[str, str]] = frozenset()
    """(photo, mark) of marks that lie where another photo has them too: the ground there is
    another, so they are the camera's."""


@dataclass(frozen=True, slots=True, eq=False)
class Family:
    """All scans of one camera, settled together."""

    oriented: Oriented
    """By photo."""
    camera: Camera
    """The camera, with marks where only its photos tell them."""
    doubts: tuple[Doubt, ...]
    """What concerns the camera, not one scan."""
    estimated: EstimatedMarks | None = None
    """Its marks as its photos show them; None where they are certified, or too few were found."""


def settle_family(oriented: Oriented, camera: Camera, pixels_mm: Mapping[str, float]) -> Family:
    """Bring the scans of a camera to one way to lie, one set of marks, one accuracy.

    Args:
        oriented: The scans of the camera, each by itself.
        camera: The camera.
        pixels_mm: Nominal size of a scan pixel by photo, millimetres.
    """
    ways = _ways(oriented, camera)
    doubts: tuple[Doubt, ...] = ()
    estimated = None
    if not camera.fiducials_mm:
        films = {
            name: _on_film(scan.fiducials, ways[name], pixels_mm[name])
            for name, scan in oriented.items()
        }
        estimated = estimate_marks(films)
        if estimated is None:
            return Family(oriented, camera, ())
        camera = replace(camera, fiducials_mm=dict(estimated.places_mm))
        doubts = (marks_estimated(camera, estimated),)
    agreed = estimated.agreed if estimated is not None else frozenset[tuple[str, str]]()
    settled = {
        name: _settled(scan, camera, ways[name], pixels_mm[name], agreed)
        for name, scan in oriented.items()
    }
    return Family(_pooled(settled), camera, doubts, estimated)


def _ways(oriented: Oriented, camera: Camera) -> dict[str, Way]:
    """How each film lies: by the marks, where those cannot tell by data strip and margin."""
    ways = {name: scan.way for name, scan in oriented.items()}
    free = {name: _open_ways(scan, camera) for name, scan in oriented.items()}
    strip = camera.data_strip or _usual_strip(oriented, ways)
    for name, scan in oriented.items():
        for way in ways_of_strip(strip, scan.strip):
            if way == ways[name] or way in free[name]:
                ways[name] = way
                break
    unsure = {name for name, some in free.items() if len({back for _, back in some}) > 1}
    if len(oriented) > 2 and unsure:
        for name, back in _backs(oriented, ways, unsure).items():
            ways[name] = _seen_from(oriented[name], strip, ways[name], free[name], back)
    return ways


def _backs(oriented: Oriented, ways: Mapping[str, Way], unsure: set[str]) -> dict[str, bool]:
    """Whether the scans whose marks do not tell are mirrored: as the ground shows, else as most."""
    known = {name: back for name, (_, back) in ways.items() if name not in unsure}
    scans = {name: (oriented[name].scan, oriented[name].area) for name in oriented}
    usual = 2 * sum(known.values()) > len(known)
    backs = dict.fromkeys(unsure, usual) if known else {}
    for sides in sides_shown(scans):
        front = front_is(sides, known)
        if front is not None:
            backs |= {name: sides[name] != front for name in unsure & set(sides)}
    return backs


def _seen_from(
    scan: ScanOrientation, strip: str, way: Way, allowed: tuple[Way, ...], back: bool
) -> Way:
    """The way seen from a side that the data strip allows, or the assumed one from that side."""
    if way[1] == back:
        return way
    by_strip = [w for w in ways_of_strip(strip, scan.strip) if w[1] == back and w in allowed]
    return by_strip[0] if by_strip else (way[0], back)


def _open_ways(scan: ScanOrientation, camera: Camera) -> tuple[Way, ...]:
    """Ways that the marks allow."""
    if camera.fiducials_mm:
        return (scan.way, *scan.rivals)
    width, height = camera.frame_mm
    return WAYS if abs(width - height) < SQUARE * width else tuple(w for w in WAYS if w[0] % 2 == 0)


def _usual_strip(oriented: Oriented, ways: Mapping[str, Way]) -> str:
    """The side of the film on which most scans have their data strip; empty if none was seen."""
    sides = [
        strip_on_film(scan.strip, ways[name])
        for name, scan in oriented.items()
        if scan.strip is not None
    ]
    return max(STRIP_SIDES, key=sides.count) if sides else ""


def _on_film(
    marks: tuple[FiducialMeasurement, ...], way: Way, pixel_mm: float
) -> dict[str, tuple[float, float]]:
    """Marks in millimetres on the upright film, named by where they lie there."""
    directions = {**CORNERS, **SIDES}
    placed: dict[str, tuple[float, float]] = {}
    quarter, back = way
    undo: Way = (quarter, True) if back else (-quarter % 4, False)
    for mark in marks:
        at = np.array([[mark.column, -mark.row]]) * pixel_mm
        film = lying(at, undo)[0]
        direction = lying(np.array([directions[mark.name]]), undo)[0]
        name = next(n for n, d in directions.items() if np.allclose(d, direction))
        placed[name] = (float(film[0]), float(film[1]))
    return placed


def _settled(
    scan: ScanOrientation,
    camera: Camera,
    way: Way,
    pixel_mm: float,
    agreed: frozenset[tuple[str, str]],
) -> ScanOrientation:
    """One scan with its marks named for the way it lies, and its interior orientation anew."""
    same = way == scan.way and {m.name for m in scan.fiducials} <= set(camera.fiducials_mm)
    if len(scan.fiducials) < 2 or (same and scan.interior.model != "nominal"):
        return scan
    marks = _named(scan, camera, way)
    interior = interior_of(marks, camera.fiducials_mm, way[1])
    if isinstance(interior, Failure):
        return scan
    of_marks = ("fiducial-doubtful", "fiducial-unsure")
    sure = {mark.place for mark in marks if (scan.photo_id, mark.name) in agreed}
    doubts = tuple(
        doubt
        for doubt in scan.doubts
        if doubt.kind in of_marks and not (REPEATED in doubt.evidence and _place_of(doubt) in sure)
    )
    doubts += doubts_of_fit(scan.photo_id, interior, marks, pixel_mm)
    if way != scan.way:
        doubts += (_turned(scan.photo_id, way),)
    area = scan.area if scan.area.seen else area_from_interior(interior, camera)
    return replace(
        scan, interior=interior, fiducials=marks, doubts=doubts, way=way, area=area,
        rivals=(*(w for w in scan.rivals if w != way), scan.way),
    )  # fmt: skip


def _place_of(doubt: Doubt) -> tuple[float, float]:
    """Column and row of the mark that a doubt is about."""
    return float(doubt.evidence["column"]), float(doubt.evidence["row"])


def _named(scan: ScanOrientation, camera: Camera, way: Way) -> tuple[FiducialMeasurement, ...]:
    """The marks with the names they have when the film lies in a way."""
    names = [mark.name for mark in scan.fiducials]
    if not set(names) <= set(camera.fiducials_mm) or set(names) <= {*CORNERS, *SIDES}:
        renamed = list(_on_film(scan.fiducials, way, 1.0))
    else:
        pixels = places_of(scan.fiducials)
        sigmas = np.array([mark.sigma_px for mark in scan.fiducials])
        naming = name_marks(names, pixels, sigmas, scan.way, camera.fiducials_mm, (way,), scan.area)
        renamed = list(naming.names)
    marks = [replace(mark, name=name) for mark, name in zip(scan.fiducials, renamed, strict=True)]
    order = list(camera.fiducials_mm)
    kept = [mark for mark in marks if mark.name in order]
    return tuple(sorted(kept, key=lambda mark: order.index(mark.name)))


def _pooled(oriented: Oriented) -> Oriented:
    """All photos with the variance factor of all: two redundant equations alone say little."""
    factor = pooled_factor([scan.interior for scan in oriented.values()])
    if factor is None:
        return oriented
    return {
        name: scan
        if scan.interior.model == "nominal"
        else replace(scan, interior=scan.interior.with_variance_factor(factor))
        for name, scan in oriented.items()
    }


def _turned(photo_id: str, way: Way) -> Doubt:
    """The doubt of a scan that lies otherwise than its marks alone would say."""
    words = "lies upright after all" if way == UPRIGHT else say("is {way}", way=turned_words(way))
    return Doubt(
        "scan-turned",
        photo_id,
        say(
            "By its data strip and its neighbours this scan {words} against the others "
            "of its camera; its fiducials were named so. They alone cannot tell.",
            words=words,
        ),
        0.5 if way[1] else 0.2,  # design: a mirrored scan spoils matching, a turned one does not
        {"quarter_turns": way[0], "mirrored": way[1]},
    )


def marks_estimated(camera: Camera, estimated: EstimatedMarks) -> Doubt:
    """The word about marks that nobody certified."""
    places = ", ".join(
        f"{name} = [{x:.3f}, {y:.3f}]" for name, (x, y) in estimated.places_mm.items()
    )
    rests = (
        "as one or two photos show them, taken to lie symmetrically"
        if estimated.photos < FEW
        else say(
            "to {sigma:.0f} µm from {count} photos",
            sigma=1000 * estimated.sigma_mm,
            count=estimated.photos,
        )
    )
    return Doubt(
        "fiducials-estimated",
        camera.name,
        say(
            "Camera '{name}' has no fiducials_mm; its marks were found and placed "
            "{rests}. The principal point is only known to {sigma:.2f} mm. To keep them: "
            "fiducials_mm = {{ {places} }}",
            name=camera.name,
            rests=rests,
            sigma=PRINCIPAL_POINT_SIGMA_MM,
            places=places,
        ),
        evidence={
            "places_mm": {name: list(place) for name, place in estimated.places_mm.items()},
            "sigma_mm": estimated.sigma_mm,
            "left_out": [list(pair) for pair in estimated.left_out],
        },
    )


def estimate_marks(measured: Mapping[str, Places]) -> EstimatedMarks | None:
    """Generalised Procrustes over all photos, the mean scale kept (METHODS 2).

    Args:
        measured: By photo, the marks in millimetres by the nominal scan pixel (x right, y up, any
            origin and small rotation), film upright; names are those of `layouts`.

    Returns:
        The marks; None where no photo has three of them.
    """
    names = tuple(name for name in (*CORNERS, *SIDES) if any(name in m for m in measured.values()))
    photos = [photo for photo, marks in measured.items() if len(marks) >= 3]
    if not photos or len(names) < 3:
        return None
    stack = np.full((len(photos), len(names), 2), np.nan)
    for i, photo in enumerate(photos):
        for j, name in enumerate(names):
            if name in measured[photo]:
                stack[i, j] = measured[photo][name]
    mean, moved = _procrustes(stack)
    bad = np.linalg.norm(moved - mean, axis=2) > BAD_MM
    left_out: list[tuple[str, str]] = []
    if len(photos) >= FEW and bad.any():
        left_out = [(photos[i], names[j]) for i, j in np.argwhere(bad).tolist()]
        stack[bad] = np.nan
        mean, moved = _procrustes(stack)
    agreed = _agreed(photos, names, _unscaled(stack, moved))
    known = np.isfinite(mean).all(axis=1)
    names, mean, moved = tuple(np.array(names)[known].tolist()), mean[known], moved[:, known]
    mean = _squared(names, mean)
    sigma = LONE_SIGMA_MM
    if len(photos) >= FEW:
        sigma = _spread(moved) / np.sqrt(len(photos))
    else:
        mean = _symmetric(names, mean)
    places = {name: (float(x), float(y)) for name, (x, y) in zip(names, mean, strict=True)}
    return EstimatedMarks(places, sigma, len(photos), tuple(left_out), agreed)


def _agreed(
    photos: Sequence[str], names: Sequence[str], moved: Stack
) -> frozenset[tuple[str, str]]:
    """(photo, mark) of marks that another photo has at the same place."""
    near = np.linalg.norm(moved[:, None] - moved[None], axis=3) < BAD_MM
    enough = near.sum(axis=1) >= LEAST_AGREED
    return frozenset((photos[i], names[j]) for i, j in np.argwhere(enough).tolist())


def _unscaled(stack: Stack, moved: Stack) -> Stack:
    """Moved photos at the scale they were scanned with.

    Points that lie further out alike at all marks would pass for film of another scale.
    """
    here, there = (one - np.nanmean(one, axis=1, keepdims=True) for one in (stack, moved))
    scale = np.sqrt(np.nansum(here**2, axis=(1, 2)) / np.nansum(there**2, axis=(1, 2)))
    middle = np.nanmean(moved, axis=1, keepdims=True)
    return middle + there * scale[:, None, None]


def _procrustes(stack: Stack) -> tuple[FilmPoints, Stack]:
    """Mean shape of all photos at their mean scale, and every photo moved onto it."""
    centred = stack - np.nanmean(stack, axis=1, keepdims=True)
    first = int(np.isfinite(stack[:, :, 0]).sum(axis=1).argmax())
    mean: FilmPoints = centred[first]
    moved, scales = centred, [1.0]
    for _ in range(ROUNDS):
        moved = np.full_like(stack, np.nan)
        scales = []
        for i, photo in enumerate(centred):
            both = np.isfinite(photo[:, 0]) & np.isfinite(mean[:, 0])
            fit = fit_similarity(photo[both], mean[both])
            if isinstance(fit, PlaneTransform):
                moved[i] = apply_affine(fit.matrix, photo)
                scales.append(fit.scale)
        counts = np.isfinite(moved[:, :, 0]).any(axis=0)
        mean = np.full(mean.shape, np.nan)
        # Nobody's scale is better than another's: their mean is the camera's.
        mean[counts] = np.nanmean(moved[:, counts], axis=0) / float(np.mean(scales))
    return mean, moved / float(np.mean(scales))


def _spread(moved: Stack) -> float:
    """Standard deviation of a mark in one photo about its mean, all marks seen twice together."""
    counts = np.isfinite(moved).sum(axis=0)
    freedom = int(np.clip(counts - 1, 0, None).sum())
    if not freedom:
        return LONE_SIGMA_MM
    apart = moved - np.nansum(moved, axis=0) / np.maximum(counts, 1)
    return float(np.sqrt(np.nansum(apart**2) / freedom))


def _squared(names: Sequence[str], mean: FilmPoints) -> FilmPoints:
    """Turned so that the marks stand straight, moved so that opposite ones meet in the origin."""
    ideal = np.array([{**CORNERS, **SIDES}[name] for name in names])
    fit = fit_similarity(mean, ideal * float(np.abs(mean).max()))
    if isinstance(fit, PlaneTransform):
        a, b = fit.matrix[0, 0], fit.matrix[1, 0]
        mean = mean @ (np.array([[a, -b], [b, a]]) / np.hypot(a, b)).T
    middles = [
        _crossing(mean[[names.index(n) for n in four]])
        for four in (("UL", "LR", "UR", "LL"), ("L", "R", "T", "B"))
        if all(n in names for n in four)
    ]
    middle = np.mean(middles, axis=0) if middles else (mean.min(axis=0) + mean.max(axis=0)) / 2
    return mean - middle


def _crossing(ends: PixelPoints) -> np.ndarray:
    """Where the line of the first two points meets that of the last two."""
    first, second = ends[1] - ends[0], ends[3] - ends[2]
    share = np.linalg.solve(np.column_stack([first, -second]), ends[2] - ends[0])
    return ends[0] + share[0] * first


def _symmetric(names: Sequence[str], mean: FilmPoints) -> FilmPoints:
    """Corner marks as a rectangle, marks of the sides opposite each other."""
    signs = np.array([{**CORNERS, **SIDES}[name] for name in names])
    result = np.zeros_like(mean)
    for group in (CORNERS, SIDES):
        inside = np.array([name in group for name in names])
        for axis in (0, 1):
            on = inside & (signs[:, axis] != 0)
            if on.any():
                half = float(np.mean(mean[on, axis] * signs[on, axis]))
                result[on, axis] = half * signs[on, axis]
    return result
