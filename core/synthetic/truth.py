"""The truth of a synthetic block, and how far measurements and orientations are from it."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from scipy import ndimage

from core.arrays import Affine2, ObjectPoints, PixelPoints, Scalars, locked
from core.block import Block, ExteriorPrior, Measurement, Photo
from core.errors import ReferenceDataError
from core.geometry.camera import Camera
from core.geometry.collinearity import EARTH_RADIUS_M, Atmosphere
from core.geometry.exterior import ExteriorOrientation
from core.geometry.interior import InteriorOrientation
from core.geometry.transforms import invert_affine
from core.raster.grid import Grid
from core.synthetic.flight import Exposure, Flight
from core.synthetic.network import Network
from core.synthetic.options import CRS, SyntheticOptions
from core.synthetic.random_surfaces import PlanPoints

WRONG_M = 3.0
"""A control measurement further than this from the true place, on the ground, is wrong."""

TRUE_WITHIN = ExteriorPrior(np.full(3, 10.0), np.full(3, 0.01))
"""What the archive would say of a photo, metres and radians."""


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """What is true of a block, whoever made it."""

    folder: Path
    """The block's folder."""
    camera: Camera
    """The true camera; its fiducials are where the certificate says."""
    scan_pixel_um: float
    """Nominal scan pixel on the film, micrometres."""
    photos: Mapping[str, Exposure]
    """True orientations by photo."""
    archival_ortho: Path
    """The true ground of the archival epoch, a GeoTIFF."""
    heights: tuple[Grid, np.ndarray] | None
    """True heights on a grid where they were written, else None."""
    lasting_junctions: PlanPoints | None
    """Junctions that stood when the photos were taken and still stand; None where not known."""

    def heights_at(self, points: ObjectPoints) -> Scalars:
        """True height below points, metres; their own height where the truth does not know."""
        if self.heights is None:
            return points[:, 2].copy()
        grid, heights = self.heights
        place = grid.grid_from_object(points[:, :2]) - 0.5
        true = ndimage.map_coordinates(heights, place.T[::-1], order=1, cval=np.nan)
        return np.where(np.isfinite(true), true, points[:, 2])

    def photo(self, name: str, scan: Path, ground_height_m: float) -> Photo:
        """A photo in its true orientation over mean ground of a height."""
        true = self.photos[name]
        none = np.zeros((0, 2))
        matrix = invert_affine(true.pixel_from_film)
        return Photo(
            name,
            scan,
            true.size_px,
            self.camera.name,
            InteriorOrientation("affine", matrix, (), none, none, float("nan")),
            true.exterior,
            true.exterior,
            TRUE_WITHIN,
            ground_height_m,
            oriented=True,
        )

    def ground_of(self, photo_id: str, pixels: PixelPoints, heights: Scalars) -> PlanPoints:
        """Easting and northing that a photo's pixels truly show at given heights, metres."""
        return self.photos[photo_id].object_from_pixel(pixels, heights, self.camera)[:, :2]


@dataclass(frozen=True, slots=True, eq=False)
class ControlJudgement:
    """The used control measurements of a block against the truth."""

    used: int
    """Control measurements in use that could be judged."""
    wrong: int
    """Those more than 3 m from the true place on the ground."""
    wrong_share: float
    """wrong / used, 0 without any."""
    rms_m: float
    """Root mean square distance of the right ones on the ground, metres; NaN without any."""
    distances_m: Mapping[tuple[str, str], float]
    """Distance of every one by (point, photo), metres."""


@dataclass(frozen=True, slots=True, eq=False)
class OrientationJudgement:
    """The orientations of a block's photos against the truth, estimated minus true."""

    photo_ids: tuple[str, ...]
    """Photos that were judged, in the order of the arrays."""
    centre_m: ObjectPoints
    """Differences of the perspective centres (E, N, H), metres."""
    angles_deg: ObjectPoints
    """Differences of omega, phi, kappa, degrees."""
    ground_m: Scalars
    """Root mean square displacement on the ground over the frame, metres: what remains when
    errors of orientation, principal distance and interior orientation balance each other."""


