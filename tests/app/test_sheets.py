"""Map sheets of a block on disk: what is kept, what goes, and a disk that fills up."""

import resource
import subprocess
import sys
from collections.abc import Generator
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
import rasterio
from affine import Affine
from shapely.affinity import translate
from shapely.geometry import box

from app.block_toml import FieldError
from app.project import Project, read_project
from app.sheets import Keeper, check_sheets, make_sheets, sheet_notes, sheets_line
from app.sheets_section import SheetsSection
from app.stage_lines import notes_ahead
from core.errors import CrsError, ProjectError, ReferenceDataError
from core.mosaic.composition import MosaicProduct
from core.mosaic.seams import Seam
from core.progress import SILENT
from core.raster.grid import Grid
from core.sheets.delivery import Delivery
from sessions.session import Session
from tests.core.sheets.test_cutting import AROUND_A_CORNER, scene
from tests.core.sheets.test_map_sheets import write

TOML = """
[block]
name = "b"
crs = "EPSG:5514"
[camera.wide]
principal_distance_mm = 210.0
frame_mm = [180.0, 180.0]
[scans]
files = "1938_01.tif"
camera = "wide"
scan_pixel_um = 15.0
exterior = "eo.csv"
[ortho]
sheets = "klad.gpkg"
"""
SIDE, GSD = 600, 2.0
SEAM = Seam("1938_01", "", box(-582e3, -1_193e3, -577e3, -1_187e3))


def project_in(folder: Path, settings: str = "") -> Project:
    (folder / "block.toml").write_text(TOML + settings, encoding="utf-8")
    return read_project(folder)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("1938_01.tif", "eo.csv"):
        (tmp_path / name).touch()
    write(tmp_path / "klad.gpkg", list(AROUND_A_CORNER.values()), name=list(AROUND_A_CORNER))
    (tmp_path / "results").mkdir()
    scene(tmp_path / "results/mosaic.tif", GSD, side=SIDE)
    return tmp_path


@pytest.fixture
def session(folder: Path) -> Generator[Session]:
    with Session.open(folder, "tester") as opened:
        yield opened


def product(folder: Path) -> MosaicProduct:
    with rasterio.open(folder / "results/mosaic.tif") as file:
        grid = Grid(file.bounds.left, file.bounds.top, GSD, file.width, file.height)
        return MosaicProduct(Path(file.name), grid, (SEAM,), MappingProxyType({}), 1.0)


def made(session: Session, folder: Path, settings: str = "") -> Delivery:
    return make_sheets(session, project_in(folder, settings), product(folder), SILENT)


def names(folder: Path) -> set[str]:
    found = (folder / "results/sheets").rglob("*")
    return {path.relative_to(folder / "results/sheets").as_posix() for path in found}


def stamps(folder: Path) -> dict[str, int]:
    root = folder / "results/sheets"
    return {name: (root / name).stat().st_mtime_ns for name in names(folder) if "." in name}


def test_a_delivery_that_is_fresh_is_not_touched__law(session: Session, folder: Path) -> None:
    assert made(session, folder).made == 4
    before = stamps(folder)
    again = made(session, folder)
    assert (again.made, again.sheets) == (0, tuple(sorted(AROUND_A_CORNER)))
    assert stamps(folder) == before
    assert sheets_line(again) == "4 sheets in 4 files, 0 made now"


@pytest.mark.parametrize(
    ("formats", "files"),
    [
        (["geotiff"], {"HUST25.tif", "HUST25.tfw"}),
        (["geotiff", "jp2"], {"HUST25.tif", "HUST25.tfw", "HUST25.jp2", "HUST25.j2w"}),
    ],
)
def test_a_change_remakes_the_sheets_it_touches__truth(
    session: Session, folder: Path, formats: list[str], files: set[str]
) -> None:
    settings = f"[sheets]\nformats = {formats}\n"
    made(session, folder, settings)
    before = stamps(folder)
    with rasterio.open(folder / "results/mosaic.tif", "r+") as file:
        row, column = file.index(-580_300, -1_190_300)
        window = ((row, row + 2), (column, column + 2))
        file.write(np.full((1, 2, 2), 9, np.uint8), window=window)
    assert made(session, folder, settings).made == len(formats)
    changed = {name for name, stamp in stamps(folder).items() if before[name] != stamp}
    assert {name for name in changed if name.endswith((".tif", ".tfw", ".jp2", ".j2w"))} == files
    assert "index.gpkg" in changed


