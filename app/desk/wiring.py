"""Build session, loop, worker, scene and front and connect them; nothing else does."""

import logging
import queue
import secrets
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from importlib.metadata import version
from typing import Any

import numpy as np
from aiohttp import web
from jaxtyping import Float64

from app.block_toml import FILE
from app.desk.background import survived
from app.desk.exporting import titles, upright_formats
from app.desk.inputs import DeskInputs, first_state
from app.desk.listed_points import DeskPoints, import_titles
from app.desk.loop import ReviewLoop
from app.desk.masks import mask_route
from app.desk.messages import (
    Event,
    Measured,
    SceneOpened,
    Screen,
    SeatLeft,
    SeatTaken,
    WrittenBeside,
)
from app.desk.mosaic import sheet_routes
from app.desk.placing import DeskClicking
from app.desk.planning import plan_route, sample_route
from app.running import Running
from core.block import Block
from core.geometry.crs import Bounds
from core.raster.grid import Grid
from ui.review.compare import (
    Drawn,
    DrawnPhoto,
    PlanePoints,
    drawn_from_block,
)
from ui.review.looks import page_palette
from ui.review.picture import Part, notice_part
from ui.review.scene import ScenePicture
from ui.review.state import DeskState, Notice, SceneOptions, Seat
from ui.review.tiles import CoarseOrtho, Lattice
from ui.views.block_view import HILLSHADE, LIFT, VEIL, Pointed, Stage
from ui.views.meshes import hillshade_glb, relief_glb, terrain_glb, veil_glb
from ui.views.server import SECRET_HEADER, SceneServer, Sheet, Shown
from ui.web.access import Access
from ui.web.channel import Channel, Lines
from ui.web.front import SEAT_HEADER, Front, FrontInputs, Opened, Upstream, as_json
from ui.web.points import point_routes
from ui.web.running import Leaving
from ui.web.tiles import Sources, TileStore, no_tiles

logger = logging.getLogger(__name__)
SWITCH_S = 0.001
"""Seconds after which a computing thread gives way to those that answer."""


class OpenDesk(Opened):
    """An open review desk."""

    def __init__(
        self, front: Front, parts: list[Any], leaving: Leaving, running: Running | None
    ) -> None:
        super().__init__(front)
        self._parts, self.leaving, self._running = parts, leaving, running
        self._over = threading.Event()

    @property
    def loop(self) -> ReviewLoop:
        """The thread that owns the state."""
        return next(part for part in self._parts if isinstance(part, ReviewLoop))

    @property
    def scene(self) -> SceneServer:
        """The 3D scene."""
        return next(part for part in self._parts if isinstance(part, SceneServer))

    @property
    def ran(self) -> bool:
        """Whether a run from the desk or beside it made a block: the desk is to be opened on it."""
        own = self._running is not None and self._running.gone_through.is_set()
        return own or self.loop.beside.outdated.is_set()

    def wait(self) -> bool:
        """Whether an operator wants to see files and settings; False when the desk was closed.

        Or when a run has gone through. Ctrl-C passes through.
        """
        while not self.ran and not self._over.wait(timeout=0.3):
            if self.leaving.asked.is_set():
                return True
        return False

    def close(self) -> None:
        """Close the port and end every thread; decisions are on disk already."""
        if self._over.is_set():
            return
        for part in self._parts:
            part.close()
        self._over.set()


