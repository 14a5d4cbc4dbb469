"""The mosaic at the desk: as it is, as it will be with the seams that stand, and its sheets."""

import asyncio
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
from aiohttp import web
from jaxtyping import Float32

from app.desk.watched_job import WatchedJob
from app.epochs import MOSAIC
from app.misfit import known_places
from app.mosaic import SEAMS, SEAMS_DRAWN, edited_seams, kept_orthos
from app.project import read_project
from app.sheets import check_sheets, make_sheets, sheets_line
from core.errors import Cancelled, ProjectError
from core.geometry.crs import Bounds
from core.mosaic.blending import REACH_PX
from core.mosaic.composition import MosaicProduct, compose_window
from core.mosaic.seam_edits import SeamEdit
from core.mosaic.seams import Seam
from core.raster.grid import Grid, Pixels, Tile
from core.raster.ortho import LEAST_COVERAGE, Ortho, open_ortho
from core.raster.sampling import sample_part
from core.sheets.delivery import INDEX
from sessions.session import RESULTS, Session
from ui.review.state import ShownMosaic
from ui.review.tiles import Colour, OrthoSource, Stretch, fit_stretch
from ui.web.running import operators_only, told

SMALL_PX = 512
"""Longer side of the picture from which black and white of a 16-bit mosaic are learnt, pixels."""
WHITE = 255
"""Largest gray value that a screen shows."""
KEPT = 4
"""Editions of the seams that tiles may still be asked of."""
STRIP_PX = 2048
"""Edited ground is composed in parts of so many pixels a side, some tens of megabytes."""
RIM_PX = 3
"""So far around a grid, pixels of it, the mosaic counts as well: what a kernel reaches."""
Corner = tuple[int, int]
"""Column and row of a first pixel."""


class MosaicFile:
    """The mosaic of a block: its product, and its pictures by version and edition of its seams."""

    def __init__(self, session: Session, crs: str) -> None:
        self._session, self._crs = session, crs
        self._path = session.results / MOSAIC
        self._opened: tuple[int, Ortho, Stretch | None] | None = None
        self._editions: dict[int, ShownMosaic] = {}

    def on_disk(self) -> ShownMosaic | None:
        """The mosaic that was made last; None where there is none, or its file was taken away."""
        products = self._session.products
        product = cast("MosaicProduct | None", products.latest_value("mosaic"))
        if product is None or not self._path.is_file():
            return None
        version = self._path.stat().st_mtime_ns // 1_000_000
        kept = products.latest_value(SEAMS_DRAWN) or (product.seams, ())
        drawn, edits = cast("tuple[tuple[Seam, ...], tuple[SeamEdit, ...]]", kept)
        orthos = kept_orthos(self._session, product)
        places = known_places(products)
        shown = ShownMosaic(product, version, product.seams, drawn, edits, orthos, misfit=places)
        if not edited_seams(self._session):
            return shown
        seams = (self._session.results / SEAMS).stat().st_mtime_ns // 1_000_000
        return replace(shown, outside="waiting" if seams > version else "composed")

    def publish(self, mosaic: ShownMosaic) -> None:
        """Tell what an edition of the seams means; the oldest are forgotten."""
        self._editions[mosaic.edition] = mosaic
        for old in list(self._editions)[:-KEPT]:
            del self._editions[old]

    def __call__(self, version: int, edition: int) -> OrthoSource | None:
        """Colours of the mosaic on any grid, from any thread; None without a file.

        Raises:
            ReferenceDataError: The file is damaged.
        """
        opened = self._opened
        if opened is None or opened[0] != version:
            if not self._path.is_file():
                return None
            ortho = open_ortho([self._path], self._crs)
            opened = self._opened = version, ortho, stretch_of(ortho)
        _, ortho, stretch = opened
        source = ortho if stretch is None else Stretched(ortho, stretch)
        mosaic = self._editions.get(edition) if edition else None
        return source if mosaic is None else EditedMosaic(source, mosaic, stretch)


class SheetMaker:
    """Cuts the mosaic on disk into map sheets."""

    def __init__(self, project_file: Path) -> None:
        """The maker of one block."""
        self._file = project_file
        self.job = WatchedJob(
            ProjectError(
                project_file, "has its map sheets in the making.", "Wait for them, or cancel them."
            )
        )

    def make(self) -> dict[str, Any]:
        """The sheets of the mosaic on disk.

        Returns:
            What was `said`, and the index map as `file` of the results; nothing when cancelled,
            and whole sheets stay.

        Raises:
            PhotogrammetryError: There is no mosaic, or no sheets are named, or they cannot be made,
                or are being made already.
        """
        with self.job.begun():
            project = read_project(self._file)
            check_sheets(project)
            with Session.open(project.folder, "gruber") as session, session.running():
                mosaic: MosaicProduct | None = session.products.latest_value("mosaic")
                if mosaic is None or not mosaic.path.is_file():
                    raise ProjectError(
                        project.folder / RESULTS / MOSAIC,
                        "there is no mosaic to cut yet.",
                        "Make the orthos and the mosaic first.",
                    )
                try:
                    delivery = make_sheets(session, project, mosaic, self.job)
                except Cancelled:
                    return {}
        return {"said": sheets_line(delivery), "file": f"sheets/{INDEX}"}


def stretch_of(mosaic: Ortho) -> Stretch | None:
    """What brings a mosaic of 16 bit to the grays of a screen; None where it has them already."""
    west, south, east, north = mosaic.bounds
    pixel = max((east - west) / SMALL_PX, (north - south) / SMALL_PX)
    small = mosaic.read(Grid.over(mosaic.bounds, max(pixel, mosaic.ground_sample_distance_m)))
    values = small.values[small.mask]
    if not values.size or float(values.max()) <= WHITE:
        return None
    return fit_stretch(values[None], margin=0)