@pytest.mark.parametrize("lost", ["HUST25.tif", "HUST25.tfw"])
def test_what_somebody_took_away_is_made_again__truth(
    session: Session, folder: Path, lost: str
) -> None:
    made(session, folder)
    (folder / "results/sheets" / lost).unlink()
    assert made(session, folder).made == 1
    assert (folder / "results/sheets" / lost).is_file()


def test_what_is_no_longer_delivered_goes__truth(session: Session, folder: Path) -> None:
    both = '[sheets]\nformats = ["geotiff", "jp2"]\ncrs = ["EPSG:5513"]\n'
    assert made(session, folder, both).made == 16
    assert {"HUST25.jp2.aux.xml", "EPSG-5513/HUST25.tif"} <= names(folder)
    own = folder / "results/sheets/notes.csv"
    own.write_text("mine")
    made(session, folder, '[sheets]\nformats = ["jp2-lossy"]\n')
    left = names(folder)
    assert {"HUST25.jp2", "HUST25.j2w", "notes.csv"} <= left
    assert not [name for name in left if name.endswith(("if", "tfw", "aux.xml"))]
    assert "EPSG-5513" not in left
    with rasterio.open(folder / "results/sheets/HUST25.jp2") as file:
        assert file.nodata is None, "what the lossless file said of itself went with it"


def test_the_rule_makes_the_sheets_of_the_index__law(session: Session, folder: Path) -> None:
    by_index = {one.name: one.sha256 for one in made(session, folder).files}
    by_rule = made_by_rule(session, folder)
    assert {one.name: one.sha256 for one in by_rule.files} == by_index


def made_by_rule(session: Session, folder: Path) -> Delivery:
    project = project_in(folder, '[sheets]\nrule = "sm5"\n')
    by_rule = replace(project, sheets=replace(project.sheets, index=None))
    return make_sheets(session, by_rule, product(folder), SILENT)


FILLING = """
import resource, sys
from pathlib import Path
from tests.app.test_sheets import made, Session
folder = Path(sys.argv[1])
with Session.open(folder, "tester") as session:
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]),) * 2)
    try:
        made(session, folder, sys.argv[3])
    except Exception as error:
        print(type(error).__name__, error)
"""


@pytest.mark.parametrize("form", ["geotiff", "cog", "jp2", "jp2-lossy"])
def test_a_disk_that_fills_up_in_a_sheet_leaves_none_half__truth(
    folder: Path, session: Session, form: str
) -> None:
    settings = f'[sheets]\nformats = ["{form}"]\nlossy_percent = 60\n'
    assert resource.getrlimit(resource.RLIMIT_FSIZE)[0] == resource.RLIM_INFINITY
    told = subprocess.run(
        [sys.executable, "-c", FILLING, str(folder), "60000", settings],
        capture_output=True, text=True, check=True, cwd=Path(__file__).parents[2],
    ).stdout  # fmt: skip
    assert told.startswith("StorageError"), told
    assert "the disk is full" in told
    assert not [name for name in names(folder) if "HUST" in name or "part-" in name]
    assert made(session, folder, settings).made == 4


def test_a_sheet_that_fails_leaves_no_folder_of_its_own__truth(session: Session) -> None:
    with pytest.raises(OSError, match="full"), Keeper(session).making("cog/a.tif"):
        raise OSError("full")
    assert not (session.results / "sheets" / "cog").exists()


@pytest.mark.parametrize(
    ("settings", "cause"),
    [
        ('[sheets]\nrule = "sm10"\n', '"sm10" is not known'),
        ('[sheets]\nformats = ["png"]\n', '"png" is not known'),
        ("[sheets]\ncrs = [5513]\n", "must be a list of words"),
        ('[sheets]\ncrs = ["EPSG:1"]\n', "does not know the CRS"),
        ('[sheets]\ncrs = ["EPSG:4326"]\n', "does not count in metres"),
        ("[sheets]\nsm50 = { ABCD = [1, 2] }\n", "cannot have its north-east corner"),
        ('[sheets]\nproduct = "Ortho"\n', "is no product"),
        ("[sheets]\noverlap_m = -1\n", "can be"),
        ("[sheets]\nyear = 38\n", "can be"),
        ('[sheets]\nborder = "nowhere.gpkg"\n', "is not there"),
    ],
)
def test_settings_that_cannot_be_are_refused_with_their_line__truth(
    folder: Path, settings: str, cause: str
) -> None:
    with pytest.raises(FieldError, match=cause) as error:
        project_in(folder, settings)
    assert "block.toml:16 [sheets]" in error.value.file


