"""Approximate exterior orientation of one photo from one source: near-vertical, with its prior.

World files, points clicked in QGIS, footprints and EO lists each give one, with an honest prior,
and further hypotheses if the rotation is not known.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from core.arrays import Affine2, Position
from core.block import ExteriorPrior
from core.doubts import Doubt
from core.errors import CrsError, ProjectError, ScanError
from core.formats.eo_list import EoRecord
from core.formats.outlines import Footprint
from core.formats.qgis_points import QgisPoints
from core.formats.world_file import WorldFile
from core.geometry.camera import Camera
from core.geometry.crs import (
    Bounds,
    check_range,
    horizontal,
    operation_between,
    read_crs,
    same_coordinates,
)
from core.geometry.exterior import ExteriorOrientation
from core.geometry.interior import InteriorOrientation
from core.geometry.transforms import (
    PlanePoints,
    PlaneTransform,
    apply_affine,
    compose_affine,
    fit_affine,
    fit_similarity,
    invert_affine,
    rotation_and_scale,
)
from core.said import say

GeoreferenceSource = Literal["world-file", "points", "footprints", "exterior", "area"]
QUARTERS = np.arange(4) * np.pi / 2  # source: definition of a quarter turn.
# source: specification of the Czech orthophoto flights: 95 % of photos tilt by less than 3 degrees.
TILT = float(np.radians(3.0))
"""Standard deviation of omega and phi of a photo that is called vertical, radians."""
# design: five kilometres of error happen, half a country does not.
FAR_M = 50_000.0
"""A photo further than this outside the DEM is a mistake, not a poor start, metres."""
# design: frames nominally square differ by a twentieth in a scan; tilt and relief stretch by less.
SQUARE = 0.05
"""Lengths that differ by less than this share are taken as alike."""
# design: that of drift between photos of one strip, several times over.
ALONG_STRIP = float(np.radians(20.0))
"""Standard deviation of kappa that follows from the direction of flight, radians."""
# design: an area without any hint is searched whole: its border lies 2.5 deviations off the middle.
AREA_SIGMAS = 5
"""Width of an area over the standard deviation of a place in it."""


@dataclass(frozen=True, slots=True)
class Trust:
    """How far a source is trusted, as a-priori standard deviations of near-vertical photos."""

    place_m: float
    """Easting and northing, metres."""
    height_share: float
    """Height over ground from the source's scale, as a share of it."""
    kappa: float
    """kappa of each hypothesis, radians."""


# design: good world files lie within 10 m, bad ones 300 m off; clicked points are as good as their
# clicks; footprints are drawn round by hand; archives round scale numbers, and say nothing of the
# direction of flight, so that each hypothesis covers half a quarter turn on either side. A tilted
# photo's centre is less sure than its ground, by the height times its tilt: that is not in here.
TRUST: Mapping[GeoreferenceSource, Trust] = {
    "world-file": Trust(100.0, 0.04, np.radians(5.0)),
    "points": Trust(20.0, 0.04, np.radians(2.0)),
    "footprints": Trust(300.0, 0.1, np.radians(10.0)),
    "area": Trust(np.nan, 0.06, np.pi / 4),
}
# design: what positions of film cameras in flight are worth where the list does not say.
LISTED = (5.0, float(np.radians(0.5)))
"""Standard deviations of an EO list without sigma columns: centre (m), angles (rad)."""


@dataclass(frozen=True, slots=True)
class Ground:
    """What is known of the ground before any photo is placed on it."""

    crs: str
    """CRS of the block."""
    height_m: float
    """Mean height under the photo, metres."""
    bounds: Bounds | None = None
    """West, south, east, north of the DEM, metres; positions far outside are refused."""


@dataclass(frozen=True, slots=True, eq=False)
class Approximation:
    """An approximate exterior orientation and how far it may be trusted."""

    exterior: ExteriorOrientation
    """The likeliest one."""
    prior: ExteriorPrior
    """Standard deviations, the same for every hypothesis."""
    source: GeoreferenceSource
    """What it was derived from."""
    hypotheses: tuple[ExteriorOrientation, ...]
    """All that are possible, the likeliest first; one where the rotation is known."""
    doubts: tuple[Doubt, ...] = ()
    """What is odd about the source."""