def read_truth(folder: Path) -> Truth:
    """The truth of a synthetic block.

    Args:
        folder: The block's folder, which holds `truth/truth.json`.

    Returns:
        The truth; photos by name.

    Raises:
        ReferenceDataError: There is no truth to read, or it is not of this form.
    """
    path = folder / "truth" / "truth.json"
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        camera = _camera(data)
        photos = {name: _photo(name, eo, data) for name, eo in data["eo"].items()}
        pixel_um = float(data["scan_um"])
        known = data.get("lasting_junctions")
        lasting = None if known is None else np.array(known, dtype=np.float64).reshape(-1, 2)
    except FileNotFoundError as error:
        raise ReferenceDataError(
            path, "There is no truth.", "Only synthetic blocks have one; see `gruber demo`."
        ) from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise ReferenceDataError(
            path, f"This truth cannot be read ({error}).", "Make the block again."
        ) from error
    heights = _heights(folder / "truth" / "terrain.tif")
    ortho = folder / "truth" / "archival_ortho.tif"
    return Truth(folder, camera, pixel_um, dict(sorted(photos.items())), ortho, heights, lasting)


def _camera(data: Mapping[str, Any]) -> Camera:
    known = data["camera"]
    k1, k2, k3 = [*(float(k) for k in known["k"]), 0.0, 0.0, 0.0][:3]
    side = 2.0 * float(known["half_mm"])
    return Camera(
        "true",
        float(known["focal_mm"]),
        (side, side),
        (float(known["pp"][0]), float(known["pp"][1])),
        (k1, k2, k3),
        {name: (float(x), float(y)) for name, (x, y) in known["fiducials"].items()},
    )


def _photo(name: str, eo: Mapping[str, Any], data: Mapping[str, Any]) -> Exposure:
    """One photo; `film_to_pixel` counts from the centre of the first pixel, we from its corner."""
    to_pixel: Affine2 = np.array(eo["film_to_pixel"], dtype=np.float64)
    to_pixel[:, 2] += 0.5
    centre = np.array([eo["X"], eo["Y"], eo["Z"]], dtype=np.float64)
    angles = [float(np.radians(eo[f"{axis}_deg"])) for axis in ("omega", "phi", "kappa")]
    atmosphere = Atmosphere(
        float(eo.get("refraction_K", data["refraction_K"])),
        float(data.get("curvature_per_m", 1.0 / (2.0 * EARTH_RADIUS_M))),
    )
    # Without a size: a scan shows the film about its middle.
    size = eo.get("size_px", np.round(2.0 * to_pixel[:, 2]).astype(int))
    return Exposure(
        name,
        ExteriorOrientation(centre, *angles),
        locked(to_pixel),
        (int(size[0]), int(size[1])),
        atmosphere,
    )


def _heights(path: Path) -> tuple[Grid, np.ndarray] | None:
    if not path.is_file():
        return None
    with rasterio.open(path) as raster:
        west, north, gsd = raster.transform.c, raster.transform.f, raster.transform.a
        grid = Grid(float(west), float(north), float(gsd), int(raster.width), int(raster.height))
        return grid, raster.read(1).astype(np.float64)


def write_truth(folder: Path, flight: Flight, network: Network, options: SyntheticOptions) -> None:
    """Everything that is true of a flight, as `read_truth` reads it.

    Args:
        folder: The block's folder, which holds `truth/`.
        flight: The true flight.
        network: Roads of both epochs.
        options: What the block was made with.
    """
    camera, scale = flight.camera, options.scale
    photos: dict[str, Any] = {}
    for exposure in flight.exposures:
        true = exposure.exterior
        to_pixel = np.array(exposure.pixel_from_film)
        to_pixel[:, 2] -= 0.5
        photos[exposure.photo_id] = {
            "X": float(true.centre[0]),
            "Y": float(true.centre[1]),
            "Z": float(true.centre[2]),
            "omega_deg": float(np.degrees(true.omega)),
            "phi_deg": float(np.degrees(true.phi)),
            "kappa_deg": float(np.degrees(true.kappa)),
            "refraction_K": exposure.atmosphere.refraction,
            "size_px": list(exposure.size_px),
            "film_to_pixel": to_pixel.tolist(),
        }
    refraction = float(np.mean([e.atmosphere.refraction for e in flight.exposures]))
    truth = {
        "camera": {
            "focal_mm": camera.principal_distance_mm,
            "half_mm": camera.frame_mm[0] / 2,
            "pp": list(camera.principal_point_mm),
            "k": list(camera.radial_distortion[:2]),
            "fiducials": {name: list(place) for name, place in camera.fiducials_mm.items()},
        },
        "nominal_focal_mm": flight.nominal.principal_distance_mm,
        "refraction_K": refraction,
        "curvature_per_m": flight.exposures[0].atmosphere.curvature_per_m,
        "scan_um": scale.scan_pixel_um,
        "pixel_origin": "centre of the first pixel",
        "crs": CRS,
        "eo": photos,
        "lasting_junctions": network.lasting_junctions().tolist(),
        "args": asdict(options),
        "gsd_scan": scale.scan_ground_m,
    }
    text = json.dumps(truth, indent=1) + "\n"
    (folder / "truth" / "truth.json").write_text(text, encoding="utf-8")


