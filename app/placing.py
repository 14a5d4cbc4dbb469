"""The placing page: two clicks in one photo for a block that could not be localised."""

import secrets
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from app.project import Project, described
from app.running import Running
from core.block import Block, ExteriorPrior, Photo, footprint
from core.doubts import Failure
from core.errors import PhotogrammetryError, ProjectError, ScanError
from core.formats.qgis_points import (
    QgisPoints,
    find_qgis_points,
    read_scan_points,
    write_qgis_points,
)
from core.geometry.camera import Camera
from core.geometry.crs import operation_between, read_crs
from core.geometry.exterior import ExteriorOrientation
from core.geometry.interior import InteriorOrientation
from core.geometry.transforms import PlaneTransform, fit_affine, fit_similarity, rotation_and_scale
from core.georeference.stage import Georeferenced
from core.matching.reference import Reference, open_reference
from core.raster.scan_file import ScanFiles
from core.results import BlockInput
from core.said import say
from core.scans.interior_orientation import ScanOrientation
from core.scans.stage import ScanSet
from sessions.atomic_write import clean_leftovers, whole_file
from sessions.session import HIDDEN, Session
from ui.review.compare import DrawnPhoto
from ui.review.looks import page_palette
from ui.review.placement import NOWHERE
from ui.review.tiles import Lattice, OrthoSource
from ui.web.access import Access, Door, lasting_token
from ui.web.front import Front, FrontInputs, Opened
from ui.web.placing import Pair, placing_routes
from ui.web.running import Leaving
from ui.web.tiles import Sources, TileStore

FINEST_SHARE = 0.5
"""Finest tiles of the ortho, as a share of its own pixel."""


@dataclass(frozen=True, slots=True, eq=False)
class Placeable:
    """A block with scans that could be oriented inside, and nothing that stands on the ground."""

    given: BlockInput
    """The block as its owner describes it."""
    scans: ScanSet
    """Its scans."""
    reference: Reference
    """Ortho and heights."""
    placed: Block | None = None
    """Photos where the archive's georeference puts them."""
    nowhere: frozenset[str] = frozenset()
    """Photos of which it says nothing."""


def placeable(project: Project, session: Session) -> Placeable | None:
    """What the placing page shows; None for a block that has control points to review.

    Raises:
        ProjectError: The block has not been run as far as its scans.
    """
    if session.products.latest_value("control") is not None:
        return None
    scans = cast("ScanSet | None", session.products.latest_value("scans"))
    if scans is None or not project.reference.ortho:
        # Without an ortho there is nothing to click beside a photo: the run goes through.
        raise ProjectError(
            project.file,
            "the block has no control points to review yet.",
            say("Run it first: gruber run {folder}", folder=project.folder),
        )
    given = described(project)
    placed = cast("Georeferenced | None", session.products.latest_value("georeference"))
    if placed is None:
        return Placeable(given, scans, open_reference(given.reference))
    nowhere = {n for n, one in placed.approximations.items() if one.source in NOWHERE}
    return Placeable(
        given, scans, open_reference(given.reference), placed.block, frozenset(nowhere)
    )


def standing_block(
    given: BlockInput, session: Session, reference: Reference, placed: Georeferenced
) -> Placeable | None:
    """Any photo of a block that was run, to be placed anew; None without scans or ortho."""
    scans = cast("ScanSet | None", session.products.latest_value("scans"))
    if scans is None or not given.reference.ortho:
        return None
    return Placeable(given, scans, reference, placed.block)


class Placing(Opened):
    """An open placing page."""

    def __init__(self, front: Front, running: Running, tiles: TileStore, leaving: Leaving) -> None:
        super().__init__(front)
        self._running, self._tiles, self.leaving = running, tiles, leaving

    def wait(self) -> bool:
        """True when a run from the page has gone through, False when settings are asked for.

        Ctrl-C passes through.
        """
        while not self._running.gone_through.wait(timeout=0.3):
            if self.leaving.asked.is_set():
                return False
        return True

    def close(self) -> None:
        """Close the port and stop the run."""
        self._running.close()
        super().close()
        self._tiles.close()