def approximate_from_world_file(
    world: WorldFile,
    interior: InteriorOrientation,
    camera: Camera,
    ground: Ground,
) -> Approximation:
    """The vertical photo that lies as the similarity part of a world file says.

    Args:
        world: World file of the scan.
        interior: Interior orientation of the scan.
        camera: Camera.
        ground: CRS and mean height.

    Raises:
        ScanError: The world file is mirrored and the scan is not, or the scan alone is.
        CrsError: Its coordinates cannot belong to the block's CRS.
    """
    if interior.mirrored and not world.mirrored:
        raise ScanError(
            world.path,
            "The scan shows the film from its back, and the georeference is not mirrored.",
            "Georeference the scan as it is, or turn it over.",
        )
    if world.mirrored and not interior.mirrored:
        raise ScanError(
            world.path,
            "The georeference is mirrored: the determinant of A, D, B, E is positive.",
            "Turn the scan over, or write the lines in the order A, D, B, E, C, F.",
        )
    placed = compose_affine(world.object_from_pixel, invert_affine(interior.film_from_pixel_matrix))
    _check_ground(placed, camera, ground, world.path)
    kappa, scale = rotation_and_scale(placed)
    exterior = _vertical(placed, kappa, scale, camera, ground=ground)
    prior = _prior("world-file", scale, camera)
    doubts = _affine_doubt(world.path.stem, placed)
    return Approximation(exterior, prior, "world-file", (exterior,), doubts)


def approximate_from_points(
    points: QgisPoints,
    interior: InteriorOrientation,
    camera: Camera,
    ground: Ground,
) -> Approximation:
    """The vertical photo that fits points clicked in QGIS, by a similarity from film to ground.

    Raises:
        ScanError: Fewer than two distinct enabled points.
        CrsError: Their coordinates cannot belong to the block's CRS.
    """
    plane = _in_block(points.plane[points.enabled], points.crs, ground.crs, points.path)
    film = interior.film_from_pixel(points.pixels[points.enabled])
    fit = fit_similarity(film, plane)
    if not isinstance(fit, PlaneTransform):
        raise ScanError(points.path, fit.reason, "Click two points or more, far apart, and save.")
    _check_ground(fit.matrix, camera, ground, points.path)
    kappa, scale = rotation_and_scale(fit.matrix)
    exterior = _vertical(fit.matrix, kappa, scale, camera, ground=ground)
    prior = _prior("points", scale, camera, place_m=max(TRUST["points"].place_m, 2 * fit.rms))
    return Approximation(exterior, prior, "points", (exterior,))


def approximate_from_footprint(
    footprint: Footprint,
    camera: Camera,
    ground: Ground,
) -> Approximation:
    """Vertical photos whose frame fills a footprint; its outline leaves kappa open by quarters.

    A square frame gives four hypotheses, an oblong one the two that lie along the footprint.
    """
    corners = footprint.corners
    sides = np.roll(corners, -1, axis=0) - corners
    lengths = np.linalg.norm(sides, axis=1)
    longest = sides[int(np.argmax(lengths))]
    width, height = camera.frame_mm
    along = float(np.arctan2(longest[1], longest[0]))
    square = abs(width - height) < SQUARE * max(width, height)
    if square:
        # Which of the four is meant nobody knows: the one nearest to north up comes first.
        first = float((along + np.pi / 4) % (np.pi / 2) - np.pi / 4)
        kappas = first + QUARTERS[[0, 2, 1, 3]]
    else:
        kappas = along + (0.0 if width > height else -np.pi / 2) + QUARTERS[[0, 2]]
    scale = float(np.sqrt(lengths[:2].prod() / (width * height)))
    middle = corners.mean(axis=0)
    check_place(middle, ground, footprint.path)
    hypotheses = tuple(_over(middle, float(kappa), scale, camera, ground) for kappa in kappas)
    prior = _prior("footprints", scale, camera)
    return Approximation(hypotheses[0], prior, "footprints", hypotheses)


