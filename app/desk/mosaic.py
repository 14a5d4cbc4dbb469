"""The mosaic at the desk: as it is, as it will be with the seams that stand, and its sheets."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
from aiohttp import web

from app.desk.watched_job import WatchedJob
from app.epochs import MOSAIC
from app.misfit import known_places
from app.mosaic import SEAMS, SEAMS_DRAWN, edited_seams, kept_orthos
from app.project import read_project
from app.sheets import check_sheets, make_sheets, sheets_line
from core.errors import Cancelled, ProjectError
from core.frames import HALF_PIXEL
from core.geometry.crs import Bounds
from core.mosaic.blending import REACH_PX
from core.mosaic.composition import MosaicProduct, compose_window
from core.mosaic.seam_edits import SeamEdit
from core.mosaic.seams import Seam
from core.raster.grid import Grid, Pixels
from core.raster.ortho import Ortho, open_ortho
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
        """Colours on a grid: of the file, and of what the same composition makes of the edits."""
        colour = self.file.read_colour(grid)
        changed, whole = self.mosaic.changed, self.mosaic.product.grid
        if changed is None:
            return colour
        west, south, east, north = grid.bounds
        low = np.maximum(changed[:2], (west, south))
        high = np.minimum(changed[2:], (east, north))
        room = REACH_PX * whole.ground_sample_distance_m
        if np.any(high + room <= low - room):
            return colour
        part = whole.covering((*(low - room).tolist(), *(high + room).tolist()))
        values = self._composed(part)
        seen = (values if values.ndim == 2 else values[:, :, 0]) > 0
        return _laid_over(colour, grid, shown_as(values, seen, self.stretch), part)

    def _composed(self, part: Grid) -> Pixels:
        """A part of the mosaic with the seams as they stand, pieces of it at a time."""
        whole = self.mosaic.product.grid
        corner = whole.grid_from_object(np.array([[part.west, part.north]]))[0]
        column, row = (round(float(value)) for value in corner)
        strips: list[Pixels] = []
        for down in range(0, part.rows, STRIP_PX):
            rows = min(STRIP_PX, part.rows - down)
            pieces = [
                compose_window(
                    self.mosaic.orthos,
                    self.mosaic.product,
                    self.mosaic.seams,
                    (column + across, row + down, min(STRIP_PX, part.columns - across), rows),
                )
                for across in range(0, part.columns, STRIP_PX)
            ]
            strips.append(np.concatenate(pieces, axis=1))
        return np.concatenate(strips).astype(np.float32)


def _laid_over(colour: Colour, grid: Grid, patch: Colour, part: Grid) -> Colour:
    """A picture with a finer patch resampled into it where the patch reaches."""
    ratio = grid.ground_sample_distance_m / part.ground_sample_distance_m
    reduction = max(1, round(ratio))
    rows, columns = patch.shape[0] // reduction, patch.shape[1] // reduction
    if not rows or not columns:
        return colour
    even = patch[: rows * reduction, : columns * reduction]
    small = cv2.resize(even, (columns, rows), interpolation=cv2.INTER_AREA)
    pixel = part.ground_sample_distance_m * reduction
    east, north = grid.centres()
    x = ((east - part.west) / pixel - HALF_PIXEL).astype(np.float32)
    y = ((part.north - north) / pixel - HALF_PIXEL).astype(np.float32)
    across = np.flatnonzero((x > -HALF_PIXEL) & (x < columns - HALF_PIXEL))
    down = np.flatnonzero((y > -HALF_PIXEL) & (y < rows - HALF_PIXEL))
    if not len(across) or not len(down):
        return colour
    map_x, map_y = np.meshgrid(x[across], y[down])
    laid = cv2.remap(
        np.asarray(small), map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    result = colour.copy()
    result[down[0] : down[-1] + 1, across[0] : across[-1] + 1] = laid
    return result


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