def open_placing(
    project: Project, found: Placeable, door: Door, language: str = "", token: str = ""
) -> Placing:
    """Open the placing page of a block.

    Raises:
        PhotogrammetryError: The port cannot be had.
    """
    ortho, dem = found.reference.ortho, found.reference.dem
    lattice = Lattice.over(ortho.bounds, FINEST_SHARE * ortho.ground_sample_distance_m)
    tiles = TileStore(Sources(ortho, dem, ScanFiles(project.folder), lattice))
    drawn = {
        name: drawn_raw(scan.scan.path, scan.size_px) for name, scan in found.scans.oriented.items()
    }
    tiles.publish(drawn)
    access = Access(door, token or lasting_token(project.folder / HIDDEN))
    running = Running(project.file)
    clicking = Clicking(found, running)
    start = _start(project, lattice, ortho)
    leaving = Leaving()
    served = FrontInputs(
        access, None, tiles, None, start, page="placing.html", told=clicking.photos,
        routes=(*placing_routes(clicking), leaving.route()), language=language,
    )  # fmt: skip
    opened = Placing(Front(served), running, tiles, leaving)
    opened.listen()
    return opened


class Clicking:
    """Pairs of points, judged and written; satisfies `ui.web.placing.Placer`."""

    def __init__(self, found: Placeable, running: Running) -> None:
        self._found, self._running = found, running
        self._lock = threading.Lock()
        for folder in {scan.scan.path.parent for scan in found.scans.oriented.values()}:
            clean_leftovers(folder)
        self.start_run, self.cancel_run = running.start, running.cancel
        self.status: Callable[[], dict[str, Any]] = running.status

    def photos(self) -> dict[str, Any]:
        """All scans, with the points that were clicked before."""
        return {"scans": [self._photo(name) for name in self._found.scans.oriented]}

    def fitted(self, photo_id: str, pairs: list[Pair]) -> dict[str, Any]:
        """Residuals of a similarity and an affinity, metres; matrices from pixel to ground."""
        scan = self._scan(photo_id)
        values = np.array(pairs, dtype=np.float64).reshape(-1, 4)
        if len(values) < 2:
            return {"count": len(values)}
        fit = fit_similarity(values[:, :2], values[:, 2:], mirrored=True)
        if isinstance(fit, Failure):
            return {"count": len(values), "why": fit.reason}
        turn, _ = rotation_and_scale(fit.matrix, mirrored=True)
        affine = fit_affine(values[:, :2], values[:, 2:])
        return {
            "count": len(values),
            **_told(fit),
            "affine": None if isinstance(affine, Failure) else _told(affine),
            "pixel_m": round(fit.scale, 4),
            "scale": round(1000 * fit.scale / scan.interior.pixel_size_mm, -1),
            "turn_deg": round(float(np.degrees(turn)), 1),
        }

    def checked(self, photo_id: str, pairs: list[Pair]) -> dict[str, Any]:
        """As `fitted`, of pairs that can be kept.

        Raises:
            ScanError: A single pair, or pairs at one place.
        """
        fit = self.fitted(photo_id, pairs)
        if pairs and "matrix" not in fit:
            raise ScanError(
                self._scan(photo_id).scan.path,
                str(fit.get("why", "One pair is too few.")),
                "Click two places or more, far apart.",
            )
        return fit

    def save(self, photo_id: str, pairs: list[Pair], seat_id: str = "") -> dict[str, Any]:
        """Write the `.points` file beside the scan, whole; remove it once it would be empty.

        Raises:
            ScanError: A single pair, pairs at one place, or a file that cannot be read: it may hold
                what somebody clicked elsewhere, so it is not written over.
        """
        oriented, fit = self._scan(photo_id), self.checked(photo_id, pairs)
        with self._lock:
            scan = oriented.scan.path
            path = find_qgis_points(scan) or scan.with_name(scan.name + ".points")
            off = self._switched_off(path, oriented)
            if not pairs and not len(off.plane):
                path.unlink(missing_ok=True)
                return {**fit, "saved": ""}
            values = np.array(pairs, dtype=np.float64).reshape(-1, 4)
            plane = np.vstack([values[:, 2:], off.plane])
            pixels = np.vstack([values[:, :2], off.pixels])
            enabled = np.arange(len(plane)) < len(values)
            points = QgisPoints(path, self._found.given.crs, plane, pixels, enabled)
            with whole_file(path) as temporary:
                write_qgis_points(temporary, points)
        return {**fit, "saved": path.name}

    def _switched_off(self, path: Path, scan: ScanOrientation) -> QgisPoints:
        """Points of the file that somebody switched off in QGIS: they stay, switched off.

        Raises:
            ScanError: The file holds something that cannot be read.
        """
        none = np.zeros((0, 2))
        if not path.exists() or not path.read_bytes().strip():
            return QgisPoints(path, "", none, none, np.zeros(0, dtype=np.bool_))
        try:
            read = read_scan_points(path, scan.scan.path, scan.size_px)
            points = in_crs(read, self._found.given.crs)
        except PhotogrammetryError as error:
            raise ScanError(
                path,
                say("It cannot be read, and is not written over. {cause}", cause=error.cause),
                "Rename it or repair it in QGIS, then save again.",
            ) from error
        off = ~points.enabled
        return replace(
            points, plane=points.plane[off], pixels=points.pixels[off], enabled=points.enabled[off]
        )

    def _scan(self, photo_id: str) -> ScanOrientation:
        scan = self._found.scans.oriented.get(photo_id)
        if scan is None:
            raise ScanError(photo_id, "is no scan of this block.", "Open the page again.")
        return scan

    def _photo(self, name: str) -> dict[str, Any]:
        """One scan for the page: its size, what was clicked, and where it was said to lie."""
        scan, block = self._found.scans.oriented[name], self._found.placed
        clicked, why = self._clicked(scan)
        known: dict[str, Any] | None = None
        if block is not None and name in block.photos and name not in self._found.nowhere:
            photo, camera = block.photos[name], block.camera_of(name)
            middle = footprint(photo, camera).centroid
            height = float(photo.exterior.centre[2]) - photo.ground_height_m
            pixel = photo.interior.pixel_size_mm * height / camera.principal_distance_mm
            known = {"east": round(middle.x, 1), "north": round(middle.y, 1), "pixel": pixel}
        return {
            "photo": name, "size": list(scan.size_px), "version": 1, "pairs": clicked,
            "why": why, "known": known,
        }  # fmt: skip

    def _clicked(self, scan: ScanOrientation) -> tuple[list[list[float]], str]:
        """Pairs of the file beside a scan, in the block's CRS; a word where it cannot be read."""
        path = find_qgis_points(scan.scan.path)
        if path is None:
            return [], ""
        try:
            read = read_scan_points(path, scan.scan.path, scan.size_px)
            points = in_crs(read, self._found.given.crs)
        except PhotogrammetryError as error:
            return [], error.told
        chosen = points.enabled
        pairs = np.column_stack([points.pixels[chosen], points.plane[chosen]])
        return np.round(pairs, 3).tolist(), ""