def open_desk(desk: DeskInputs) -> OpenDesk:
    """Open the review desk of a block.

    Raises:
        PhotogrammetryError: The port cannot be had.
    """
    # A thread that computes lets others in after this long; a key's answer passes several threads.
    sys.setswitchinterval(SWITCH_S)
    state = first_state(desk)
    lattice = Lattice.over(desk.ortho.bounds, _finest_pixel_m(desk, state))
    bounds, drawn = _block_bounds(desk, state.oriented), drawn_from_block(state.oriented)
    coarse = CoarseOrtho(desk.ortho)
    drapes = (partial(relief_glb, desk.dem, bounds, desk.block.origin, desk.terrain),
              partial(_draped, coarse, desk, bounds))  # fmt: skip
    illustrator = _Illustrator(coarse, drapes, drawn)
    read, alike, mosaic = desk.read_scan, desk.likeness, desk.mosaic or no_tiles
    years, ready = tuple(ortho for _, ortho in desk.years), illustrator.ready
    tiles = TileStore(Sources(coarse, desk.dem, read, lattice, alike, ready, mosaic, years))
    inbox: queue.SimpleQueue[Event] = queue.SimpleQueue()
    access = Access(desk.door, desk.token or secrets.token_urlsafe(24), desk.looking)

    def scene_opened(seat: str) -> None:
        illustrator.ask()
        inbox.put(SceneOpened(seat))

    scene = SceneServer(_extent(desk, state), SEAT_HEADER, scene_opened)
    channel = Channel(
        inbox.put,
        lambda seat: inbox.put(SeatTaken(seat)),
        lambda seat: inbox.put(SeatLeft(seat)),
        as_json(notice_part(Notice("notice.read-only" if desk.looking else "notice.guest"))),
    )
    upstream = Upstream(scene.port, SECRET_HEADER, scene.secret)
    start = _start(desk, lattice)
    leaving = Leaving()
    points = DeskPoints(desk.block, desk.session.folder, inbox.put, desk.ground)
    placing = _placing_routes(desk, tiles, inbox.put)

    def sheets_made() -> None:
        inbox.put(WrittenBeside(Notice("notice.sheets-made")))

    served = FrontInputs(
        access, channel, tiles, upstream, start, desk.results, language=desk.language,
        routes=(leaving.route(), *point_routes(points), *placing,
                mask_route(desk.initial), plan_route(desk.session.folder, inbox.put),
                sample_route(desk.session.folder, inbox.put),
                *sheet_routes(desk.session.folder / FILE, sheets_made), *desk.routes),
    )  # fmt: skip
    front = Front(served)
    sheets = _Sheets(desk, bounds, tiles)
    loop = ReviewLoop(desk, _screen(front, channel, scene, tiles, sheets=sheets), inbox)
    loop.start()
    running = [] if desk.running is None else [desk.running]
    opened = OpenDesk(
        front, [front, illustrator, *running, loop, scene, tiles], leaving, desk.running
    )
    opened.listen()
    illustrator.start(tiles, scene)
    return opened


def _placing_routes(
    desk: DeskInputs, tiles: TileStore, hand_in: Callable[[Measured], None]
) -> tuple[web.RouteDef, ...]:
    """Addresses of the page that places photos; none where there is no ortho to click in."""
    if desk.placing is None or desk.running is None:
        return ()
    folder = desk.session.folder
    return DeskClicking(desk.placing, folder, desk.running, tiles, hand_in).routes()


def _draped(
    coarse: CoarseOrtho, desk: DeskInputs, bounds: tuple[float, float, float, float]
) -> bytes:
    """The drape; the small ortho it is made of serves for coarse tiles from then on."""
    coarse.prepare()
    # A little finer, and the files would be read once more.
    longer = max(bounds[2] - bounds[0], bounds[3] - bounds[1])
    most = int(longer / coarse.grid.ground_sample_distance_m)
    options = replace(desk.terrain, texture_px=min(desk.terrain.texture_px, most))
    return terrain_glb(coarse, desk.dem, bounds, desk.block.origin, options)


