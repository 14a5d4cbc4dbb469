"""The tiny synthetic block that many tests share, opened at its true orientations."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from core.block import Block, Photo, TiePoints
from core.geometry.exterior import ExteriorOrientation
from core.matching.patches import OpenPhoto
from core.matching.reference import Reference
from core.raster.dem import Dem, open_dem
from core.raster.ortho import open_ortho
from core.raster.scan_file import ScanFile, open_scan
from core.synthetic.options import CRS
from core.synthetic.truth import Truth, read_truth
from sessions.decisions import Place
from sessions.session import Session

CHECK_POINTS = 6
CONTROL = '[control]\npoints = "points.csv"\n'
SURVEYOR = "surveyor"


@dataclass(frozen=True)
class Tiny:
    """A synthetic block's truth, its reference, and its photos as they truly stood."""

    folder: Path
    truth: Truth
    reference: Reference
    photos: dict[str, Photo]
    scans: dict[str, ScanFile]

    @property
    def names(self) -> list[str]:
        return sorted(self.photos)

    @property
    def block(self) -> Block:
        return Block(CRS, {self.truth.camera.name: self.truth.camera}, self.photos)

    def opened(self, name: str, exterior: ExteriorOrientation | None = None) -> OpenPhoto:
        """A photo with its scan, at its true orientation or another."""
        opened = OpenPhoto(self.photos[name], self.truth.camera, self.scans[name])
        return opened if exterior is None else opened.at(exterior)

    def archival(self) -> Reference:
        """The ground of the archival epoch as if it were that of today."""
        ortho = open_ortho([self.truth.archival_ortho], CRS)
        return Reference(ortho, self.reference.dem, 0.1, 0.2)


def open_tiny(folder: Path) -> Tiny:
    truth = read_truth(folder)
    ortho = open_ortho(sorted((folder / "ortho").glob("*.tif")), CRS)
    dem = open_dem([folder / "dem.tif"], CRS)
    dem = dem.cropped(dem.bounds)
    photos = {name: true_photo(truth, name, dem) for name in truth.photos}
    scans = {name: open_scan(photo.scan) for name, photo in photos.items()}
    return Tiny(folder, truth, Reference(ortho, dem, 0.25, 0.5), photos, scans)


def true_photo(truth: Truth, name: str, dem: Dem) -> Photo:
    return truth.photo(name, truth.folder / "scans" / f"{name}.tif", dem.mean_height())


def with_check_points(tiny: Tiny) -> None:
    """Give a block a list of check points, and measure each where its photos truly show it."""
    points = check_points(tiny)
    rows = [
        f"{name},{','.join(f'{value:.3f}' for value in place)},0.05,0.05,check"
        for name, place in points.items()
    ]
    text = "\n".join(["id,X,Y,Z,sigma_xy,sigma_z,role", *rows, ""])
    (tiny.folder / "points.csv").write_text(text, encoding="utf-8")
    with (tiny.folder / "block.toml").open("a", encoding="utf-8") as file:
        file.write(CONTROL)
    with Session.open(tiny.folder, SURVEYOR) as session:
        for place in placed(tiny, points):
            session.record(place)


def placed(tiny: Tiny, points: dict[str, np.ndarray]) -> list[Place]:
    """Points clicked by hand in all photos that show them, to a third of a pixel."""
    rng = np.random.default_rng(0)
    found = []
    for point_id, position in points.items():
        for name, photo in tiny.photos.items():
            pixel = photo.pixel_from_object(position[None], tiny.truth.camera)[0]
            if ((pixel > 60) & (pixel < np.array(photo.size_px) - 60)).all():
                column, row = pixel + rng.normal(0, 0.3, 2)
                found.append(Place(point_id, name, float(column), float(row)))
    return found


def check_points(tiny: Tiny) -> dict[str, np.ndarray]:
    """True ground in the middle of the block, on a lattice of two by three."""
    centres = np.array([photo.exterior.centre[:2] for photo in tiny.photos.values()])
    low, high = centres.min(axis=0), centres.max(axis=0)
    plan = [
        low + (high - low) * [(across + 0.5) / 3, (along + 0.5) / 2]
        for along in range(2)
        for across in range(3)
    ]
    flat = np.column_stack([np.array(plan), np.full(CHECK_POINTS, np.nan)])
    flat[:, 2] = tiny.truth.heights_at(flat)
    return {f"CHK{number}": place for number, place in enumerate(flat, start=1)}


def ground_over(tiny: Tiny, count: int = 24) -> np.ndarray:
    """True ground on a lattice over the whole block."""
    centres = np.array([photo.exterior.centre[:2] for photo in tiny.photos.values()])
    low, high = centres.min(axis=0) - 300, centres.max(axis=0) + 300
    plan = np.stack(np.meshgrid(*np.linspace(low, high, count).T), axis=-1).reshape(-1, 2)
    flat = np.column_stack([plan, np.full(len(plan), 0.0)])
    flat[:, 2] = tiny.truth.heights_at(flat)
    return flat


def true_ties(tiny: Tiny, noise_px: float = 0.3) -> TiePoints:
    """Ground seen by two photos or more, measured where it truly shows."""
    ground, rng = ground_over(tiny), np.random.default_rng(0)
    rays = []
    for index, name in enumerate(tiny.names):
        photo = tiny.photos[name]
        pixels = photo.pixel_from_object(ground, tiny.truth.camera)
        inside = ((pixels > 60) & (pixels < np.array(photo.size_px) - 60)).all(axis=1)
        rays += [(int(point), index, *pixels[point]) for point in np.flatnonzero(inside)]
    rays = np.array(sorted(rays))
    _, inverse, seen = np.unique(rays[:, 0], return_inverse=True, return_counts=True)
    rays = rays[seen[inverse] >= 2]
    point = np.unique(rays[:, 0], return_inverse=True)[1]
    pixels = rays[:, 2:] + rng.normal(size=(len(rays), 2)) * noise_px
    return TiePoints(
        tuple(tiny.names), point, rays[:, 1].astype(int), pixels, np.full(len(rays), 0.5)
    )
