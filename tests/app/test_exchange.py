"""Blocks go out whole or not at all, and what comes in is undone at once."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyogrio
import pytest
from pyproj.aoi import AreaOfInterest
from pyproj.transformer import TransformerGroup

from app import exchange
from app.cli import main
from app.exchange import export_block, export_target, import_into, in_block_crs, usable_part
from app.project import read_project
from core.adjustment.adjusted import AdjustmentReport
from core.errors import CrsError, ProjectError, StorageError
from core.exchange import upright_frame
from core.formats.eo_list import read_eo_list
from core.formats.exchange import (
    Conventions,
    ExchangeBlock,
    ExchangeFormat,
    ExchangeMeasurement,
    ExchangePhoto,
    ExchangePoint,
)
from core.formats.outlines import read_footprints
from core.geometry.exterior import ExteriorOrientation
from core.progress import SILENT
from core.raster.files import FILES
from sessions.decisions import BringPoints, Place, standing
from sessions.session import Session
from tests.journeys.copies import BlockCopy, copied
from tests.tiny import Tiny

HOW = Conventions("", "", "", "", "", "", "")
POINT = ExchangePoint("P1", (-544_000.0, -1_159_000.0, 300.0), (0.02, 0.02, 0.05), "check")
EXTERIOR = ExteriorOrientation(np.array([-544_000.0, -1_159_000.0, 3000.0]), 0.01, -0.02, 1.5)


@pytest.fixture
def block(tiny_block: Path, tmp_path: Path) -> BlockCopy:
    copy = copied(tiny_block, tmp_path / "block", 2)
    copy.own("block.toml")
    return copy


def taking(monkeypatch: pytest.MonkeyPatch, foreign: ExchangeBlock) -> None:
    """A format `any` whose every file holds this."""
    form = ExchangeFormat("any", "", HOW, "film", read=lambda path: foreign)
    monkeypatch.setattr(exchange, "FORMATS", {"any": form})


def giving(
    monkeypatch: pytest.MonkeyPatch, write: Callable[[Path, ExchangeBlock], tuple[str, ...]]
) -> None:
    """A format `any` of upright pixels that is written so."""
    form = ExchangeFormat("any", "", HOW, "upright", write=write)
    monkeypatch.setattr(exchange, "FORMATS", {"any": form})


def foreign_of(block: BlockCopy, **changes: object) -> ExchangeBlock:
    """One photo with orientation and a mark, one point measured in it."""
    scan = block.scans[0]
    photo = ExchangePhoto(
        scan.stem.upper(), scan.name, exterior=EXTERIOR, sigma_centre_m=(0.1, 0.2, 0.3),
        fiducials_px={"1": (10.25, 20.5)},
    )  # fmt: skip
    measured = ExchangeMeasurement("P1", photo.photo_id, 400.5, 300.25, 0.3)
    whole = ExchangeBlock(
        photos={photo.photo_id: photo}, points={"P1": POINT}, measurements=(measured,)
    )
    return replace(whole, **changes)


def test_points_measurements_orientations_and_marks_come_in__truth(
    block: BlockCopy, monkeypatch: pytest.MonkeyPatch
) -> None:
    taking(monkeypatch, foreign_of(block))
    project = read_project(block.folder)
    with Session.open(block.folder, "anna") as session:
        brought = import_into(project, session, "any", Path("list.xml"))
        decided = [one.decision for one in session.decisions()]
    assert brought.counts == {"points": 1, "measurements": 1, "exteriors": 1, "fiducials": 1}
    name = block.scans[0].stem
    assert isinstance(decided[0], BringPoints)
    assert decided[0].points[0].role == "check"
    assert decided[0].points[0].sigma_m == POINT.sigma_m
    assert decided[1] == Place("P1", name, 400.5, 300.25, 0.3)
    again = read_project(block.folder)
    record = read_eo_list(again.scans.exterior)[name]
    assert record.centre == tuple(EXTERIOR.centre)
    assert record.angles == pytest.approx((0.01, -0.02, 1.5), abs=1e-15)
    assert record.sigma_centre_m == (0.1, 0.2, 0.3)
    assert [file.name for file in again.scans.fiducial_measures] == [
        f"MeasuresIm-{block.scans[0].name}.xml"
    ]


def test_positions_without_angles_come_in__oracle(block: BlockCopy) -> None:
    """A log of GNSS positions in degrees, by the way PROJ takes; angles stay unknown."""
    names = [scan.stem for scan in block.scans[:2]]
    log = block.folder / "gnss.csv"
    rows = [f"{names[0]},17.5,49.5,2100,0.4,0.4,0.6", f"{names[1]},17.51,49.5,2101,0.4,0.4,0.6"]
    heads = "scan,X,Y,Z,sigma_X,sigma_Y,sigma_Z"
    log.write_text("\n".join(["# CRS: EPSG:4326", heads, *rows]))
    with Session.open(block.folder, "anna") as session:
        brought = import_into(read_project(block.folder), session, "eo", log)
    assert brought.counts == {"positions": 2}
    records = read_eo_list(read_project(block.folder).scans.exterior)
    project = read_project(block.folder)
    area = AreaOfInterest(17.5, 49.5, 17.51, 49.5)
    way = TransformerGroup("EPSG:4326", project.block.crs, always_xy=True, area_of_interest=area)
    assert list(records) == names
    for record, degrees in zip(records.values(), ((17.5, 49.5), (17.51, 49.5)), strict=True):
        assert record.angles is None
        assert record.sigma_centre_m == (0.4, 0.4, 0.6)
        assert record.centre[:2] == pytest.approx(way.transformers[0].transform(*degrees), abs=1e-3)
    assert [record.centre[2] for record in records.values()] == [2100.0, 2101.0]


def test_an_import_is_undone_at_once__law(
    block: BlockCopy, monkeypatch: pytest.MonkeyPatch
) -> None:
    taking(monkeypatch, foreign_of(block))
    with Session.open(block.folder, "anna") as session:
        import_into(read_project(block.folder), session, "any", Path("list.xml"))
        session.undo()
        left = [one.decision for one in standing(session.decisions())]
    assert not [one for one in left if isinstance(one, BringPoints | Place)]


def test_a_file_of_another_block_changes_nothing__law(
    block: BlockCopy, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = ExchangePhoto("DSC_0001", "DSC_0001.JPG", exterior=EXTERIOR)
    taking(monkeypatch, foreign_of(block, photos={"DSC_0001": other}, measurements=()))
    before = (block.folder / "block.toml").read_text()
    with Session.open(block.folder, "anna") as session:
        with pytest.raises(ProjectError, match=r"knows no scan of this block.*DSC_0001"):
            import_into(read_project(block.folder), session, "any", Path("list.xml"))
        assert not session.decisions()
    assert (block.folder / "block.toml").read_text() == before


def test_scans_with_blanks_are_known_by_their_words__truth(
    block: BlockCopy, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As formats in which blanks part the columns call them."""
    scan = block.scans[0].rename(block.scans[0].with_name("LMS 1938.tif"))
    photo = ExchangePhoto("LMS_1938", "LMS_1938.tif", exterior=EXTERIOR)
    taking(monkeypatch, foreign_of(block, photos={photo.photo_id: photo}, measurements=()))
    with Session.open(block.folder, "anna") as session:
        import_into(read_project(block.folder), session, "any", Path("list.xml"))
    assert list(read_eo_list(read_project(block.folder).scans.exterior)) == [scan.stem]