def _told(fit: PlaneTransform) -> dict[str, Any]:
    """Matrix and residuals of a transform; no residuals where it fits as a matter of course."""
    checks = bool(np.isfinite(fit.sigma))
    return {
        "matrix": fit.matrix.tolist(),
        "residuals": np.round(fit.residuals, 2).tolist() if checks else None,
        "rms": round(fit.rms, 2) if checks else None,
    }


def in_crs(points: QgisPoints, crs: str) -> QgisPoints:
    """Points with their map side in a CRS.

    Raises:
        CrsError: Theirs is unknown, or cannot be brought there.
    """
    path = points.path
    if not points.crs or not len(points.plane) or read_crs(points.crs, path) == read_crs(crs, path):
        return points
    operation = operation_between(points.crs, crs, points.plane, path)
    return replace(points, crs=crs, plane=operation.forward(points.plane))


def drawn_raw(path: Path, size_px: tuple[int, int]) -> DrawnPhoto:
    """A scan as its raw tiles are drawn: camera, orientations and place stand for unknown ones."""
    camera = Camera("unknown", 1.0, (1.0, 1.0), (0.0, 0.0), (0.0, 0.0, 0.0), {})
    none = np.zeros((0, 2))
    interior = InteriorOrientation("affine", np.eye(2, 3), (), none, none, float("nan"))
    exterior = ExteriorOrientation(np.zeros(3), 0.0, 0.0, 0.0)
    prior = ExteriorPrior(np.full(3, 1e5), np.full(3, np.pi))
    photo = Photo(path.stem, path, size_px, camera.name, interior, exterior, exterior, prior, 0.0)
    return DrawnPhoto(photo, camera, 1)


def _start(project: Project, lattice: Lattice, ortho: OrthoSource) -> dict[str, Any]:
    """What the page needs once."""
    return {
        "name": project.block.name,
        "edition": secrets.token_urlsafe(6),
        "palette": page_palette(),
        "photos": [],
        "lattice": lattice.part(ortho.bounds),
        "ortho_pixel": ortho.ground_sample_distance_m,
        "command": f"gruber run {project.folder}",
    }