def judge_control(truth: Truth, block: Block) -> ControlJudgement:
    """How many control measurements in use are wrong.

    A measurement is wrong when its pixel truly shows ground more than 3 m from the surveyed
    point's easting and northing, at the true height there.

    Args:
        truth: The truth of the block.
        block: The block with its measurements; check points are left out.

    Returns:
        Counts, share and distances.
    """
    distances: dict[tuple[str, str], float] = {}
    for key, measurement in block.measurements.items():
        if _judgeable(truth, block, measurement):
            away = _distance(truth, block, measurement)
            if np.isfinite(away):
                distances[key] = away
    values = np.array(list(distances.values()), dtype=np.float64)
    right = values[values <= WRONG_M]
    wrong = len(values) - len(right)
    return ControlJudgement(
        used=len(values),
        wrong=wrong,
        wrong_share=wrong / len(values) if len(values) else 0.0,
        rms_m=float(np.sqrt(np.mean(right**2))) if len(right) else float("nan"),
        distances_m=distances,
    )


def _judgeable(truth: Truth, block: Block, measurement: Measurement) -> bool:
    point = block.surveyed.get(measurement.point_id)
    known = measurement.photo_id in truth.photos
    return measurement.used and known and point is not None and point.role == "control"


def _distance(truth: Truth, block: Block, measurement: Measurement) -> float:
    """Distance on the ground, metres, between what is shown and what should be."""
    point = np.array([block.surveyed[measurement.point_id].position])
    heights = truth.heights_at(point)
    shown = truth.ground_of(measurement.photo_id, measurement.pixel, heights)
    return float(np.linalg.norm(shown - point[:, :2]))


def judge_orientations(truth: Truth, block: Block) -> OrientationJudgement:
    """How far the block's oriented photos are from the truth.

    Args:
        truth: The truth of the block.
        block: The block; photos that are not oriented are left out.

    Returns:
        Differences of orientation, and what they do on the ground.
    """
    names = [p for p, photo in block.photos.items() if photo.oriented and p in truth.photos]
    centre, angles, ground = np.zeros((len(names), 3)), np.zeros((len(names), 3)), []
    for row, name in enumerate(names):
        photo, true = block.photos[name], truth.photos[name].exterior
        centre[row] = photo.exterior.centre - true.centre
        turn = np.array(
            [
                photo.exterior.omega - true.omega,
                photo.exterior.phi - true.phi,
                photo.exterior.kappa - true.kappa,
            ]
        )
        angles[row] = np.degrees((turn + np.pi) % (2 * np.pi) - np.pi)
        ground.append(_displacement(truth, photo, block.camera_of(name)))
    return OrientationJudgement(
        tuple(names), locked(centre), locked(angles), locked(np.array(ground, dtype=np.float64))
    )


def _displacement(truth: Truth, photo: Photo, camera: Camera) -> float:
    """RMS over a lattice of the frame: true ground under a pixel against the photo's opinion."""
    half = np.array(truth.camera.frame_mm) / 2 * 0.9
    x, y = np.meshgrid(np.linspace(-half[0], half[0], 9), np.linspace(-half[1], half[1], 9))
    exposure = truth.photos[photo.photo_id]
    pixels = exposure.pixels(np.column_stack([x.ravel(), y.ravel()]))
    heights = np.full(len(pixels), photo.ground_height_m)
    for _ in range(6):
        place = exposure.object_from_pixel(pixels, heights, truth.camera)
        heights = truth.heights_at(place)
    true = truth.ground_of(photo.photo_id, pixels, heights)
    found = photo.object_from_pixel(pixels, heights, camera)[:, :2]
    return float(np.sqrt(np.mean(np.sum((found - true) ** 2, axis=1))))