class _Illustrator:
    """Makes drape and frustums' pictures while the desk is open already: they read large files.

    The ortho is read once a scene is opened or a tile needs it whole; until it is read, which
    takes seconds, the relief without it is the ground.
    """

    def __init__(
        self, coarse: CoarseOrtho, drapes: Sequence[Callable[[], bytes]], drawn: Drawn
    ) -> None:
        self._coarse, self._drapes, self._drawn = coarse, drapes, drawn
        self._asked, self._stop = threading.Event(), threading.Event()
        self._threads: list[threading.Thread] = []

    def start(self, tiles: TileStore, scene: SceneServer) -> None:
        for work in (self._lay, self._picture):
            thread = threading.Thread(target=work, args=(tiles, scene), daemon=True)
            self._threads.append(thread)
            thread.start()

    def ask(self) -> None:
        """Have the ground made, unless it was asked for before."""
        self._asked.set()

    def ready(self, grid: Grid) -> bool:
        """Whether a tile of the ortho can be drawn; asks for what it waits for."""
        found = self._coarse.ready(grid)
        if not found:
            self.ask()
        return found

    def close(self) -> None:
        self._stop.set()
        self._asked.set()
        for thread in self._threads:
            thread.join(timeout=30)

    def _lay(self, tiles: TileStore, scene: SceneServer) -> None:
        self._asked.wait()
        for drape in self._drapes:
            if self._stop.is_set():
                return
            survived(lambda _, drape=drape: scene.drape(drape()), scene)

    def _picture(self, tiles: TileStore, scene: SceneServer) -> None:
        for name, photo in self._drawn.items():
            if self._stop.is_set():
                return
            survived(lambda p, name=name: scene.picture(name, tiles.thumbnail(p)), photo)


class _Sheets:
    """What a scene needs beside the drape, made only when somebody wants to see it."""

    def __init__(self, desk: DeskInputs, bounds: Bounds, tiles: TileStore) -> None:
        self._desk, self._bounds, self._tiles = desk, bounds, tiles
        # Between terrain and points.
        self._lift_m = 0.5 * LIFT * max(bounds[2] - bounds[0], bounds[3] - bounds[1])

    def of(self, options: SceneOptions, block: Block) -> tuple[Sheet, ...]:
        """Shade of the relief, and the photo whose perspective centre the eye is in."""
        found: list[Sheet] = []
        if "hillshade" not in options.hidden:
            found.append(Sheet(HILLSHADE, HILLSHADE, self._hillshade))
        if (photo := block.photos.get(options.inside)) is not None:
            drawn = DrawnPhoto(photo, block.camera_of(options.inside), 1)
            exterior = photo.exterior
            angles = exterior.omega, exterior.phi, exterior.kappa
            key = f"{options.inside} {exterior.centre.tolist()} {angles}"
            found.append(Sheet(VEIL, key, lambda: self._veil(drawn)))
        return tuple(found)

    def _hillshade(self) -> bytes:
        desk = self._desk
        return hillshade_glb(desk.dem, self._bounds, desk.block.origin, desk.terrain)

    def _veil(self, drawn: DrawnPhoto) -> bytes:
        desk = self._desk
        picture = self._tiles.frame(drawn, desk.terrain.photo_px)
        return veil_glb(
            picture, drawn, desk.dem, desk.block.origin,
            lift_m=self._lift_m, options=desk.terrain,
        )  # fmt: skip


def _screen(
    front: Front, channel: Channel, scene: SceneServer, tiles: TileStore, *, sheets: _Sheets
) -> Screen:
    """Pictures leave the loop as text and values; nothing here waits."""
    lines = Lines()

    def show(seat_id: str, parts: Mapping[str, Part]) -> None:
        texts = {name: as_json(part) for name, part in parts.items() if name != "rows"}
        rows = parts.get("rows")
        if isinstance(rows, list):
            texts |= lines.told(rows)
        front.call(channel.show, seat_id, texts)

    def tell(seat_id: str, notice: Notice) -> None:
        front.call(channel.tell, seat_id, as_json(notice_part(notice)))

    def show_scene(
        seat_id: str, picture: Callable[[], ScenePicture], seat: Seat, block: Block
    ) -> None:
        wanted = sheets.of(seat.scene, block)
        scene.show(seat_id, Shown(picture, seat.scene, _pointed(seat, block), wanted))

    def fit(seat_id: str, seat: Seat, block: Block, whole: bool) -> None:
        scene.fit(seat_id, None if whole else _pointed(seat, block))

    return Screen(show, tell, show_scene, fit, tiles.publish)


