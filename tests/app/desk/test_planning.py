"""A plan drawn at the desk: a decision for the loop, or the words why there is none."""

import asyncio
import json
import shutil
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from app.desk import planning
from app.desk.messages import Measured
from app.desk.planning import plan_route, sample_route
from core.errors import Cancelled
from sessions.checks import version_on_disk
from sessions.decisions import DrawSheets, PlanChecks
from sessions.session import Session
from sessions.sheet_samples import standing_samples
from tests.app.test_sheet_sample import LOT
from tests.sessions.test_sheet_samples import cut
from tests.tiny import Tiny
from tests.ui.web.visits import visited

ADDRESS = "/checks/plan?seat=seat-1"


def planned(folder: Path) -> tuple[list[Any], list[Measured]]:
    """What a page is told line by line, and what the loop is handed."""
    handed: list[Measured] = []

    async def visit(client: Any) -> str:
        return await (await client.post(ADDRESS)).text()

    text = visited((plan_route(folder, handed.append),), visit, guest=False)
    return [json.loads(line) for line in text.splitlines()], handed


def test_a_plan_goes_to_the_loop_and_is_not_recorded_beside_it__law(
    tiny_run: Tiny, tmp_path: Path
) -> None:
    folder = tmp_path / "block"
    shutil.copytree(tiny_run.folder, folder)
    told, (one,) = planned(folder)
    assert one.seat_id == "seat-1"
    assert isinstance(one.decision, PlanChecks)
    assert one.decision.count == told[-1]["places"] >= 20
    assert told[0] == {"grid": 0, "share": 0}
    with Session.open(folder, "reader") as session:
        assert not any(isinstance(item.decision, PlanChecks) for item in session.decisions())


def test_a_block_that_was_never_run_has_no_plan__truth(tiny_block: Path) -> None:
    told, handed = planned(tiny_block)
    assert "nothing says yet where the photos lie" in str(told[-1]["error"])
    assert handed == []


def test_a_plan_nobody_waits_for_is_given_up__truth(
    tiny_block: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was drawn to its end and recorded after its page had been left."""
    given_up = threading.Event()

    def draw_slowly(*given: Any) -> None:
        drawing = given[-1]
        try:
            for step in range(1000):
                drawing.report(step % 10, 10)
                threading.Event().wait(0.01)
        except Cancelled:
            given_up.set()
            raise

    monkeypatch.setattr(planning, "draw_plan", draw_slowly)
    handed: list[Measured] = []

    async def visit(client: Any) -> list[Any]:
        answer = await client.post(ADDRESS)
        lines = [json.loads(await answer.content.readline()) for _ in range(2)]
        answer.close()
        assert await asyncio.to_thread(given_up.wait, 5)
        return lines

    first, second = visited((plan_route(tiny_block, handed.append),), visit, guest=False)
    assert (first["grid"], first["share"]) < (second["grid"], second["share"])
    assert handed == []


def test_guests_plan_nothing__law(tiny_block: Path) -> None:
    async def visit(client: Any) -> int:
        return (await client.post(ADDRESS)).status

    route = plan_route(tiny_block, lambda _: pytest.fail("handed in"))
    assert visited((route,), visit, guest=True) == 403


def test_a_sample_of_sheets_goes_to_the_loop_or_says_why_not__law(
    tiny_run: Tiny, tmp_path: Path
) -> None:
    folder = tmp_path / "block"
    shutil.copytree(tiny_run.folder, folder)
    handed: list[Measured] = []

    def drawn(guest: bool, seen: str = "") -> tuple[int, str]:
        async def visit(client: Any) -> tuple[int, str]:
            answer = await client.post(f"/checks/sheets?seat=seat-1&seen={seen}")
            return answer.status, await answer.text()

        return visited((sample_route(folder, handed.append),), visit, guest=guest)

    status, said = drawn(guest=False)
    assert status == 409
    assert "no map sheets yet" in said
    with Session.open(folder, "ada") as session:
        lot = replace(LOT, mosaic=version_on_disk(session.products))
        cut(session, lot)
    assert drawn(guest=True)[0] == 403
    assert handed == []
    assert drawn(guest=False) == (200, '{"sheets":15}')
    (one,) = handed
    assert one.seat_id == "seat-1"
    assert isinstance(one.decision, DrawSheets)
    with Session.open(folder, "reader") as session:
        assert standing_samples(session.decisions()) == ()
    # Nobody replaces a sample that is not the one on the page.
    with Session.open(folder, "bob") as session:
        session.record(one.decision)
    status, said = drawn(guest=False)
    assert status == 409
    assert "another sample" in said
    assert drawn(guest=False, seen=one.decision.digest)[0] == 200