def approximate_in_area(
    area: Bounds,
    scale_number: float,
    camera: Camera,
    ground: Ground,
) -> Approximation:
    """A vertical photo somewhere in an area, of any kappa: all that its scale number tells.

    Args:
        area: West, south, east, north of where it may lie, metres.
        scale_number: Flying height over principal distance, such as 15000 for 1 : 15 000.
        camera: Camera.
        ground: CRS and mean height.
    """
    west, south, east, north = area
    middle, scale = np.array([west + east, south + north]) / 2, scale_number / 1000
    hypotheses = tuple(_over(middle, float(k), scale, camera, ground) for k in QUARTERS)
    prior = _prior("area", scale, camera, place_m=max(east - west, north - south) / AREA_SIGMAS)
    return Approximation(hypotheses[0], prior, "area", hypotheses)


def approximate_from_eo(
    record: EoRecord,
    file: Path,
    ground: Ground,
    direction: float | None = None,
) -> Approximation:
    """The row of an EO list; a row without angles is a vertical photo of unknown kappa.

    Args:
        record: The row.
        file: The list, for messages.
        ground: CRS and mean height.
        direction: Direction of flight (radians from grid east, counter-clockwise) where it is
            known, see `flight_directions`: kappa is then one of four quarters from it.

    Raises:
        CrsError: The position cannot belong to the block's CRS.
        ProjectError: The camera would stand below the ground.
    """
    centre = np.array(record.centre)
    check_place(centre[:2], ground, file)
    if centre[2] <= ground.height_m:
        raise ProjectError(
            file,
            say(
                "Scan {scan} is said to be taken from {height:.0f} m, below the ground at "
                "{ground:.0f} m.",
                scan=record.scan,
                height=centre[2],
                ground=ground.height_m,
            ),
            "Check the column Z: it is the height of the perspective centre, not over ground.",
        )
    place = record.sigma_centre_m or LISTED[:1] * 3
    if record.angles is not None:
        exterior = ExteriorOrientation(centre, *record.angles)
        sigma = record.sigma_angles or LISTED[1:] * 3
        prior = ExteriorPrior(np.array(place), np.array(sigma))
        return Approximation(exterior, prior, "exterior", (exterior,))
    start = 0.0 if direction is None else direction
    kappas = start + QUARTERS[[0, 2, 1, 3]]
    hypotheses = tuple(ExteriorOrientation(centre, 0.0, 0.0, _wrap_angle(float(k))) for k in kappas)
    spread = TRUST["area"].kappa if direction is None else ALONG_STRIP
    angles = np.array([TILT, TILT, spread])
    return Approximation(
        hypotheses[0], ExteriorPrior(np.array(place), angles), "exterior", hypotheses
    )


def flight_directions(centres: Mapping[str, Position]) -> Mapping[str, float]:
    """Direction from each photo to its nearest neighbour, radians from grid east.

    Along a strip photos follow each other more closely than strips do (60 against 25 per cent
    overlap), so the nearest neighbour lies along the flight line, fore or aft.
    """
    names = list(centres)
    places = np.array([centres[name][:2] for name in names])
    directions: dict[str, float] = {}
    for i, name in enumerate(names):
        away = places - places[i]
        distance = np.linalg.norm(away, axis=1)
        distance[i] = np.inf
        nearest = int(np.argmin(distance))
        if len(names) > 1 and distance[nearest] > 0:
            directions[name] = float(np.arctan2(away[nearest, 1], away[nearest, 0]))
    return directions


def principal_point_on_ground(object_from_film: Affine2, camera: Camera) -> tuple[float, float]:
    """Easting and northing under the principal point, by a plane transform from film."""
    east, north = apply_affine(object_from_film, np.array([camera.principal_point_mm]))[0].tolist()
    return east, north


def world_file_centre(
    world: WorldFile, interior: InteriorOrientation, camera: Camera
) -> tuple[float, float]:
    """Easting and northing under the principal point, to look up the ground's height there."""
    film_to_object = compose_affine(
        world.object_from_pixel, invert_affine(interior.film_from_pixel_matrix)
    )
    return principal_point_on_ground(film_to_object, camera)


def _vertical(
    object_from_film: Affine2, kappa: float, scale: float, camera: Camera, *, ground: Ground
) -> ExteriorOrientation:
    """The vertical photo over the ground of its principal point."""
    middle = np.array(principal_point_on_ground(object_from_film, camera))
    return _over(middle, kappa, scale, camera, ground)