def _pointed(seat: Seat, block: Block) -> Pointed | None:
    if seat.current is None:
        return None
    point, photo = block.surveyed.get(seat.current[0]), block.photos.get(seat.current[1])
    if point is None or photo is None:
        return None
    origin = block.origin
    return Pointed(point.position - origin, photo.exterior.centre - origin, photo.photo_id)


def _start(desk: DeskInputs, lattice: Lattice) -> dict[str, Any]:
    """What a page needs once."""
    return {
        "name": desk.name,
        "version": version("gruber"),
        "edition": secrets.token_urlsafe(6),
        "template": desk.template_m,
        "palette": page_palette(),
        "photos": list(desk.block.photos),
        "lattice": lattice.part(desk.ortho.bounds),
        "results": desk.results is not None,
        "formats": titles() if desk.routes else {},
        "upright": upright_formats() if desk.routes else [],
        "imports": import_titles() if desk.routes else {},
        "free": [] if desk.choose is None else [desk.free[0], True],
        "fill": desk.fill is not None,
        "ortho": desk.has_ortho,
        "years": [year for year, _ in desk.years],
        "placeable": desk.placing is not None,
        "looking": desk.looking,
        # Nothing but the scans says how far to go in where there is no ortho.
        "ortho_pixel": desk.ortho.ground_sample_distance_m if desk.has_ortho else lattice.pixel_m,
    }  # fmt: skip


def _finest_pixel_m(desk: DeskInputs, state: DeskState) -> float:
    """The finer of ortho and scans, not below a third of the ortho's own pixel."""
    oriented = state.oriented
    sizes = [p.ground_pixel_m(oriented.camera_of(name)) for name, p in oriented.photos.items()]
    scans = float(np.median(sizes)) if sizes else np.inf
    return min(desk.ortho.ground_sample_distance_m, max(scans, 1e-3))


def _extent(desk: DeskInputs, state: DeskState) -> Stage:
    """How large the block is, and where its middle lies."""
    oriented = state.oriented
    bounds = _block_bounds(desk, oriented)
    middle = np.array([(bounds[0] + bounds[2]) / 2, (bounds[1] + bounds[3]) / 2, 0.0])
    heights = [photo.ground_height_m for photo in oriented.photos.values()]
    middle[2] = float(np.median(heights)) if heights else 0.0
    return Stage(
        extent_m=max(bounds[2] - bounds[0], bounds[3] - bounds[1]),
        middle=middle - desk.block.origin,
    )


def _block_bounds(desk: DeskInputs, block: Block) -> tuple[float, float, float, float]:
    """West, south, east, north of all photos on the ground, within the ortho."""
    corners: list[PlanePoints] = []
    for name, photo in block.photos.items():
        camera = block.camera_of(name)
        pixels = photo.interior.pixel_from_film(camera.frame_corners_mm)
        heights = np.full(len(pixels), photo.ground_height_m)
        corners.append(photo.object_from_pixel(pixels, heights, camera)[:, :2])
    west, south, east, north = desk.ortho.bounds
    if not corners:
        return west, south, east, north
    every: Float64[np.ndarray, "n 2"] = np.vstack(corners)
    low, high = np.nanmin(every, axis=0), np.nanmax(every, axis=0)
    least, most = [float(value) for value in low], [float(value) for value in high]
    inside = (max(least[0], west), max(least[1], south), min(most[0], east), min(most[1], north))
    apart = inside[0] >= inside[2] or inside[1] >= inside[3]
    return (west, south, east, north) if apart else inside
