"""The scans of one camera together: what one alone cannot say, the others do."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from core.doubts import Doubt, Failure
from core.geometry.camera import Camera
from core.geometry.interior import InteriorOrientation
from core.scans.camera_marks import EstimatedMarks, estimate_marks
from core.scans.data_strip import STRIP_SIDES, strip_on_film, ways_of_strip
from core.scans.duplicate_scans import turned_words
from core.scans.film_area import area_from_interior
from core.scans.handedness import front_is, sides_shown
from core.scans.interior_doubts import doubts_of_fit
from core.scans.interior_orientation import ScanOrientation, interior_of
from core.scans.layouts import CORNERS, SIDES, UPRIGHT, WAYS, Way, lying
from core.scans.measured_marks import FiducialMeasurement
from core.scans.naming import name_marks

Oriented = Mapping[str, ScanOrientation]


@dataclass(frozen=True, slots=True, eq=False)
class Family:
    """All scans of one camera, settled together."""

    oriented: Oriented
    """By photo."""
    camera: Camera
    """The camera, with marks where only its photos tell them."""
    doubts: tuple[Doubt, ...]
    """What concerns the camera, not one scan."""


def settle_family(oriented: Oriented, camera: Camera, pixels_mm: Mapping[str, float]) -> Family:
    """Bring the scans of a camera to one way to lie, one set of marks, one accuracy.

    Args:
        oriented: The scans of the camera, each by itself.
        camera: The camera.
        pixels_mm: Nominal size of a scan pixel by photo, millimetres.
    """
    ways = _ways(oriented, camera)
    doubts: tuple[Doubt, ...] = ()
    if not camera.fiducials_mm:
        films = {
            name: _on_film(scan.fiducials, ways[name], pixels_mm[name])
            for name, scan in oriented.items()
        }
        estimated = estimate_marks(films)
        if estimated is None:
            return Family(oriented, camera, ())
        camera = replace(camera, fiducials_mm=dict(estimated.places_mm))
        doubts = (_estimated(camera, estimated),)
    settled = {
        name: _settled(scan, camera, ways[name], pixels_mm[name]) for name, scan in oriented.items()
    }
    return Family(_pooled(settled), camera, doubts)


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
    return WAYS if abs(width - height) < 0.02 * width else tuple(w for w in WAYS if w[0] % 2 == 0)


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


def _settled(scan: ScanOrientation, camera: Camera, way: Way, pixel_mm: float) -> ScanOrientation:
    """One scan with its marks named for the way it lies, and its interior orientation anew."""
    same = way == scan.way and {m.name for m in scan.fiducials} <= set(camera.fiducials_mm)
    if len(scan.fiducials) < 2 or (same and scan.interior.model != "nominal"):
        return scan
    marks = _named(scan, camera, way)
    interior = interior_of(marks, camera.fiducials_mm, way)
    if isinstance(interior, Failure):
        return scan
    of_marks = ("fiducial-doubtful", "fiducial-unsure")
    doubts = tuple(doubt for doubt in scan.doubts if doubt.kind in of_marks)
    doubts += doubts_of_fit(scan.photo_id, interior, marks, pixel_mm)
    if way != scan.way:
        doubts += (_turned(scan.photo_id, way),)
    area = scan.area if scan.area.seen else area_from_interior(interior, camera)
    return replace(
        scan, interior=interior, fiducials=marks, doubts=doubts, way=way, area=area,
        rivals=(*(w for w in scan.rivals if w != way), scan.way),
    )  # fmt: skip


def _named(scan: ScanOrientation, camera: Camera, way: Way) -> tuple[FiducialMeasurement, ...]:
    """The marks with the names they have when the film lies in a way."""
    names = [mark.name for mark in scan.fiducials]
    if not set(names) <= set(camera.fiducials_mm) or set(names) <= {*CORNERS, *SIDES}:
        renamed = list(_on_film(scan.fiducials, way, 1.0))
    else:
        pixels = np.array([(mark.column, mark.row) for mark in scan.fiducials])
        sigmas = np.array([mark.sigma_px for mark in scan.fiducials])
        naming = name_marks(names, pixels, sigmas, scan.way, camera.fiducials_mm, (way,), scan.area)
        renamed = list(naming.names)
    marks = [replace(mark, name=name) for mark, name in zip(scan.fiducials, renamed, strict=True)]
    order = list(camera.fiducials_mm)
    kept = [mark for mark in marks if mark.name in order]
    return tuple(sorted(kept, key=lambda mark: order.index(mark.name)))


def _pooled(oriented: Oriented) -> Oriented:
    """All photos with the variance factor of all: two redundant equations alone say little."""
    fitted = [scan.interior for scan in oriented.values() if scan.interior.redundancy]
    equations = sum(interior.redundancy for interior in fitted)
    if len(fitted) < 2:
        return oriented
    factor = sum(one.variance_factor * one.redundancy for one in fitted) / equations
    return {
        name: replace(scan, interior=_with_factor(scan.interior, factor))
        for name, scan in oriented.items()
    }


def _with_factor(interior: InteriorOrientation, factor: float) -> InteriorOrientation:
    """The interior orientation with pooled sigmas, where it was fitted at all."""
    return interior if interior.model == "nominal" else interior.with_variance_factor(factor)


def _turned(photo_id: str, way: Way) -> Doubt:
    """The doubt of a scan that lies otherwise than its marks alone would say."""
    words = "lies upright after all" if way == UPRIGHT else f"is {turned_words(way)}"
    return Doubt(
        "scan-turned",
        photo_id,
        f"By its data strip and its neighbours this scan {words} against the others of its "
        "camera; its fiducials were named so. They alone cannot tell.",
        0.5 if way[1] else 0.2,
        {"quarter_turns": way[0], "mirrored": way[1]},
    )


def _estimated(camera: Camera, estimated: EstimatedMarks) -> Doubt:
    """The word about marks that nobody certified."""
    places = ", ".join(
        f"{name} = [{x:.3f}, {y:.3f}]" for name, (x, y) in estimated.places_mm.items()
    )
    rests = (
        "as one or two photos show them, taken to lie symmetrically"
        if estimated.photos < 3
        else f"to {1000 * estimated.sigma_mm:.0f} um from {estimated.photos} photos"
    )
    return Doubt(
        "fiducials-estimated",
        camera.name,
        f"Camera '{camera.name}' has no fiducials_mm; its marks were found and placed {rests}. The "
        f"principal point is only known to {estimated.principal_point_sigma_mm:.2f} mm. To keep "
        f"them: fiducials_mm = {{ {places} }}",
        evidence={
            "places_mm": {name: list(place) for name, place in estimated.places_mm.items()},
            "sigma_mm": estimated.sigma_mm,
            "left_out": [list(pair) for pair in estimated.left_out],
        },
    )
