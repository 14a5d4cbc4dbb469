"""The mosaic on disk as the desk shows it, and as edited seams will make it."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio

from app.block_sections import BlockSection
from app.desk.mosaic import MosaicFile, SheetMaker, sheet_routes
from app.desk.watched_job import WatchedJob
from app.mosaic import make_mosaic
from app.project import ListedScan, Project, ScansSection
from app.references import ReferenceSection
from core.errors import Cancelled, ProjectError
from core.mosaic.composition import MosaicProduct
from core.mosaic.seam_edits import SeamArea, SeamLine
from core.orthos.rectification import OrthoProduct
from core.progress import SILENT
from core.raster.grid import Grid
from sessions.session import Session
from tests.app.test_sheets import folder as folder
from tests.app.test_sheets import product, project_in
from tests.core.mosaic.conftest import CRS, write_ortho
from tests.ui.web.visits import visited
from ui.review.mosaic import with_seam_edits
from ui.web.front import result_routes

WEST, SOUTH = 500_000.0, 5_500_000.0
GRID = Grid.over((WEST, SOUTH, WEST + 200.0, SOUTH + 150.0), 1.0)


def write(path: Path, values: np.ndarray) -> None:
    path.unlink(missing_ok=True)
    write_ortho(path, "m", GRID, values, (WEST + 100.0, SOUTH + 100.0))


def keep(session: Session) -> Path:
    """A product that tells of a mosaic, whose file is not there yet."""
    path = session.results / "mosaic.tif"
    product = MosaicProduct(path, GRID, (), {}, 1.0)
    session.products.save_value("mosaic", session.products.digest_of("m"), product)
    return path


def test_what_was_made_last_is_shown_while_its_file_is_there__law(tmp_path: Path) -> None:
    with Session.open(tmp_path, "anna") as session:
        mosaic = MosaicFile(session, CRS)
        assert mosaic.on_disk() is None
        path = keep(session)
        assert mosaic.on_disk() is None
        write(path, np.full((150, 200), 90, np.uint8))
        shown = mosaic.on_disk()
        assert shown is not None
        assert shown.version == path.stat().st_mtime_ns // 1_000_000
        assert shown.edition == 0


def test_a_newer_version_is_read_from_the_newer_file__law(tmp_path: Path) -> None:
    with Session.open(tmp_path, "anna") as session:
        mosaic, path = MosaicFile(session, CRS), session.results / "mosaic.tif"
        assert mosaic(1, 0) is None
        write(path, np.full((150, 200), 90, np.uint8))
        first = mosaic(1, 0)
        assert first is not None
        assert np.unique(first.read_colour(GRID)).tolist() == [90]
        write(path, np.full((150, 200), 140, np.uint8))
        second = mosaic(2, 0)
        assert second is not None
        assert np.unique(second.read_colour(GRID)).tolist() == [140]


def test_sixteen_bits_are_brought_to_the_grays_of_a_screen_and_stay_clear__truth(
    tmp_path: Path,
) -> None:
    values = np.linspace(900, 9000, 150 * 200).reshape(150, 200).astype(np.uint16)
    values[:40, :50] = 0
    with Session.open(tmp_path, "anna") as session:
        write(session.results / "mosaic.tif", values)
        source = MosaicFile(session, CRS)(1, 0)
        assert source is not None
        assert source.ground_sample_distance_m == 1.0
        assert source.bounds == pytest.approx(GRID.bounds)
        colour = source.read_colour(GRID)
    # Interpolation reaches two pixels over the edge.
    assert not colour[:36, :46].any()
    shown = colour[44:, 54:, 0].astype(float)
    assert shown.min() >= 1
    expected = 255 * (values[44:, 54:] - 900.0) / 8100
    # Half a per cent at either end is cut off.
    assert np.abs(shown - expected).max() < 8


def orthos_in(session: Session) -> list[OrthoProduct]:
    """Three photos of 300 m in a row that overlap by half, each with tone and grain of its own."""
    rng = np.random.default_rng(7)
    ground = np.kron(rng.uniform(60, 180, (30, 60)), np.ones((10, 10)))
    made: list[OrthoProduct] = []
    (session.results / "ortho").mkdir()
    for number, name in enumerate("abc"):
        west = WEST + 150 * number
        grid = Grid.over((west, SOUTH, west + 300.0, SOUTH + 300.0), 1.0)
        seen = ground[:, 150 * number : 150 * number + 300] + 8 * number
        values = np.rint(seen + rng.normal(0, 6, seen.shape)).clip(1, 255).astype(np.uint8)
        nadir = (west + 150.0, SOUTH + 150.0)
        one = write_ortho(session.results / "ortho" / f"{name}.tif", name, grid, values, nadir)
        session.products.save_value(f"ortho/{name}", session.products.digest_of(name), one)
        made.append(one)
    return made


def project_of(folder: Path) -> Project:
    """The block of these photos, without buildings and roads."""
    listed = tuple(ListedScan(name, folder / f"{name}.tif", "wide", 15.0, "") for name in "abc")
    return Project(
        folder / "block.toml",
        BlockSection("row", CRS),
        {},
        ScansSection(listed),
        ReferenceSection(),
    )


LINE = ((224.0, 60.0), (200.0, 90.0), (205.0, 180.0), (224.0, 220.0))
AREA = ((330.0, 100.0), (400.0, 110.0), (380.0, 200.0))
EDITS = (
    SeamLine("a", "b", tuple((WEST + x, SOUTH + y) for x, y in LINE)),
    SeamArea("c", tuple((WEST + x, SOUTH + y) for x, y in AREA)),
)


def test_what_is_seen_before_is_what_the_file_holds_after__law(tmp_path: Path) -> None:
    with Session.open(tmp_path, "anna") as session:
        orthos, mosaic = orthos_in(session), MosaicFile(session, CRS)
        project = project_of(tmp_path)
        make_mosaic(session, project, orthos, SILENT)
        first = mosaic.on_disk()
        assert first is not None
        for edit in EDITS:
            session.record(edit)
        edited = with_seam_edits(first, EDITS)
        mosaic.publish(edited)
        ahead = mosaic(edited.version, edited.edition)
        assert ahead is not None
        whole = edited.product.grid
        seen = ahead.read_colour(whole)[..., 0]
        before = mosaic(edited.version, 0)
        assert before is not None
        unedited = before.read_colour(whole)[..., 0]
        assert (unedited != seen).mean() > 0.02
        # At the pixels of a screen, finer or coarser and beside the mosaic's, the same is seen.
        others = [
            Grid(whole.west + aside, whole.north - aside, gsd, int(580 / gsd), int(280 / gsd))
            for aside, gsd in ((0.3, 1.0), (0.3, 0.4), (1.0, 4.0), (0.0, 3.0), (0.0, 8.0))
        ]
        resampled = [ahead.read_colour(grid).astype(int) for grid in others]
        made = make_mosaic(session, project, orthos, SILENT)
        with rasterio.open(made.path) as file:
            assert np.array_equal(file.read(1), seen)
        second = mosaic.on_disk()
        assert second is not None
        assert with_seam_edits(second, EDITS).edition == 0
        after = mosaic(second.version, 0)
        assert after is not None
        for grid, expected in zip(others, resampled, strict=True):
            # Both are rounded.
            assert np.abs(after.read_colour(grid) - expected).max() <= 1
        # Withdrawn, the file is as it was at first; nothing is made twice.
        session.undo()
        session.undo()
        again = make_mosaic(session, project, orthos, SILENT)
        with rasterio.open(again.path) as file:
            assert np.array_equal(file.read(1), unedited)
        stamp = again.path.stat().st_mtime_ns
        make_mosaic(session, project, orthos, SILENT)
        assert again.path.stat().st_mtime_ns == stamp


MADE: list[Path] = []
"""Blocks whose sheets the loop was told of."""


def asked(
    block: Path, address: str = "/sheets", guest: bool = False
) -> tuple[int, Mapping[str, Any], int]:
    """Status, answer, and the status of the file that it names."""

    async def visit(client: Any) -> tuple[int, Mapping[str, Any], int]:
        answer = await client.post(address, json={})
        said = await answer.json() if "json" in answer.headers["Content-Type"] else {}
        file = (await client.get(f"/results/{said['file']}")).status if "file" in said else 0
        return answer.status, said, file

    made = sheet_routes(block / "block.toml", lambda: MADE.append(block))
    routes = [*made, *result_routes(block / "results")]
    return visited(routes, visit, guest)


def with_mosaic(block: Path) -> None:
    with Session.open(block, "tester") as session:
        session.products.save_value("mosaic", "0" * 64, product(block))


def test_sheets_of_a_block_are_one_button__truth(folder: Path) -> None:
    project_in(folder)
    with_mosaic(folder)
    status, said, file = asked(folder)
    assert (status, file) == (200, 200)
    assert MADE[-1] == folder
    assert said["said"]["values"] == {"count": 4, "files": 4, "made": 4}
    assert (folder / "results/sheets/HUST25.tif").is_file()
    assert asked(folder)[1]["said"]["values"]["made"] == 0


def test_guests_make_and_stop_none__truth(folder: Path) -> None:
    project_in(folder)
    assert asked(folder, guest=True)[0] == 403
    assert asked(folder, "/sheets/cancel", guest=True)[0] == 403
    assert folder not in MADE


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


def test_sheets_in_the_making_are_not_begun_a_second_time__law(folder: Path) -> None:
    """The second press waited, and cut them once more."""
    project_in(folder)
    with_mosaic(folder)
    maker = SheetMaker(folder / "block.toml")
    with maker.job.begun(), pytest.raises(ProjectError, match="in the making"):
        maker.make()
    assert maker.make()["said"]


def test_it_stops_when_asked_and_keeps_whole_sheets__law(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project_in(folder)
    with_mosaic(folder)
    maker = SheetMaker(folder / "block.toml")
    job, seen = maker.job, list[dict[str, Any]]()

    def watched(done: float, total: float, what: str = "") -> None:
        seen.append(job.status())
        if done / total > 0.5:
            job.cancel()
        WatchedJob.report(job, done, total, what)

    monkeypatch.setattr(job, "report", watched)
    assert maker.make() == {}
    assert seen[0]["busy"]
    assert not job.status()["busy"]
    made = {path.name for path in (folder / "results/sheets").glob("*.tif")}
    assert 0 < len(made) < 4
    assert not list((folder / "results/sheets").glob(".*"))
    with pytest.raises(Cancelled):
        WatchedJob.report(job, 1, 2)
    monkeypatch.undo()
    assert maker.make()["said"].values["made"] == 4 - len(made)
