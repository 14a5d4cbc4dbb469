"""The placing page: two clicks in one photo, for a block that could not be placed by itself."""

import secrets
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np

from app.desk.background import survived
from app.desk.inputs import lasting_token
from app.project import Project, described, read_project
from app.run import STAGE_NAMES, Run, RunOptions
from app.settings import Settings
from app.terminal import JsonLines
from core.block import Block, ExteriorPrior, Photo, footprint
from core.doubts import Failure
from core.errors import Cancelled, PhotogrammetryError, ProjectError, ScanError
from core.formats.qgis_points import (
    QgisPoints,
    find_qgis_points,
    read_qgis_points,
    write_qgis_points,
)
from core.geometry.camera import Camera
from core.geometry.crs import operation_between, read_crs
from core.geometry.exterior import ExteriorOrientation
from core.geometry.transforms import fit_similarity, rotation_and_scale
from core.georeference.stage import Georeferenced
from core.matching.reference import Reference, open_reference
from core.raster.scan_file import ScanFiles
from core.results import BlockInput
from core.scans.interior_orientation import ScanOrientation
from core.scans.stage import ScanSet
from sessions.atomic_write import clean_leftovers, whole_file
from sessions.session import HIDDEN, Session
from ui.review.compare import DrawnPhoto
from ui.review.looks import page_palette
from ui.review.placement import NOWHERE
from ui.review.tiles import Lattice, OrthoSource
from ui.web.access import Access
from ui.web.front import Front, FrontInputs
from ui.web.placing import Pair, placing_routes
from ui.web.tiles import Sources, TileStore

FINEST_SHARE = 0.5
"""Finest tiles of the ortho, as a share of its own pixel."""
State = Literal["idle", "running", "cancelled", "failed", "done"]


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
    if scans is None:
        raise ProjectError(
            project.file,
            "the block has no control points to review yet.",
            f"Run it first: gruber run {project.folder}",
        )
    given = described(project)
    placed = cast("Georeferenced | None", session.products.latest_value("georeference"))
    if placed is None:
        return Placeable(given, scans, open_reference(given.reference))
    nowhere = {n for n, one in placed.approximations.items() if one.source in NOWHERE}
    return Placeable(
        given, scans, open_reference(given.reference), placed.block, frozenset(nowhere)
    )


class Running:
    """One run at a time; asked from any thread."""

    def __init__(self, block: Path) -> None:
        self._block = block
        self._lock = threading.Lock()
        self._state: State = "idle"
        self._said: dict[str, Any] = {}
        self._walk: Run | None = None
        self._thread: threading.Thread | None = None
        self.gone_through = threading.Event()

    def start(self) -> None:
        """Begin, unless a run is under way."""
        with self._lock:
            if self._state == "running":
                return
            self._state, self._said = "running", {"begun": time.monotonic()}
            self._thread = threading.Thread(target=self._go, name="run", daemon=True)
            self._thread.start()

    def cancel(self) -> None:
        """Ask it to stop at its next report; nothing finished is lost."""
        if self._walk is not None:
            self._walk.interruption.asked.set()

    def close(self) -> None:
        """Stop and wait."""
        self.cancel()
        if self._thread is not None:
            self._thread.join(timeout=30)

    def status(self) -> dict[str, Any]:
        """State, stage, its place among all, share of it that is done, and the error if any."""
        with self._lock:
            said = {key: value for key, value in self._said.items() if key != "begun"}
            seconds = time.monotonic() - self._said.get("begun", time.monotonic())
            return {"state": self._state, "seconds": round(seconds), **said}

    def _go(self) -> None:
        why = survived(lambda _: self._run(), self)
        with self._lock:
            if why:
                self._state, self._said["why"] = "failed", why
            elif self._state == "running":
                self._state = "done"
            through = self._state == "done"
        if through:
            self.gone_through.set()

    def _run(self) -> None:
        project = read_project(self._block)
        options = RunOptions(workers=Settings().workers)
        with Session.open(project.folder, "gruber") as session:
            self._walk = Run(project, session, Telling(self.tell), options)
            try:
                self._walk.walk()
            except (Cancelled, KeyboardInterrupt):
                with self._lock:
                    self._state = "cancelled"
            finally:
                self._walk = None

    def tell(self, message: dict[str, Any]) -> None:
        """Take a line of the run."""
        stage = str(message.get("stage", ""))
        with self._lock:
            match message["event"]:
                case "stage":
                    place = STAGE_NAMES.index(stage)
                    self._said |= {
                        "stage": stage, "share": 0.0, "what": "",
                        "place": place + 1, "stages": len(STAGE_NAMES),
                    }  # fmt: skip
                case "progress":
                    share = message["done"] / message["total"] if message["total"] else 0.0
                    self._said |= {"share": round(share, 3), "what": message["what"]}
                case _:
                    pass


class Telling(JsonLines):
    """The voice of a run whose lines go to a function instead of a terminal."""

    def __init__(self, tell: Any) -> None:
        super().__init__()
        self._tell = tell

    def write(self, message: dict[str, object]) -> None:
        """Hand one line on."""
        self._tell(message)