def test_another_projection_turns_the_photos__oracle(block: BlockCopy) -> None:
    """Grid norths of S-JTSK and UTM differ there by what pyproj says of their convergences."""
    from pyproj import Proj

    at_home = foreign_of(block, crs="EPSG:5514")
    out = in_block_crs(at_home, "EPSG:32633", Path("list.xml"))
    back = in_block_crs(out, "EPSG:5514", Path("list.xml"))
    name = next(iter(out.photos))
    longitude, latitude = Proj("EPSG:32633")(*out.photos[name].exterior.centre[:2], inverse=True)
    turns = [
        Proj(crs).get_factors(longitude, latitude).meridian_convergence
        for crs in ("EPSG:5514", "EPSG:32633")
    ]
    change = np.degrees(out.photos[name].exterior.kappa - EXTERIOR.kappa)
    assert abs(abs(change) - abs(turns[0] - turns[1])) < 0.01
    assert np.allclose(back.photos[name].exterior.centre, EXTERIOR.centre, atol=1e-3)
    assert np.allclose(
        back.photos[name].exterior.object_from_image, EXTERIOR.object_from_image, atol=1e-6
    )


def test_orientations_in_degrees_are_refused__law(block: BlockCopy) -> None:
    with pytest.raises(CrsError, match="no map projection"):
        in_block_crs(foreign_of(block, crs="EPSG:4326"), "EPSG:5514", Path("list.xml"))