def test_an_index_is_judged_before_anything_is_computed__truth(folder: Path) -> None:
    (folder / "klad.gpkg").unlink()
    write(folder / "klad.gpkg", list(AROUND_A_CORNER.values()), name=["a", "b", "b", "c"])
    with pytest.raises(ReferenceDataError, match="names are alike: b, b"):
        check_sheets(project_in(folder))


def test_an_index_of_another_place_is_told_before_anything_is_computed__truth(folder: Path) -> None:
    project = project_in(folder)
    ground = folder / "results/mosaic.tif"
    placed = replace(project, reference=replace(project.reference, ortho=(ground,)))
    sheets = check_sheets(placed)
    assert sheet_notes(placed, sheets) == ()
    moved = [replace(sheet, area=translate(sheet.area, 9e4)) for sheet in sheets]
    (told,) = sheet_notes(placed, moved)
    assert told.startswith("klad.gpkg: none of its 4 sheets lies where the reference ortho does")


def test_settings_without_sheets_are_told__truth(folder: Path) -> None:
    project = project_in(folder)
    nothing = replace(project, sheets=SheetsSection())
    assert notes_ahead(["mosaic"], nothing) == []
    (told,) = notes_ahead(["mosaic"], replace(project, sheets=SheetsSection(product="ORTO")))
    assert "[sheets] names no map sheets, so none are cut" in told


def test_a_rule_is_judged_where_the_reference_lies_before_anything_is_computed__truth(
    folder: Path,
) -> None:
    def with_rule(settings: str, corner: tuple[float, float], gsd: float = GSD) -> Project:
        ground = folder / "ground.tif"
        with rasterio.open(
            ground, "w", driver="GTiff", width=60, height=60, count=1, dtype="uint8",
            crs="EPSG:5514", transform=Affine(gsd, 0, corner[0], 0, -gsd, corner[1]),
        ) as file:  # fmt: skip
            file.write(np.full((1, 60, 60), 9, np.uint8))
        project = project_in(folder, f'[sheets]\nrule = "sm5"\n{settings}')
        sheets = replace(project.sheets, index=None)
        reference = replace(project.reference, ortho=(ground,))
        return replace(project, sheets=sheets, reference=reference)

    inside, beyond = (-590_000.0, -1_190_000.0), (-500_100.0, -1_190_000.0)
    assert sheet_notes(with_rule("", inside), check_sheets(with_rule("", inside))) == ()
    with pytest.raises(ReferenceDataError, match="nobody knows the four letters") as error:
        check_sheets(with_rule("", beyond))
    assert error.value.file.endswith("block.toml [sheets] rule")
    named = with_rule("sm50 = { UBRO = [-500000, -1180000] }\n", beyond)
    assert check_sheets(named) == ()
    # Across the edge of the one sheet that is known.
    across = with_rule("", (-575_060.0, -1_190_000.0))
    assert "ABCD = [-550000, -1180000]" in sheet_notes(across, check_sheets(across))[0]
    # An ortho of half a country says nothing of the block.
    wide = with_rule("", beyond, 4000.0)
    assert sheet_notes(wide, check_sheets(wide)) == ()
    with pytest.raises(CrsError, match="do not point east") as far:
        check_sheets(with_rule('crs = ["EPSG:2053"]\n', inside))
    assert far.value.file.endswith("block.toml [sheets] crs")


def test_a_year_is_asked_for_before_anything_is_computed__truth(folder: Path) -> None:
    with pytest.raises(ProjectError, match="nobody says when 1938_01 was taken"):
        check_sheets(project_in(folder, '[sheets]\nproduct = "ORTO"\n'))


def test_a_block_without_sheets_says_how_to_name_them__truth(folder: Path) -> None:
    project = project_in(folder)
    without = replace(project, sheets=replace(project.sheets, index=None))
    with pytest.raises(ProjectError, match="names no map sheets"):
        check_sheets(without)
