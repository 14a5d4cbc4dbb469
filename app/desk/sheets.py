"""Map sheets made from the desk: one delivery at a time, watched and stopped from any page."""

import asyncio
import threading
from pathlib import Path
from typing import Any

from aiohttp import web

from app.project import read_project
from app.sheets import check_sheets, make_sheets, sheets_line
from core.errors import Cancelled, ProjectError
from core.mosaic.composition import MosaicProduct
from core.sheets.delivery import INDEX
from sessions.session import RESULTS, Session
from ui.web.running import fresh_json, operators_only, told


class SheetMaker:
    """Cuts the mosaic on disk into map sheets; also the progress of that."""

    def __init__(self, project_file: Path) -> None:
        """The maker of one block."""
        self._file = project_file
        self._turn, self._asked = threading.Lock(), threading.Event()
        self._share, self._what = 0.0, ""

    def report(self, done: float, total: float, what: str = "") -> None:
        """Take note of how far it is; raises `Cancelled` when it was asked to stop."""
        if self._asked.is_set():
            raise Cancelled
        self._share, self._what = done / total if total else 1.0, what

    def status(self) -> dict[str, Any]:
        """Whether sheets are being made, the share done, and what is at work."""
        busy = self._turn.locked()
        return {"busy": busy, "share": self._share if busy else 0.0, "what": self._what}

    def cancel(self) -> None:
        """Ask it to stop; whole sheets stay."""
        self._asked.set()

    def make(self) -> dict[str, Any]:
        """The sheets of the mosaic on disk.

        Returns:
            What was `said`, and the index map as `file` of the results; nothing when cancelled.

        Raises:
            PhotogrammetryError: There is no mosaic, or no sheets are named, or they cannot be made.
        """
        with self._turn:
            self._asked.clear()
            self._share, self._what = 0.0, ""
            project = read_project(self._file)
            check_sheets(project)
            with Session.open(project.folder, "gruber") as session, session.running():
                mosaic: MosaicProduct | None = session.products.latest_value("mosaic")
                if mosaic is None or not mosaic.path.is_file():
                    raise ProjectError(
                        project.folder / RESULTS / "mosaic.tif",
                        "there is no mosaic to cut yet.",
                        "Make the orthos and the mosaic first.",
                    )
                try:
                    delivery = make_sheets(session, project, mosaic, self)
                except Cancelled:
                    return {}
        return {"said": sheets_line(delivery), "file": f"sheets/{INDEX}"}


def sheet_routes(project_file: Path) -> tuple[web.RouteDef, ...]:
    """`/sheets`: how far they are, for everybody; making and stopping them, for operators."""
    maker = SheetMaker(project_file)

    async def status(request: web.Request) -> web.StreamResponse:
        return fresh_json(maker.status())

    async def make(request: web.Request) -> web.StreamResponse:
        operators_only(request)
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(None, lambda: told(maker.make))

    async def cancel(request: web.Request) -> web.StreamResponse:
        operators_only(request)
        maker.cancel()
        return fresh_json(maker.status())

    return (
        web.get("/sheets", status), web.post("/sheets", make), web.post("/sheets/cancel", cancel),
    )  # fmt: skip