class Placing:
    """An open placing page."""

    def __init__(self, front: Front, access: Access, running: Running, tiles: TileStore) -> None:
        self._front, self._access = front, access
        self._running, self._tiles = running, tiles

    @property
    def url(self) -> str:
        """The address to open, with the token."""
        return self._access.url(self.port)

    @property
    def guest_url(self) -> str:
        """The address for those who only look."""
        return self._access.guest_url(self.port)

    @property
    def port(self) -> int:
        """The port it listens on."""
        return self._front.port

    def wait(self) -> None:
        """Return when a run from the page has gone through; Ctrl-C passes through."""
        while not self._running.gone_through.wait(timeout=0.5):
            pass

    def close(self) -> None:
        """Close the port and stop the run."""
        self._running.close()
        self._front.close()
        self._tiles.close()

    def __enter__(self) -> "Placing":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def open_placing(
    project: Project, found: Placeable, host: str, port: int, language: str = ""
) -> Placing:
    """Open the placing page of a block.

    Raises:
        PhotogrammetryError: The port cannot be had.
    """
    ortho, dem = found.reference.ortho, found.reference.dem
    lattice = Lattice.over(ortho.bounds, FINEST_SHARE * ortho.ground_sample_distance_m)
    tiles = TileStore(Sources(ortho, dem, ScanFiles(project.folder), lattice))
    cameras = {scan.path.stem: scan.camera for scan in found.given.scans}
    drawn = {
        name: drawn_unplaced(scan, found.given.cameras[cameras[name]], ortho.bounds)
        for name, scan in found.scans.oriented.items()
    }
    tiles.publish(drawn)
    access = Access(host, lasting_token(project.folder / HIDDEN))
    running = Running(project.file)
    clicking = Clicking(found, running)
    start = _start(project, lattice, ortho)
    doors = FrontInputs(
        access, None, tiles, None, start, page="placing.html", told=clicking.photos,
        routes=placing_routes(clicking), language=language,
    )  # fmt: skip
    front = Front(doors, host, port)
    opened = Placing(front, access, running, tiles)
    try:
        front.start()
    except OSError as error:
        opened.close()
        raise PhotogrammetryError(
            f"{host}:{port}",
            f"cannot be listened on ({error.strerror or error}).",
            "Choose another port with --port, or close the desk that is open there.",
        ) from error
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
        """Residuals of a similarity, metres; its matrix from pixel to ground, scale and turn."""
        scan = self._scan(photo_id)
        values = np.array(pairs, dtype=np.float64).reshape(-1, 4)
        if len(values) < 2:
            return {"count": len(values)}
        fit = fit_similarity(values[:, :2], values[:, 2:], mirrored=True)
        if isinstance(fit, Failure):
            return {"count": len(values), "why": fit.reason}
        turn, _ = rotation_and_scale(fit.matrix, mirrored=True)
        return {
            "count": len(values),
            "matrix": fit.matrix.tolist(),
            "residuals": np.round(fit.residuals, 2).tolist() if len(values) > 2 else None,
            "rms": round(fit.rms, 2) if len(values) > 2 else None,
            "pixel_m": round(fit.scale, 4),
            "scale": round(1000 * fit.scale / scan.interior.pixel_size_mm, -1),
            "turn_deg": round(float(np.degrees(turn)), 1),
        }

    def save(self, photo_id: str, pairs: list[Pair]) -> dict[str, Any]:
        """Write the `.points` file beside the scan, whole; remove it once it would be empty.

        Raises:
            ScanError: A single pair, pairs at one place, or a file that cannot be read: it may hold
                what somebody clicked elsewhere, so it is not written over.
        """
        scan = self._scan(photo_id).scan.path
        fit = self.fitted(photo_id, pairs)
        with self._lock:
            path = find_qgis_points(scan) or scan.with_name(scan.name + ".points")
            if pairs and "matrix" not in fit:
                raise ScanError(
                    path, str(fit.get("why", "One pair is too few.")),
                    "Click two places or more, far apart.",
                )  # fmt: skip
            off = self._switched_off(path)
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

    def _switched_off(self, path: Path) -> QgisPoints:
        """Points of the file that somebody switched off in QGIS: they stay, switched off.

        Raises:
            ScanError: The file holds something that cannot be read.
        """
        none = np.zeros((0, 2))
        if not path.exists() or not path.read_bytes().strip():
            return QgisPoints(path, "", none, none, np.zeros(0, dtype=np.bool_))
        try:
            points = in_crs(read_qgis_points(path), self._found.given.crs)
        except PhotogrammetryError as error:
            raise ScanError(
                path, f"It cannot be read, and is not written over. {error.cause}",
                "Rename it or repair it in QGIS, then save again.",
            ) from error  # fmt: skip
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
            read = read_qgis_points(path)
            points = in_crs(read, self._found.given.crs)
        except PhotogrammetryError as error:
            return [], str(error)
        chosen = points.enabled
        pairs = np.column_stack([points.pixels[chosen], points.plane[chosen]])
        return np.round(pairs, 3).tolist(), ""


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


def drawn_unplaced(
    scan: ScanOrientation, camera: Camera, bounds: tuple[float, float, float, float]
) -> DrawnPhoto:
    """A scan as its raw tiles are drawn; its place is that of nobody knows where."""
    middle = np.array([(bounds[0] + bounds[2]) / 2, (bounds[1] + bounds[3]) / 2, 1e3])
    exterior = ExteriorOrientation(middle, 0.0, 0.0, 0.0)
    prior = ExteriorPrior(np.full(3, 1e5), np.full(3, np.pi))
    photo = Photo(
        scan.photo_id, scan.scan.path, scan.size_px, camera.name, scan.interior, exterior,
        exterior, prior, 0.0,
    )  # fmt: skip
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
    }  # fmt: skip
