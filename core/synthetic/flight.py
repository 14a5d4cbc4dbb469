"""The flight: a camera, its exposures over the terrain, and each film as it lay in the scanner."""

from dataclasses import dataclass

import numpy as np

from core.arrays import Affine2, FilmPoints, ObjectPoints, PixelPoints, Scalars, locked
from core.geometry.camera import Camera
from core.geometry.collinearity import (
    Atmosphere,
    atmosphere_of,
    film_from_object,
    object_from_film,
    object_on_rays,
    rays_from_film,
)
from core.geometry.exterior import ExteriorOrientation
from core.synthetic.options import Scale, SyntheticOptions, seeded
from core.synthetic.random_surfaces import Bounds, Terrain, make_terrain

FRAME_MM = 180.0
SCAN_MM = 194.0
"""Width of the scanned area: the frame and some margin."""
FORWARD, SIDE = 0.4, 0.72
"""Photos of a strip, and strips, are about so far apart, in sides of a photo."""
SHEET = "SYNT25"


@dataclass(frozen=True, slots=True, eq=False)
class Exposure:
    """One photo with everything that is true of it."""

    photo_id: str
    """Name of the scan without extension."""
    exterior: ExteriorOrientation
    """The true exterior orientation."""
    pixel_from_film: Affine2
    """How film millimetres came to lie in scan pixels (corner origin)."""
    size_px: tuple[int, int]
    """Columns and rows of the scan."""
    atmosphere: Atmosphere
    """The true refraction and Earth curvature."""

    def pixels(self, film: FilmPoints) -> PixelPoints:
        """Scan pixels of film points."""
        return film @ self.pixel_from_film[:, :2].T + self.pixel_from_film[:, 2]

    def film(self, pixels: PixelPoints) -> FilmPoints:
        """Film points, millimetres, of scan pixels."""
        turn, shift = self.pixel_from_film[:, :2], self.pixel_from_film[:, 2]
        return np.linalg.solve(turn, (pixels - shift).T).T

    def pixel_from_object(self, points: ObjectPoints, camera: Camera) -> PixelPoints:
        """Scan pixels of object points, everything applied."""
        return self.pixels(film_from_object(points, self.exterior, camera, self.atmosphere))

    def object_from_pixel(
        self, pixels: PixelPoints, heights: Scalars, camera: Camera
    ) -> ObjectPoints:
        """Object points at given heights (metres) on the rays of scan pixels."""
        film = self.film(pixels)
        return object_from_film(film, heights, self.exterior, camera, self.atmosphere)

    def ground_from_pixel(
        self, pixels: PixelPoints, terrain: Terrain, camera: Camera
    ) -> ObjectPoints:
        """Where the rays of scan pixels meet the terrain, to a tenth of a millimetre."""
        rays = rays_from_film(self.film(pixels), self.exterior, camera, self.atmosphere)
        heights = np.full(len(pixels), float(np.mean(terrain.coefficients)))
        for _ in range(40):
            ground = object_on_rays(rays, heights, self.exterior, self.atmosphere)
            fresh = terrain.heights(ground[:, :2])
            step = float(np.max(np.abs(fresh - heights), initial=0.0))
            heights = fresh
            if step < 1e-4:
                break
        return object_on_rays(rays, heights, self.exterior, self.atmosphere)


@dataclass(frozen=True, slots=True, eq=False)
class Flight:
    """All exposures of a block, and the two cameras: the true one and the one on paper."""

    camera: Camera
    """The camera as it was."""
    nominal: Camera
    """The camera as its user knows it: principal distance on the margin, certified fiducials."""
    exposures: tuple[Exposure, ...]
    """In the order of their numbers."""
    terrain: Terrain
    """The ground below, far beyond the photos."""
    bounds: Bounds
    """What the photos can show of it, west, south, east, north, metres."""


def make_flight(options: SyntheticOptions, place: int | None = None) -> Flight:
    """A flight of strips in alternate directions over a terrain.

    Args:
        options: What is wanted: size, epoch, relief, seed, strips and photos.
        place: Seed of the place; None: that of the options.

    Returns:
        The flight with the terrain it was flown over.
    """
    scale = options.scale
    camera, nominal = _cameras(options)
    side = FRAME_MM * 1000.0 / scale.scan_pixel_um * scale.scan_ground_m
    place = options.seed if place is None else place
    middle = _middle(place)
    half = max((options.photos_per_strip - 1) * FORWARD, (options.strips - 1) * SIDE) / 2
    reach = (1.5 + half) * side + 500.0
    box = (middle[0] - reach, middle[1] - reach, middle[0] + reach, middle[1] + reach)
    terrain = make_terrain(box, options.relief_m, seeded(place, "terrain"))
    exposures = _exposures(options, scale, camera, terrain, place=(side, *middle))
    return Flight(camera, nominal, exposures, terrain, _seen(exposures, camera, terrain))


def _middle(seed: int) -> tuple[float, float]:
    """Somewhere in southern Moravia, EPSG:5514."""
    rng = seeded(seed, "place")
    east, north = rng.uniform((-588000.0, -1199000.0), (-574000.0, -1187000.0))
    return float(round(east, -1)), float(round(north, -1))