def _over(
    middle: np.ndarray, kappa: float, scale: float, camera: Camera, ground: Ground
) -> ExteriorOrientation:
    """The vertical photo over a place; scale in metres of ground per millimetre of film."""
    height = ground.height_m + scale * camera.principal_distance_mm
    return ExteriorOrientation(
        np.array([middle[0], middle[1], height]), 0.0, 0.0, _wrap_angle(kappa)
    )


def _wrap_angle(angle: float) -> float:
    """The same angle within -pi to pi."""
    return float((angle + np.pi) % (2 * np.pi) - np.pi)


def _prior(
    source: GeoreferenceSource, scale: float, camera: Camera, *, place_m: float | None = None
) -> ExteriorPrior:
    """Standard deviations of a near-vertical photo; scale in metres of ground per millimetre."""
    trust = TRUST[source]
    place = trust.place_m if place_m is None else place_m
    height = trust.height_share * scale * camera.principal_distance_mm
    return ExteriorPrior(np.array([place, place, height]), np.array([TILT, TILT, trust.kappa]))


def check_place(middle: np.ndarray, ground: Ground, file: Path) -> None:
    """Refuse a place that cannot be in the block's CRS, or lies far outside the DEM.

    Args:
        middle: Easting, northing, metres.
        ground: CRS and bounds.
        file: Where the place was read.
    """
    check_range(read_crs(ground.crs, file), middle[None], file)
    if ground.bounds is None:
        return
    low, high = np.array(ground.bounds[:2]), np.array(ground.bounds[2:])
    outside_m = float(np.linalg.norm(np.maximum(np.maximum(low - middle, middle - high), 0)))
    if outside_m > FAR_M:
        raise CrsError(
            file,
            say(
                "the position ({east:.0f}, {north:.0f}) lies {away:.0f} km outside the DEM, "
                "which covers E {west_edge:.0f} to {east_edge:.0f}, N {south_edge:.0f} to "
                "{north_edge:.0f}.",
                east=middle[0],
                north=middle[1],
                away=outside_m / 1000,
                west_edge=low[0],
                east_edge=high[0],
                south_edge=low[1],
                north_edge=high[1],
            ),
            "One of the two is misplaced: check the CRS, the signs and the order of the axes of "
            "both against `crs` in [block].",
        )


def _check_ground(object_from_film: Affine2, camera: Camera, ground: Ground, file: Path) -> None:
    """The place under the principal point must be possible."""
    check_place(np.array(principal_point_on_ground(object_from_film, camera)), ground, file)


def _in_block(plane: PlanePoints, crs: str, block_crs: str, file: Path) -> PlanePoints:
    """Points in the block's CRS; points that name none are taken to be in it."""
    if not crs or read_crs(crs, file) == read_crs(block_crs, file):
        return plane
    check_range(read_crs(crs, file), plane, file)
    return operation_between(crs, block_crs, plane, file).forward(plane)


def world_in_block(world: WorldFile, size_px: tuple[int, int], crs: str) -> WorldFile:
    """A scan's georeference in the block's CRS, as the affine of its corners.

    Raises:
        CrsError: Its coordinates cannot be in the CRS that it names, or there is no way from there.
    """
    columns, rows = (float(side) for side in size_px)
    pixels = np.array([[0.0, 0.0], [columns, 0.0], [columns, rows], [0.0, rows]])
    plane = apply_affine(world.object_from_pixel, pixels)
    own = horizontal(read_crs(world.crs, world.path)).to_wkt() if world.crs else crs
    if same_coordinates(own, crs, plane):
        return world
    fit = fit_affine(pixels, _in_block(plane, own, crs, world.path))
    assert isinstance(fit, PlaneTransform), "corners of a scan lie in no line"
    return replace(world, object_from_pixel=fit.matrix, crs=crs)


def _affine_doubt(photo_id: str, object_from_film: Affine2) -> tuple[Doubt, ...]:
    """A doubt when the world file stretches or shears the photo by more than five per cent."""
    large, small = np.linalg.svd(object_from_film[:, :2], compute_uv=False)
    stretch = float(large / small - 1)
    if stretch < SQUARE:
        return ()
    return (
        Doubt(
            "world-file-affine",
            photo_id,
            say(
                "The world file stretches the photo by {stretch:.0%}, more than tilt or "
                "relief do: it was fitted badly, or two of its lines are exchanged.",
                stretch=stretch,
            ),
            evidence={"stretch": stretch},
        ),
    )
