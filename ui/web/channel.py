"""The web socket between loop and pages: gestures in, changed parts of the picture out."""

import asyncio
import json
from collections.abc import Callable, Mapping
from typing import Any, cast

from aiohttp import WSMsgType, web

from ui.review.gestures import LOOKING, Gesture, gesture_from_message
from ui.web.access import is_guest

Parts = Mapping[str, str]
"""Parts of a page by name, each as JSON text."""
MESSAGE_BYTES = 4 * 1024 * 1024
"""A gesture is never longer: a verdict on 50 000 rows at once, names of 40 letters each."""
PIECE = 50
"""Lines of one piece."""


def object_from_text(text: str) -> dict[str, Any]:
    """The object that a page sent as JSON.

    Raises:
        ValueError: It is none, is nested beyond reason, or holds halves of signs.
    """
    try:
        read: Any = json.loads(text)
    except RecursionError as error:
        raise ValueError("nested too deeply") from error
    if not isinstance(read, dict):
        raise ValueError("no object")
    json.dumps(read, ensure_ascii=False).encode()
    return cast("dict[str, Any]", read)


class Channel:
    """All open pages, by seat; what each has been sent; lives on the front's event loop."""

    def __init__(
        self,
        hand_in: Callable[[Gesture], None],
        seat_taken: Callable[[str], None],
        seat_left: Callable[[str], None],
        only_looking: str = "",
    ) -> None:
        """`only_looking` is the notice, as JSON text, of a guest who tries to decide."""
        self._hand_in, self._only_looking = hand_in, only_looking
        self._seat_taken, self._seat_left = seat_taken, seat_left
        self._pages: dict[web.WebSocketResponse, str] = {}
        self._sent: dict[web.WebSocketResponse, dict[str, str]] = {}
        self._wakes: dict[web.WebSocketResponse, asyncio.Event] = {}
        self._latest: dict[str, dict[str, str]] = {}
        self._notices: dict[web.WebSocketResponse, list[str]] = {}

    def show(self, seat_id: str, parts: Parts) -> None:
        """Bring every page of a seat up to date; a slow page gets only the newest."""
        latest = self._latest.setdefault(seat_id, {})
        if "rows/count" in parts:
            for name in [name for name in latest if name.startswith("rows/")]:
                del latest[name]
        latest.update(parts)
        for page, sitting in self._pages.items():
            if sitting == seat_id:
                self._wakes[page].set()

    def tell(self, seat_id: str, notice: str) -> None:
        """A message that is shown once, as JSON text; to all seats when `seat_id` is empty."""
        for page, sitting in self._pages.items():
            if seat_id in ("", sitting):
                self._notices[page].append(notice)
                self._wakes[page].set()

    def taken(self, seat_id: str) -> bool:
        """True when some page sits there now."""
        return seat_id in self._pages.values()

    async def serve(self, request: web.Request) -> web.WebSocketResponse:
        """One page, from opening to closing."""
        page = web.WebSocketResponse(max_msg_size=MESSAGE_BYTES, heartbeat=20, compress=True)
        await page.prepare(request)
        seat_id = request.match_info["seat"]
        self._pages[page] = seat_id
        self._sent[page], self._notices[page] = {}, []
        self._wakes[page] = asyncio.Event()
        sender = asyncio.create_task(self._send(page, seat_id))
        self._seat_taken(seat_id)
        try:
            async for message in page:
                if message.type == WSMsgType.TEXT:
                    self._receive(seat_id, message.data, is_guest(request))
        finally:
            sender.cancel()
            for table in (self._pages, self._sent, self._notices, self._wakes):
                table.pop(page, None)
            if not self.taken(seat_id):
                self._latest.pop(seat_id, None)
                self._seat_left(seat_id)
        return page

    async def close(self) -> None:
        """Say goodbye to every page."""
        for page in list(self._pages):
            await page.close()

    def _receive(self, seat_id: str, text: str, guest: bool) -> None:
        try:
            message = object_from_text(text)
        except ValueError:
            return
        gesture = gesture_from_message(seat_id, message)
        if guest and gesture is not None and not isinstance(gesture, LOOKING):
            self.tell(seat_id, self._only_looking)
        elif gesture is not None:
            self._hand_in(gesture)

    async def _send(self, page: web.WebSocketResponse, seat_id: str) -> None:
        """Send what changed since the last time, whenever there is something."""
        wake = self._wakes[page]
        wake.set()
        while True:
            await wake.wait()
            wake.clear()
            latest = self._latest.get(seat_id, {})
            # A page has cut off pieces that are no more: they are sent again when they return.
            kept = {name: text for name, text in self._sent[page].items() if name in latest}
            sent = self._sent[page] = kept
            changed = {name: text for name, text in latest.items() if sent.get(name) != text}
            notices, self._notices[page] = self._notices[page], []
            sent.update(changed)
            fields = [f"{json.dumps(name)}:{text}" for name, text in changed.items()]
            if notices:
                fields.append('"notices":[' + ",".join(notices) + "]")
            if fields:
                try:
                    await page.send_str("{" + ",".join(fields) + "}")
                except ConnectionError:
                    return


class Lines:
    """Remembers what each piece said; lines that are the same objects are not written again."""

    def __init__(self) -> None:
        self._pieces: list[tuple[list[Any], str]] = []

    def told(self, lines: list[Any]) -> dict[str, str]:
        """Parts `rows/0`, `rows/1` and so on, and how many lines there are."""
        pieces = [lines[first : first + PIECE] for first in range(0, len(lines), PIECE)]
        known = self._pieces + [([], "")] * (len(pieces) - len(self._pieces))
        self._pieces = [
            # Comparing lists asks for identity first: unchanged lines cost next to nothing.
            old if old[0] == piece and piece else (piece, _text(piece))
            for piece, old in zip(pieces, known, strict=False)
        ]
        told = {f"rows/{number}": text for number, (_, text) in enumerate(self._pieces)}
        return {"rows/count": str(len(lines)), **told}


def _text(piece: list[Any]) -> str:
    return json.dumps(piece, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