def shown_as(values: Pixels, seen: np.ndarray, stretch: Stretch | None) -> Colour:
    """Grays or colours of a mosaic as those of a screen, black only where nothing is seen."""
    bands = np.repeat(values[:, :, None], 3, axis=2) if values.ndim == 2 else values[:, :, :3]
    scaled = bands if stretch is None else stretch.applied(bands)
    return np.where(seen[:, :, None], np.clip(np.rint(scaled), 1, WHITE), 0).astype(np.uint8)


@dataclass(frozen=True, slots=True, eq=False)
class Stretched:
    """A mosaic of 16 bit in the grays of a screen."""

    mosaic: Ortho
    """The file."""
    stretch: Stretch
    """Grays shown as black and as white."""

    @property
    def bounds(self) -> Bounds:
        """West, south, east, north, metres."""
        return self.mosaic.bounds

    @property
    def ground_sample_distance_m(self) -> float:
        """Finest pixel, metres."""
        return self.mosaic.ground_sample_distance_m

    def read_colour(self, grid: Grid) -> Colour:
        """Grays as colours on a grid, black only where the mosaic shows nothing."""
        patch = self.mosaic.read(grid)
        return shown_as(patch.values, patch.mask, self.stretch)


@dataclass(frozen=True, slots=True, eq=False)
class EditedMosaic:
    """The file with the ground that edits of seams change composed anew over it."""

    file: OrthoSource
    """The mosaic on disk."""
    mosaic: ShownMosaic
    """Its seams as they stand."""
    stretch: Stretch | None
    """Grays shown as black and as white; None where they are those of a screen."""

    @property
    def bounds(self) -> Bounds:
        """West, south, east, north, metres."""
        return self.file.bounds

    @property
    def ground_sample_distance_m(self) -> float:
        """Finest pixel, metres."""
        return self.file.ground_sample_distance_m

    def read_colour(self, grid: Grid) -> Colour:
        """Colours on a grid: of the file, and what the same composition of the edits adds to it.

        Both are read alike at any size of pixel, so nothing but the edit is seen.
        """
        colour = self.file.read_colour(grid)
        parts = list(self._parts(grid))
        if not parts:
            return colour
        added = np.zeros((1, grid.rows, grid.columns), dtype=np.float32)
        for part in parts:
            # Reading is linear: parts are added up.
            added = added + sample_part(*self._added(part), self.mosaic.product.grid, grid)
        total = colour + np.moveaxis(added[:-1], 0, -1)
        seen = np.where(np.abs(added[-1]) > LEAST_COVERAGE, added[-1] > 0, colour.any(axis=2))
        return shown_as(total, seen, None)

    def _parts(self, grid: Grid) -> Iterator[Tile]:
        """What of the mosaic the edits change and a grid shows: a little at a time."""
        changed, whole = self.mosaic.changed, self.mosaic.product.grid
        if changed is None:
            return
        gsd = whole.ground_sample_distance_m
        room, rim = REACH_PX * gsd, RIM_PX * max(gsd, grid.ground_sample_distance_m)
        west, south, east, north = grid.bounds
        low = np.maximum(np.array(changed[:2]) - room, (west - rim, south - rim))
        high = np.minimum(np.array(changed[2:]) + room, (east + rim, north + rim))
        if np.any(high <= low):
            return
        part = whole.covering((*low.tolist(), *high.tolist()))
        corner = whole.grid_from_object(np.array([[part.west, part.north]]))[0]
        column, row = (round(float(value)) for value in corner)
        for down in range(0, part.rows, STRIP_PX):
            for across in range(0, part.columns, STRIP_PX):
                columns, rows = part.columns - across, part.rows - down
                yield column + across, row + down, min(STRIP_PX, columns), min(STRIP_PX, rows)

    def _added(self, part: Tile) -> tuple[Float32[np.ndarray, "bands rows columns"], Corner]:
        """What a part shows with the seams as they stand, less what the file shows.

        The last band is 1 where the ground is seen that was not, -1 where it no longer is.
        """
        mosaic = self.mosaic
        values = compose_window(mosaic.orthos, mosaic.product, mosaic.seams, part)
        seen = (values if values.ndim == 2 else values[:, :, 0]) > 0
        now = shown_as(values.astype(np.float32), seen, self.stretch)
        file = self.file.read_colour(mosaic.product.grid.window(*part))
        both = [np.dstack([one, one.any(axis=2)]).astype(np.float32) for one in (now, file)]
        bands = (0, 3) if values.ndim == 2 else (0, 1, 2, 3)
        added = np.moveaxis(both[0] - both[1], -1, 0)[list(bands)]
        return np.ascontiguousarray(added), part[:2]


def sheet_routes(project_file: Path, made: Callable[[], None]) -> tuple[web.RouteDef, ...]:
    """`/sheets`: how far they are, for everybody; making and stopping them, for operators.

    Args:
        project_file: The `block.toml`.
        made: Called once they are on disk, from any thread.
    """
    maker = SheetMaker(project_file)

    async def make(request: web.Request) -> web.StreamResponse:
        operators_only(request)
        loop = asyncio.get_running_loop()

        def work() -> dict[str, Any]:
            said = maker.make()
            if said:
                made()
            return said

        return await loop.run_in_executor(None, lambda: told(work))

    return (*maker.job.routes("/sheets"), web.post("/sheets", make))
