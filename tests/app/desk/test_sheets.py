"""Map sheets at the desk: for operators alone, told while they are made, or why they cannot be."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from app.desk.sheets import SheetMaker, sheet_routes
from core.errors import Cancelled
from sessions.session import Session
from tests.app.test_sheets import folder as folder
from tests.app.test_sheets import product, project_in
from tests.ui.web.visits import visited
from ui.web.front import result_routes


def asked(
    block: Path, address: str = "/sheets", guest: bool = False
) -> tuple[int, Mapping[str, Any], int]:
    """Status, answer, and the status of the file that it names."""

    async def visit(client: Any) -> tuple[int, Mapping[str, Any], int]:
        answer = await client.post(address, json={})
        said = await answer.json() if "json" in answer.headers["Content-Type"] else {}
        file = (await client.get(f"/results/{said['file']}")).status if "file" in said else 0
        return answer.status, said, file

    routes = [*sheet_routes(block / "block.toml"), *result_routes(block / "results")]
    return visited(routes, visit, guest)


def with_mosaic(block: Path) -> None:
    with Session.open(block, "tester") as session:
        session.products.save_value("mosaic", "0" * 64, product(block))


def test_sheets_of_a_block_are_one_button__truth(folder: Path) -> None:
    project_in(folder)
    with_mosaic(folder)
    status, said, file = asked(folder)
    assert (status, file) == (200, 200)
    assert said["said"]["values"] == {"count": 4, "files": 4, "made": 4}
    assert (folder / "results/sheets/HUST25.tif").is_file()
    assert asked(folder)[1]["said"]["values"]["made"] == 0


def test_guests_make_and_stop_none__truth(folder: Path) -> None:
    project_in(folder)
    assert asked(folder, guest=True)[0] == 403
    assert asked(folder, "/sheets/cancel", guest=True)[0] == 403


@pytest.mark.parametrize("index", [True, False])
def test_what_is_lacking_is_told__truth(folder: Path, index: bool) -> None:
    project_in(folder)
    if not index:
        text = (folder / "block.toml").read_text()
        (folder / "block.toml").write_text(text.replace('sheets = "klad.gpkg"\n', ""))
    status, said, _ = asked(folder)
    assert status == 409
    cause = "there is no mosaic to cut yet." if index else "names no map sheets."
    assert cause in str(said["error"])


def test_it_stops_when_asked_and_keeps_whole_sheets__law(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project_in(folder)
    with_mosaic(folder)
    maker = SheetMaker(folder / "block.toml")
    seen: list[dict[str, Any]] = []

    def watched(done: float, total: float, what: str = "") -> None:
        seen.append(maker.status())
        if done / total > 0.5:
            maker.cancel()
        SheetMaker.report(maker, done, total, what)

    monkeypatch.setattr(maker, "report", watched)
    assert maker.make() == {}
    assert seen[0]["busy"]
    assert not maker.status()["busy"]
    made = {path.name for path in (folder / "results/sheets").glob("*.tif")}
    assert 0 < len(made) < 4
    assert not list((folder / "results/sheets").glob(".*"))
    with pytest.raises(Cancelled):
        SheetMaker.report(maker, 1, 2)
    monkeypatch.undo()
    assert maker.make()["said"].values["made"] == 4 - len(made)
