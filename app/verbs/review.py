"""The review desk and the pages before it."""

import argparse
import webbrowser
from dataclasses import replace
from pathlib import Path

from app.block_list import blocks_in
from app.block_toml import folder_of
from app.desk.inputs import desk_inputs
from app.desk.wiring import OpenDesk, open_desk
from app.placing import Placing, open_placing, placeable
from app.project import Project, read_project
from app.start import open_start, wants_start
from app.terminal import Voice
from core.said import say
from sessions.disk import may_be_written
from sessions.session import FILE, HIDDEN, Session
from ui.review.state import Seat
from ui.web.access import Door
from ui.web.front import Opened


def review(given: argparse.Namespace, voice: Voice) -> None:
    """The review desk, until Ctrl-C; what it still lacks is given on pages before it."""
    given.block = folder_of(given.block)
    visit = Visit(given, voice)
    if wants_start(given.block):
        visit.through_start(given.block)
    while visit.through_desk():
        visit.through_start(visit.block)


READ_ONLY = (
    "The block's folder may not be written: everything can be looked at, nothing can be decided."
)


class Visit:
    """One `gruber review`: pages that follow one another at one address."""

    def __init__(self, given: argparse.Namespace, voice: Voice) -> None:
        self.given, self.voice = given, voice
        self.block: Path = given.block
        self.door = Door(given.host, given.port, given.address)
        self.token = ""
        self.left: dict[str, str] | None = None
        self.drafts: dict[Path, tuple[Seat, ...]] = {}
        """Seats with drafts, as the last desk of each block left them."""
        self._opened = bool(given.no_browser)
        self.home = self.block.resolve() if blocks_in(self.block) else None

    def shown(self, page: Opened, said: str) -> None:
        """Say where a page is, and open it in the browser unless one is open there already."""
        # The pages that follow are found at the same address.
        self.door, self.token = replace(self.door, port=page.port), page.token
        self.voice.say(said)
        if not self._opened:
            webbrowser.open(page.url)
        self._opened = True

    def through_start(self, folder: Path) -> None:
        """The start page, of one folder after another, until a block has something to review."""
        given = self.given
        while True:
            with open_start(
                folder, self.door, given.language, self.token, self.left, self.home
            ) as page:
                where = "Files, settings and the run: {url}  (Ctrl-C closes)"
                self.shown(page, say(where, url=page.url))
                folder = page.wait()
            if not wants_start(folder):
                self.block = folder
                return

    def through_desk(self) -> bool:
        """The desk, or the placing page before it; True when settings are asked for there."""
        given, project = self.given, read_project(self.block)
        folder = project.folder
        looking = not may_be_written(folder, folder / HIDDEN, folder / FILE)
        if looking:
            self.voice.say(READ_ONLY)
        opened = Session.look if looking else Session.open
        with opened(folder, given.operator) as session:
            if not self.through_placing(project, session):
                return True
            inputs = desk_inputs(project, session, given.operator, self.door)
            token, left = self.token or inputs.token, self.drafts.get(folder, ())
            with open_desk(
                replace(inputs, language=given.language, token=token, looking=looking, left=left)
            ) as desk:
                opened_at = "The desk is open at {url}  (Ctrl-C closes it; nothing is lost)"
                self.shown(desk, say(opened_at, url=desk.url))
                self.voice.say(
                    say("Guests, who look and decide nothing: {url}", url=desk.guest_url)
                )
                settings = self._left(desk, desk.wait())
                ran, self.drafts[folder] = desk.ran, desk.loop.left
        return self.through_desk() if ran else settings

    def through_placing(self, project: Project, session: Session) -> bool:
        """Let a block that does not stand be placed by clicks; False when settings come first."""
        found, given = placeable(project, session), self.given
        if found is None:
            return True
        with open_placing(project, found, self.door, given.language, self.token) as placing:
            self.voice.say("No photo of this block is placed on the reference yet.")
            clicked = (
                "Two points clicked in one photo place it: {url}"
                "  (Ctrl-C closes; what was saved stays)"
            )
            self.shown(placing, say(clicked, url=placing.url))
            return not self._left(placing, not placing.wait())

    def _left(self, page: OpenDesk | Placing, asked: bool) -> bool:
        """Keeps who closed a page for its settings; where nobody gave a name, the operator."""
        told = page.leaving.told
        self.left = {**told, "who": told["who"] or self.given.operator} if asked else None
        return asked
