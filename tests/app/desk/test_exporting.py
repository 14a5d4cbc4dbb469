"""Export at the desk: one file to take, for operators alone, or why it could not be."""

import asyncio
import io
import time
import zipfile
from pathlib import Path
from typing import Any

import pytest

from app import exchange
from app.desk import exporting
from app.desk.exporting import titles
from app.desk.inputs import desk_inputs
from app.project import read_project
from core.errors import ProjectError
from core.formats.exchange import Conventions, ExchangeBlock, ExchangeFormat
from core.pipeline import STAGES
from core.progress import Progress
from sessions.decisions import PlaceFiducial
from sessions.session import Session
from tests.tiny import Tiny
from tests.ui.web.visits import visited
from ui.web.access import Door
from ui.web.front import result_routes

HOW = Conventions("", "", "", "", "", "", "")


def giving(monkeypatch: pytest.MonkeyPatch, *, folder: bool, fails: bool = False) -> None:
    def write(path: Path, block: ExchangeBlock) -> tuple[str, ...]:
        if fails:
            raise ProjectError(path, "is no use.", "Take another.")
        (path / "list.txt" if folder else path).write_text(" ".join(block.photos))
        return ("One thing was left out.",)

    form = ExchangeFormat(
        "any", "Any program", HOW, "film", write, default_name="any" if folder else "any.txt",
        folder=folder,
    )  # fmt: skip
    for module in (exchange, exporting):
        monkeypatch.setattr(module, "FORMATS", {"any": form})


def asked(tiny: Tiny, address: str = "/export/any", guest: bool = False):
    """Status, answer, and the file that it names."""

    async def visit(client):
        answer = await client.post(address, json={})
        said = await answer.json() if "json" in answer.headers["Content-Type"] else {}
        file = b""
        if "file" in said:
            file = await (await client.get(f"/results/{said['file']}")).read()
        return answer.status, said, file

    with Session.open(tiny.folder, "anna") as session:
        desk = desk_inputs(read_project(tiny.folder / "block.toml"), session, "anna", Door())
        return visited([*desk.routes, *result_routes(tiny.folder / "results")], visit, guest)


def made_when(session: Session) -> dict[str, int]:
    """When each stage of the engine was made."""
    folder = session.products.folder
    paths = [path for stage in STAGES for path in (folder / stage.name).rglob("*.value")]
    return {str(path): path.stat().st_mtime_ns for path in paths}


def test_a_folder_is_taken_as_one_file__truth(
    tiny_run: Tiny, monkeypatch: pytest.MonkeyPatch
) -> None:
    giving(monkeypatch, folder=True)
    status, said, file = asked(tiny_run)
    assert status == 200
    assert said["notes"] == ["One thing was left out."]
    with zipfile.ZipFile(io.BytesIO(file)) as taken:
        assert taken.read("list.txt").decode().split() == tiny_run.names


def test_a_single_file_is_taken_as_it_is__truth(
    tiny_run: Tiny, monkeypatch: pytest.MonkeyPatch
) -> None:
    giving(monkeypatch, folder=False)
    assert asked(tiny_run)[2].decode().split() == tiny_run.names


def test_an_export_makes_nothing_of_the_engine_again__law(
    tiny_run: Tiny, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One corrected fiducial, and localisation, ties and control were computed within the POST."""
    giving(monkeypatch, folder=False)
    name = tiny_run.names[0]
    with Session.open(tiny_run.folder, "anna") as session:
        before = made_when(session)
        found = session.products.latest_value("scans").oriented[name].interior
        column, row = found.pixels[0].tolist()
        session.record(PlaceFiducial(name, found.names[0], column + 0.4, row))
    status, _, file = asked(tiny_run)
    with Session.open(tiny_run.folder, "anna") as session:
        session.undo()
        assert made_when(session) == before
    assert (status, file.decode().split()) == (200, tiny_run.names)


def test_an_error_is_told__law(tiny_run: Tiny, monkeypatch: pytest.MonkeyPatch) -> None:
    giving(monkeypatch, folder=False, fails=True)
    status, said, _ = asked(tiny_run)
    assert status == 409
    assert said["error"]["values"]["cause"] == "is no use."


def test_an_export_tells_how_far_it_is_and_stops_when_asked__law(
    tiny_run: Tiny, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Scans laid upright take minutes: nothing was shown, and a second press waited."""
    giving(monkeypatch, folder=False)

    def endless(*_: object, progress: Progress, **others: object) -> None:
        while True:
            progress.report(1, 4, "1938_01")
            time.sleep(0.01)

    monkeypatch.setattr(exporting, "export_block", endless)

    async def visit(client: Any) -> tuple[int, Any]:
        writing = asyncio.ensure_future(client.post("/export/any", json={}))
        told: dict[str, Any] = {}
        while told.get("what") != "1938_01":
            told = await (await client.get("/export")).json()
        assert told == {"busy": True, "share": 0.25, "what": "1938_01"}
        second = await client.post("/export/any", json={})
        await client.post("/export/cancel")
        answer = await (await writing).json()
        assert not (await (await client.get("/export")).json())["busy"]
        return second.status, answer

    with Session.open(tiny_run.folder, "anna") as session:
        desk = desk_inputs(read_project(tiny_run.folder / "block.toml"), session, "anna", Door())
        assert visited([*desk.routes], visit, False) == (409, {})


def test_guests_and_unknown_formats_are_turned_away__law(
    tiny_run: Tiny, monkeypatch: pytest.MonkeyPatch
) -> None:
    giving(monkeypatch, folder=True)
    assert asked(tiny_run, guest=True)[0] == 403
    assert asked(tiny_run, "/export/cancel", guest=True)[0] == 403
    assert asked(tiny_run, "/export/nothing")[0] == 404
    assert titles() == {"any": "Any program"}
