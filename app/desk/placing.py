"""Place a photo by clicks at the desk: the saved pairs are a decision."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from aiohttp import web

from app.desk.messages import Measured
from app.placing import Clicking, Placeable, drawn_raw
from app.running import Running
from core.errors import ScanError
from core.formats.world_file import world_file_suffix, write_world_file
from sessions.atomic_write import whole_file
from sessions.decisions import PlacePhoto
from sessions.scan_decisions import clicked_pairs
from sessions.session import RESULTS, Session
from ui.review.state import Notice
from ui.web.placing import Pair, placing_routes, with_pairs
from ui.web.running import fresh_json, operators_only
from ui.web.tiles import ScanTiles

WORLD_FILES = "world-files"
"""Folder of the results for world files: none beside a scan is written over."""


class DeskClicking(Clicking):
    """Pairs of points of any photo, recorded through the loop."""

    def __init__(
        self,
        found: Placeable,
        folder: Path,
        running: Running,
        tiles: ScanTiles,
        hand_in: Callable[[Measured], None],
    ) -> None:
        super().__init__(found, running)
        self._folder, self._tiles, self._hand_in = folder, tiles, hand_in
        known = found.placed.photos if found.placed is not None else {}
        # Scans that are set aside can be placed as well.
        tiles.publish(
            {
                name: drawn_raw(scan.scan.path, scan.size_px)
                for name, scan in found.scans.oriented.items()
                if name not in known
            }
        )

    def photos(self) -> dict[str, Any]:
        """All scans, with what was clicked in them, and their tiles as they are drawn now."""
        clicked = self._decided()
        told = super().photos()
        for scan in told["scans"]:
            name = scan["photo"]
            scan["version"] = self._tiles.newest(name)
            if name in clicked:
                scan |= {"pairs": [list(pair) for pair in clicked[name]], "why": ""}
        return {**told, "command": f"gruber run {self._folder}"}

    def _decided(self) -> Mapping[str, Sequence[Pair]]:
        with Session.open(self._folder, "") as session:
            return clicked_pairs(session.decisions())

    def save(self, photo_id: str, pairs: list[Pair], seat_id: str = "") -> dict[str, Any]:
        """Hand in a new decision; without pairs the photo goes back to its sources.

        Raises:
            ScanError: A single pair, or pairs at one place.
        """
        fit = self.checked(photo_id, pairs)
        saved = {**fit, "saved": photo_id if pairs else ""}
        if pairs and [*map(tuple, self._decided().get(photo_id, ()))] == [*map(tuple, pairs)]:
            return saved
        text = "notice.placed" if pairs else "notice.given-back"
        notice = Notice(text, {"scan": photo_id, "count": f"{len(pairs)}"})
        self._hand_in(Measured(seat_id, PlacePhoto(photo_id, tuple(pairs)), notice))
        return saved

    def world_file(self, photo_id: str, pairs: list[Pair], model: str) -> dict[str, Any]:
        """Write the transformation of the pairs as a world file into the results.

        Raises:
            ScanError: Too few pairs for the model, or pairs in one line.
        """
        fit = self.fitted(photo_id, pairs)
        fit = fit.get("affine") or {} if model == "affine" else fit
        scan = self._scan(photo_id).scan.path
        if "matrix" not in fit:
            raise ScanError(scan, "The pairs are too few.", "Click more places, far apart.")
        name = scan.stem + world_file_suffix(scan)
        path = self._folder / RESULTS / WORLD_FILES / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as temporary:
            write_world_file(temporary, np.array(fit["matrix"]))
        return {"written": f"{RESULTS}/{WORLD_FILES}/{name}"}

    def routes(self) -> tuple[web.RouteDef, ...]:
        """Addresses of the page within the desk."""

        async def photos(request: web.Request) -> web.StreamResponse:
            return fresh_json(self.photos())

        async def world(request: web.Request) -> web.StreamResponse:
            operators_only(request)
            model = request.query.get("model", "")
            return await with_pairs(
                request, lambda photo, pairs: self.world_file(photo, pairs, model)
            )

        return (
            web.get("/placing", photos),
            web.post("/world/{photo}", world),
            *placing_routes(self),
        )