def _cameras(options: SyntheticOptions) -> tuple[Camera, Camera]:
    """The true camera and what is known of it."""
    rng = seeded(options.seed, "camera")
    recent = options.recency >= 0.5
    certified = 151.92 if recent else 211.59
    if recent:
        places = {"1": (-84, 84), "2": (84, 84), "3": (84, -84), "4": (-84, -84)}
    else:
        places = {"1": (-85.5, 0), "2": (85.5, 0), "3": (0, 85.5), "4": (0, -85.5)}
    fiducials = {
        name: (
            float(np.round(x + rng.uniform(-0.2, 0.2), 3)),
            float(np.round(y + rng.uniform(-0.2, 0.2), 3)),
        )
        for name, (x, y) in places.items()
    }
    nominal = Camera("archive", certified, (FRAME_MM, FRAME_MM), fiducials_mm=fiducials)
    size, turn = rng.uniform(0.02, 0.08), rng.uniform(0, 2 * np.pi)
    # The distortion is balanced: it returns through nought at two thirds of the corner's radius.
    corner = FRAME_MM / np.sqrt(2.0)
    bend = rng.uniform(0.015, 0.04) * rng.choice([-1.0, 1.0]) / corner
    zero = (0.62 * corner) ** 2
    k2 = bend / (corner**4 - zero * corner**2)
    return (
        nominal.with_constants(
            certified + float(rng.uniform(-0.02, 0.02)),
            (float(size * np.cos(turn)), float(size * np.sin(turn))),
            (float(-k2 * zero), float(k2), 0.0),
        ),
        nominal,
    )


def _exposures(
    options: SyntheticOptions,
    scale: Scale,
    camera: Camera,
    terrain: Terrain,
    *,
    place: tuple[float, float, float],
) -> tuple[Exposure, ...]:
    """Strips with 60 per cent forward, 25 to 30 per cent side overlap."""
    strips, photos = options.strips, options.photos_per_strip
    rng = seeded(options.seed, "flight")
    side, east, north = place
    mean = float(np.median(terrain.coefficients))
    height = mean + camera.principal_distance_mm * scale.scan_ground_m / scale.scan_pixel_um * 1e3
    heading = float(rng.normal(0.0, np.radians(3.0)))
    along = np.array([np.cos(heading), np.sin(heading)])
    across = np.array([along[1], -along[0]])
    overlap = float(rng.uniform(0.26, 0.29))
    first = int(rng.integers(100, 800))
    exposures: list[Exposure] = []
    for strip in range(strips):
        back = strip % 2 == 1
        for photo in range(photos):
            step = (photo - (photos - 1) / 2) * FORWARD * side * (-1.0 if back else 1.0)
            apart = (strip - (strips - 1) / 2) * (1.0 - overlap) * side
            plan = np.array([east, north]) + along * step + across * apart
            plan += rng.normal(0.0, 0.008 * side, 2)
            centre = np.array([*plan, height * (1 + rng.normal(0.0, 0.003))])
            tilts = np.clip(rng.normal(0.0, 1.0, 2), -2.6, 2.6)
            kappa = heading + (np.pi if back else 0.0) + np.radians(rng.normal(0.0, 1.8))
            kappa = float((kappa + np.pi) % (2 * np.pi) - np.pi)
            exterior = ExteriorOrientation(
                centre, float(np.radians(tilts[0])), float(np.radians(tilts[1])), kappa
            )
            number = first + photo + 30 * strip
            exposures.append(_in_scanner(options, scale, exterior, number, ground_m=mean))
    return tuple(exposures)


def _in_scanner(
    options: SyntheticOptions,
    scale: Scale,
    exterior: ExteriorOrientation,
    number: int,
    *,
    ground_m: float,
) -> Exposure:
    """The film on the glass: turned, shifted, shrunk along and across, sheared."""
    rng = seeded(options.seed, "scanner", number)
    pixel_mm = scale.scan_pixel_um / 1000.0
    size = round(SCAN_MM / pixel_mm)
    turn = np.radians(rng.uniform(-0.5, 0.5))
    shrink = 1.0 - rng.uniform(1e-4, 5e-4, 2)
    shear = rng.normal(0.0, 8e-5)
    film = np.array([[shrink[0], shear], [shear, shrink[1]]])
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    linear = np.diag([1.0, -1.0]) @ rotation @ film / pixel_mm
    shift = size / 2 + rng.uniform(-1.2, 1.2, 2) / pixel_mm
    return Exposure(
        f"LMSA08.{options.epoch}.{SHEET}.{number:05d}",
        exterior,
        locked(np.column_stack([linear, shift])),
        (size, size),
        atmosphere_of(float(exterior.centre[2]), ground_m),
    )


def _seen(exposures: tuple[Exposure, ...], camera: Camera, terrain: Terrain) -> Bounds:
    """Bounds, on even metres, of all that the frames can show of the terrain."""
    corners = camera.frame_corners_mm * 1.01
    edges = np.vstack([corners + (np.roll(corners, 1, axis=0) - corners) * t for t in (0, 0.5)])
    ground = np.vstack([e.ground_from_pixel(e.pixels(edges), terrain, camera) for e in exposures])
    low, high = ground[:, :2].min(axis=0) - 40.0, ground[:, :2].max(axis=0) + 40.0
    west, south = np.floor(low / 8.0) * 8.0
    east, north = np.ceil(high / 8.0) * 8.0
    return float(west), float(south), float(east), float(north)