def last_report(tiny_run: Tiny) -> AdjustmentReport:
    with Session.open(tiny_run.folder, "anna") as session:
        return session.products.latest_value("adjustment")


def test_scans_laid_upright_show_what_the_measurements_say__truth(
    tiny_run: Tiny, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The grey value of a place is the same in the scan and in the upright photo."""
    monkeypatch.setattr(exchange, "FORMATS", {})
    giving(monkeypatch, lambda path, block: ())
    report = last_report(tiny_run)
    with Session.open(tiny_run.folder, "anna") as session:
        done = export_block(
            session, report.block, report, "any", tmp_path / "out", pictures=True, progress=SILENT
        )
    for name, photo in report.block.photos.items():
        frame = upright_frame(photo, report.block.camera_of(name))
        places = np.random.default_rng(3).uniform(0.3, 0.7, (400, 2)) * photo.size_px
        moved = frame.pixel_from_film(photo.interior.film_from_pixel(places))
        with FILES.borrow(photo.scan) as scan:
            here = scan.read(1)[tuple(places.astype(int).T[::-1])].astype(float)
        with FILES.borrow(done.path / "photos" / f"{name}_upright.tif") as laid:
            there = laid.read(1)[tuple(moved.astype(int).T[::-1])].astype(float)
        assert np.corrcoef(here, there)[0, 1] > 0.9


@pytest.mark.parametrize(
    "name",
    ["odm", "opensfm", "opk", "asp", "geojson", "pix4d-points", "qgis", "metashape"],
)
def test_measurements_of_film_come_back_into_their_own_block__law(
    tiny_run: Tiny, tmp_path: Path, name: str
) -> None:
    """Pixels of scans laid upright were taken for those of the scans: 64 px off, without a word."""
    report, project = last_report(tiny_run), read_project(tiny_run.folder)
    with Session.open(tiny_run.folder, "anna") as session:
        out = tmp_path / "out"
        export_block(session, report.block, report, name, out, pictures=False, progress=SILENT)
    taken = usable_part(project, name, out, report.block, report.block.surveyed)
    # What is where the block has it stays so: no check point becomes control.
    assert not [one for one in taken.decisions if isinstance(one, BringPoints)]
    places = [one for one in taken.decisions if isinstance(one, Place)]
    assert len(places) == sum(m.used for m in report.block.measurements.values())
    for one in places:
        pixel = report.block.measurements[one.point_id, one.photo_id].pixel[0]
        # Digits that the formats leave.
        assert np.hypot(one.column - pixel[0], one.row - pixel[1]) < 0.01


def test_pixels_laid_upright_need_the_scans_to_be_oriented__law(
    block: BlockCopy, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = f"{block.scans[0].stem}_upright"
    photo = ExchangePhoto(name, f"{name}.tif")
    measured = ExchangeMeasurement("P1", name, 400.5, 300.25)
    taking(monkeypatch, foreign_of(block, photos={name: photo}, measurements=(measured,)))
    with Session.open(block.folder, "anna") as session:
        with pytest.raises(ProjectError, match="nothing tells yet how that scan lies"):
            import_into(read_project(block.folder), session, "any", Path("list.xml"))
        assert not session.decisions()


@pytest.mark.parametrize(
    ("places", "cause"),
    [
        ([(99_999.0, -500.0)], "at column 99999.0, row −500.0; the scan has 1078"),
        ([(400.5, 300.25), (410.5, 300.25)], "twice, at two places"),
    ],
)
def test_places_that_cannot_be_are_refused_whole__law(
    block: BlockCopy, monkeypatch: pytest.MonkeyPatch, places, cause
) -> None:
    photo = block.scans[0].stem.upper()
    measured = tuple(ExchangeMeasurement("P1", photo, *place) for place in places)
    taking(monkeypatch, foreign_of(block, measurements=measured))
    before = (block.folder / "block.toml").read_text()
    with Session.open(block.folder, "anna") as session:
        with pytest.raises(ProjectError, match=cause):
            import_into(read_project(block.folder), session, "any", Path("list.xml"))
        assert not session.decisions()
    assert (block.folder / "block.toml").read_text() == before


def test_a_point_of_the_block_elsewhere_is_refused__law(tiny_run: Tiny, tmp_path: Path) -> None:
    report, project = last_report(tiny_run), read_project(tiny_run.folder)
    name, photo = next(iter(report.block.measurements))
    x, y, z = report.block.surveyed[name].position + np.array([3.0, 0.0, 0.0])
    file = tmp_path / "gcp_list.txt"
    file.write_text(f"EPSG:5514\n{x} {y} {z} 400 300 {photo}.tif {name}\n")
    with pytest.raises(ProjectError, match="of another kind that is called"):
        usable_part(project, "odm", file, report.block, report.block.surveyed)


def test_orientations_are_held_against_the_block__law(tiny_run: Tiny, tmp_path: Path) -> None:
    """Whatever way of counting somebody states: far away and below ground nothing comes in, and
    photos that are turned are told."""
    report, given = last_report(tiny_run), read_project(tiny_run.folder)

    def taken(**changes: float) -> tuple[str, ...]:
        rows = ["scan,X,Y,Z,omega,phi,kappa"]
        for name, photo in report.block.photos.items():
            (x, y, z), angles = photo.exterior.centre, np.degrees(photo.exterior.angles)
            kappa = angles[2] + changes.get("turn", 0.0)
            moved = x + changes.get("far", 0.0), y, z - changes.get("low", 0.0)
            rows.append(f"{name}," + ",".join(map(repr, map(float, (*moved, *angles[:2], kappa)))))
        file = tmp_path / "list.csv"
        file.write_text("\n".join([*rows, ""]))
        known = report.block.surveyed
        return usable_part(given, "eo-opk-deg", file, report.block, known).brought.notes

    assert not [note for note in taken() if "turned" in note]
    assert [note for note in taken(turn=180.0) if "turned by 180 degrees" in note]
    with pytest.raises(ProjectError, match="lie 871 km from where the block has them"):
        taken(far=871_000.0)
    with pytest.raises(ProjectError, match="lies below the ground"):
        taken(low=10_000.0)
    # Where lists alone placed the photos, this one may correct an earlier one.
    given = replace(given, reference=replace(given.reference, ortho=()))
    assert [note for note in taken(far=871_000.0, low=10_000.0) if "871 km from where" in note]


def test_a_check_point_stays_one_whatever_the_file_knows__law(
    block: BlockCopy, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before anything was run, a format without roles made control of it."""
    listed = "id,X,Y,Z,sigma_xy,sigma_z,role\nP1,-577500,-1192900,300,0.02,0.03,check\n"
    (block.folder / "points.csv").write_text(listed)
    with (block.folder / "block.toml").open("a") as file:
        file.write('\n[control]\npoints = "points.csv"\n')
    for place, told in (((-577_500.0, -1_192_900.0, 300.0), "stays as the block has"),
                        ((-577_490.0, -1_192_900.0, 300.0), "moves to the place")):  # fmt: skip
        point = ExchangePoint("P1", place)
        taking(monkeypatch, foreign_of(block, points={"P1": point}))
        with Session.open(block.folder, "anna") as session:
            brought = import_into(read_project(block.folder), session, "any", Path("list.xml"))
            decided = [one.decision for one in session.decisions()]
        assert any(told in note for note in brought.notes), brought.notes
    (moved,) = [one for one in decided if isinstance(one, BringPoints)]
    assert (moved.points[0].role, moved.points[0].sigma_m) == ("check", (0.02, 0.02, 0.03))


def test_measured_points_without_coordinates_are_named__law(
    block: BlockCopy, monkeypatch: pytest.MonkeyPatch
) -> None:
    taking(monkeypatch, foreign_of(block, points={}))
    with Session.open(block.folder, "anna") as session:
        brought = import_into(read_project(block.folder), session, "any", Path("list.xml"))
    assert [note for note in brought.notes if "no coordinates" in note and "P1" in note]


def test_lists_are_not_named_where_nothing_could_be_recorded__law(
    block: BlockCopy, monkeypatch: pytest.MonkeyPatch
) -> None:
    taking(monkeypatch, foreign_of(block))
    before = (block.folder / "block.toml").read_text()

    def full(*_: object) -> None:
        raise StorageError(block.folder, "is full.", "Make room.")

    with Session.open(block.folder, "anna") as session:
        monkeypatch.setattr(session, "record_all", full)
        with pytest.raises(StorageError):
            import_into(read_project(block.folder), session, "any", Path("list.xml"))
    assert (block.folder / "block.toml").read_text() == before


def test_an_export_that_fails_leaves_nothing__law(
    tiny_run: Tiny, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def half(path: Path, block: ExchangeBlock) -> tuple[str, ...]:
        (path / "half.txt").write_text("half")
        raise ProjectError(path, "no.", "No.")

    giving(monkeypatch, half)
    report = last_report(tiny_run)
    with (
        Session.open(tiny_run.folder, "anna") as session,
        pytest.raises(ProjectError),
    ):
        export_block(
            session, report.block, report, "any", tmp_path / "out", pictures=False, progress=SILENT
        )
    assert not list(tmp_path.iterdir())


def test_an_export_takes_the_place_of_nothing_but_an_export__law(
    tiny: Tiny, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def write(path: Path, block: ExchangeBlock) -> tuple[str, ...]:
        (path / "ours.txt").write_text("ours")
        return ()

    def export(out: Path | None) -> Path:
        with Session.open(home, "anna") as session:
            return export_block(
                session, tiny.block, None, "any", out, pictures=False, progress=SILENT
            ).path

    giving(monkeypatch, write)
    home, out = tmp_path / "home", tmp_path / "project"
    for target in (None, out):
        mine = export(target) / "mine.txt"
        export(target)
        mine.write_text("mine")
        with pytest.raises(StorageError, match=r"holds mine.txt, which no export wrote"):
            export(target)
        assert mine.read_text() == "mine"
    for folder, cause in ((home, "holds"), (tmp_path, "holds"), (out / "mine.txt", "is a file")):
        with pytest.raises(StorageError, match=cause):
            export(folder)
    monkeypatch.chdir(home)
    with pytest.raises(StorageError, match="is the folder you are in"):
        export(Path("."))
    assert (out / "mine.txt").read_text() == "mine"


def test_a_tangent_frame_says_where_it_lies__law(
    tiny_run: Tiny, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Photos stand as far from each other as on the map, but for its scale (below 2e-4)."""
    seen: dict[str, ExchangeBlock] = {}

    def keep(path: Path, block: ExchangeBlock) -> tuple[str, ...]:
        seen["out"] = block
        return ()

    giving(monkeypatch, keep)
    report = last_report(tiny_run)
    with Session.open(tiny_run.folder, "anna") as session:
        done = export_block(
            session, report.block, report, "any", tmp_path / "out", pictures=False,
            progress=SILENT, tangent=True,
        )  # fmt: skip
    assert any("longitude" in note for note in done.notes)
    ours = np.array([p.exterior.centre for p in report.block.photos.values()])
    there = np.array([p.exterior.centre for p in seen["out"].photos.values()])
    apart = [np.linalg.norm(np.diff(one[:, :2], axis=0), axis=1) for one in (ours, there)]
    assert np.allclose(apart[1] / apart[0], 1.0, atol=1e-3)
    assert np.abs(there[:, :2]).max() < 5000


@pytest.mark.parametrize("ending", ["gpkg", "geojson", "fgb", "shp"])
def test_footprints_of_a_film_block_go_out__truth(
    tiny_run: Tiny, tmp_path: Path, ending: str
) -> None:
    """Whole as any export is: the name of the layer is not that of the temporary."""
    report, out = last_report(tiny_run), tmp_path / f"out.{ending}"
    with Session.open(tiny_run.folder, "anna") as session:
        export_block(
            session, report.block, report, "footprints", out, pictures=False, progress=SILENT
        )
    (layer,) = pyogrio.list_layers(out)
    assert layer[0] == ("out" if ending == "shp" else "footprints")
    found = read_footprints(out, "LMS_TIF_UP", list(report.block.photos))
    for name, one in found.by_photo.items():
        photo, camera = report.block.photos[name], report.block.camera_of(name)
        width, height = np.array(camera.frame_mm) / camera.principal_distance_mm
        above = float(photo.exterior.centre[2]) - photo.ground_height_m
        # Relief and tilt change the area by some hundredths.
        assert one.polygon.area == pytest.approx(width * height * above**2, rel=0.1)
    assert set(found.by_photo) == set(report.block.photos)


def test_a_table_of_points_comes_in_from_the_command_line__truth(
    block: BlockCopy, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A refused row is asked about; the answer brings the others, and nothing before it."""
    listed = tmp_path / "list.csv"
    listed.write_text("id;X;Y;Z\nA;-577500,5;-1192900,25;300\nB;-577600;-1192800;here\n")
    asked = ["import", str(block.folder), "--from", "points", str(listed)]
    assert main(asked) == 1
    assert "refused='leave out'" in capsys.readouterr().out
    assert main([*asked, "--answer", "refused=leave out"]) == 0
    with Session.open(block.folder, "anna") as session:
        (brought,) = [one.decision for one in session.decisions()]
    assert isinstance(brought, BringPoints)
    assert [point.point_id for point in brought.points] == ["A"]
    with pytest.raises(SystemExit, match="2"):
        main([*asked, "--answer", "colour=red"])
    assert "answers nothing" in capsys.readouterr().err


def test_what_comes_in_may_tell_where_the_block_lies__truth(
    block: BlockCopy, tmp_path: Path
) -> None:
    text = (block.folder / "block.toml").read_text()
    block.replace("block.toml", re.sub(r"\[reference\]\n(.+\n)+", "", text))
    listed = tmp_path / "gcp_list.txt"
    listed.write_text(f"EPSG:5514\n-577500 -1192900 300 400 300 {block.scans[0].name} A\n")
    assert main(["import", str(block.folder), "--from", "odm", str(listed)]) == 0
    assert read_project(block.folder).reference.ortho == ()


def test_a_format_that_is_none_is_wrong_use__law(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["import", "--from", "fax", "list.csv"])
    assert "it is one of" in capsys.readouterr().err


def test_an_export_to_a_file_spares_the_block_and_what_is_called_otherwise__law(tmp_path):
    """A slip of the shell's completion must cost no scan."""
    outside, home = tmp_path / "old.txt", tmp_path / "home"
    outside.write_text("", encoding="utf-8")
    with Session.open(home, "anna") as session:
        assert export_target(session, "odm", outside) == outside.resolve()
        for target in (home / "notes.txt", tmp_path / "scan.tif"):
            assert export_target(session, "odm", target) == target.resolve()
            target.write_text("mine", encoding="utf-8")
            with pytest.raises(StorageError, match=f"{target.name}: is already there"):
                export_target(session, "odm", target)
