"""The start page's server side: found and missing, uploads, links, the form, checks."""

import argparse
import errno
import json
import os
import shutil
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import cv2
import pytest

from app.block_list import block_told, blocks_in
from app.cli import CANCELLED, main
from app.folder_scan import is_plain
from app.project import read_project
from app.start import Starting, wants_start
from app.verbs.review import Visit, review
from core.doubts import Failure
from core.errors import PhotogrammetryError, ProjectError, StorageError
from core.quality.check_plan import CheckPlace
from sessions.checks import judged_parts, new_plan, version_on_disk
from sessions.decisions import DrawMask, PlaceFiducial, PlacePhoto, ReadCheck, Remark, SignBlock
from sessions.session import FILE as SESSION_FILE
from sessions.session import Session
from tests.core.scans.test_margin import scan_with_print
from tests.tiny import Tiny
from ui.review.state import Seat
from ui.words.catalogue import Teller

DISTANCE = "camera.film.principal_distance_mm"
MARKS = {"1": [-85.589, 0.091], "2": [85.303, -0.002], "3": [0.121, 85.589], "4": [-0.075, -85.322]}


@pytest.fixture
def data(tiny_block: Path, tmp_path: Path) -> Path:
    """What an archive gives, without a block.toml."""
    folder = tmp_path / "data"
    ignored = shutil.ignore_patterns("block.toml", "truth", "session*", ".*", "results")
    shutil.copytree(tiny_block, folder, ignore=ignored)
    return folder


def values_of(starting: Starting) -> dict[str, object]:
    sections = starting.found()["form"]["sections"]
    return {f"{s['table']}.{f['key']}": f["value"] for s in sections for f in s["fields"]}


def put(starting: Starting, name: str, data: bytes) -> Path:
    with starting.receive(name, len(data)) as temporary:
        temporary.write_bytes(data)
    return starting.folder / name


def broken(starting: Starting, name: str, error: OSError) -> None:
    """An upload that ends with an error after its first bytes."""
    with starting.receive(name, 3) as temporary:
        temporary.write_bytes(b"a")
        raise error


def test_an_empty_folder_says_what_it_lacks__truth(tmp_path: Path) -> None:
    found = Starting(tmp_path).found()
    assert found["found"] == found["scans"] == found["outlines"] == found["blocks"] == []
    assert ["scans", "nothing", ["scans.files"]] in found["gaps"]
    assert "scans.files" in found["form"]["missing"]
    assert ["distance", "distance", ["camera.principal_distance_mm"]] in found["gaps"]
    assert not found["form"]["ready"]
    assert list(tmp_path.iterdir()) == []


def test_files_fill_the_form_and_the_principal_distance_completes_it__truth(data: Path) -> None:
    starting = Starting(data)
    found = starting.found()
    assert found["form"]["missing"] == []
    assert [scan["why"] for scan in found["scans"]] == [""] * 6
    assert {outline["kind"] for outline in found["outlines"]} >= {"scan", "ortho", "dem", "line"}
    values = values_of(starting) | {DISTANCE: 0.21159}
    told = starting.save(values)
    assert not told["saved"]
    assert "looks like metres: write 211.59" in told["errors"][DISTANCE]
    assert not (data / "block.toml").exists()
    values |= {DISTANCE: 211.59, "camera.film.fiducials_mm": MARKS}
    assert starting.judge(values)["ready"]
    assert not (data / "block.toml").exists()
    assert starting.save(values)["saved"]
    camera = read_project(data).cameras["film"]
    assert camera.principal_distance_mm == 211.59
    assert set(camera.fiducials_mm) == set("1234")
    found = starting.found()
    assert not {"distance", "fiducials"} & {name for name, *_ in found["gaps"]}
    assert found["checks"] == []


@pytest.mark.parametrize(("key", "value", "why"), [
    ("block.crs", "EPSG:99999", "PROJ does not know the CRS"),
    ("block.crs", "EPSG:4326", "does not count in metres"),
    ("block.crs", "Czechia", "PROJ does not know the CRS"),
    ("block.heights", "EPSG:5514", "is no height system"),
    ("camera.film.fiducials_mm", [["1", [-85.6, 0.1]], ["2", [85.3, 0.0]], ["1", [0.1, 85.6]]],
     "Mark 1 is listed twice."),
])  # fmt: skip
def test_what_is_wrong_stands_at_its_field_while_others_are_empty__truth(
    data: Path, key: str, value: Any, why: str
) -> None:
    """A wrong CRS was told of the whole file, and only once all else was filled in."""
    starting = Starting(data)
    told = starting.judge(values_of(starting) | {DISTANCE: None, key: value})
    assert why in told["errors"][key]
    assert set(told["errors"]) == {key}
    saved = starting.save(values_of(starting) | {key: value})
    assert not saved["saved"]
    assert why in saved["errors"][key]


def test_comments_of_the_file_stay_and_an_unfinished_one_can_be_saved__truth(data: Path) -> None:
    starting = Starting(data)
    assert starting.save(values_of(starting))["saved"]
    file = data / "block.toml"
    file.write_text("# mine\n" + file.read_text(), encoding="utf-8")
    starting.save(values_of(starting) | {"block.name": "other"})
    text = file.read_text(encoding="utf-8")
    assert text.startswith("# mine\n")
    assert 'name = "other"' in text
    assert "FILL IN: principal distance" in text
    file.write_text("[block\n", encoding="utf-8")
    assert "is not valid TOML" in starting.found()["form"]["errors"][""]


@pytest.mark.parametrize("field", ["block.__class__", "nowhere.name", "scans.override.file.x"])
def test_fields_that_are_none_are_refused__law(data: Path, field: str) -> None:
    with pytest.raises((PhotogrammetryError, KeyError)):
        Starting(data).save({field: "x"})
    assert not (data / "block.toml").exists()


@pytest.mark.parametrize("name", [
    "../a.tif", "a/../../b.tif", "/etc/passwd", ".hidden", "a/.b/c.tif", "", "a//b.tif", "a\\b.tif",
    "results/a.tif", "session.gpkg", "x" * 300, "a\nb.tif", "a\0b", "C:a.tif", "1/2/3/4/5/6/7.tif",
])  # fmt: skip
def test_names_that_lead_elsewhere_are_refused__law(tmp_path: Path, name: str) -> None:
    (tmp_path / "block").mkdir()
    starting = Starting(tmp_path / "block")
    with pytest.raises(StorageError):
        starting.receive(name, 1)
    assert list((tmp_path / "block").iterdir()) == []


def test_an_upload_is_there_whole_or_not_at_all__law(tmp_path: Path) -> None:
    starting = Starting(tmp_path)
    assert put(starting, "scans/a.tif", b"abc").read_bytes() == b"abc"
    with pytest.raises(StorageError, match="is there already"):
        starting.receive("scans/a.tif", 3)
    with pytest.raises(ConnectionError):
        broken(starting, "scans/b.tif", ConnectionError())
    with pytest.raises(StorageError, match="the disk is full"):
        broken(starting, "scans/c.tif", OSError(errno.ENOSPC, "No space left on device"))
    with pytest.raises(StorageError, match="MB left"):
        starting.receive("scans/d.tif", 10**18)
    assert [path.name for path in (tmp_path / "scans").iterdir()] == ["a.tif"]


def test_what_was_added_can_be_taken_out_again_and_nothing_else__law(tmp_path: Path) -> None:
    (tmp_path / "scans").mkdir()
    (tmp_path / "scans" / "mine.tif").write_bytes(b"mine")
    (tmp_path / "own.tif").write_bytes(b"own")
    starting = Starting(tmp_path)
    for name in ("a.txt", "scans/b.txt", "roads/c/d.txt"):
        put(starting, name, b"abc")
    with pytest.raises(ConnectionError):
        broken(starting, "e.txt", ConnectionError())
    assert starting.found()["added"] == ["a.txt", "roads", "scans"]
    for name in ("a.txt", "scans", "roads", "own.tif", "..", "mine.tif"):
        starting.unlink(name)
    assert starting.found()["added"] == []
    left = list(tmp_path.rglob("*.t*"))
    assert sorted(path.name for path in left) == ["mine.tif", "own.tif"]
    assert not (tmp_path / "roads").exists()


def test_nothing_is_uploaded_through_a_link__law(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    block = tmp_path / "block"
    block.mkdir()
    starting = Starting(block)
    starting.link(str(tmp_path / "elsewhere"))
    with pytest.raises(StorageError, match="cannot be the name"):
        starting.receive("elsewhere/a.tif", 1)
    assert list((tmp_path / "elsewhere").iterdir()) == []


def test_a_linked_folder_is_recognised_and_can_be_let_go__truth(data: Path, tmp_path: Path) -> None:
    block = tmp_path / "block"
    block.mkdir()
    starting = Starting(block)
    starting.link(str(data / "ortho"))
    found = starting.found()
    assert found["links"] == ["ortho"]
    assert ["ortho", "ortho/*.tif"] in found["found"]
    for path in (tmp_path, block, data / "nowhere", data / "dem.tif", data / "ortho"):
        with pytest.raises(StorageError):
            starting.link(str(path))
    (block / "own.txt").write_text("kept", encoding="utf-8")
    for name in ("ortho", "own.txt", "../data"):
        starting.unlink(name)
    assert [path.name for path in block.iterdir()] == ["own.txt"]
    assert list((data / "ortho").iterdir())


def test_folders_of_this_computer_are_listed_without_their_files__truth(data: Path) -> None:
    starting = Starting(data)
    told = starting.folders(str(data))
    assert told["folders"] == ["ortho", "roads", "scans"]
    assert not told["block"]
    assert starting.folders(str(data / "scans"))["files"] == 6
    with pytest.raises(StorageError, match="cannot be read"):
        starting.folders(str(data / "nowhere"))


def test_broken_scans_and_a_reference_elsewhere_are_said_first__truth(data: Path) -> None:
    scan = sorted((data / "scans").glob("*.tif"))[0]
    scan.write_bytes(scan.read_bytes()[:20_000])
    for world in (data / "scans").glob("*.tfw"):
        lines = world.read_text().split()
        world.write_text("\n".join([*lines[:4], "-700000", "-1100000"]))
    starting = Starting(data)
    starting.save(values_of(starting) | {DISTANCE: 211.59})
    found = starting.found()
    assert [bool(one["why"]) for one in found["scans"]] == [True, False, False, False, False, False]
    checks = {name: (grave, values) for grave, name, values in found["checks"]}
    why = found["scans"][0]["why"]
    assert checks["broken"] == (False, {"count": 1, "first": scan.name, "why": why})
    assert "cut off" in why
    # Broken ones stand first: among the scans, and among what does not stop a run.
    assert [one["why"] != "" for one in found["scans"]] == [True] + 5 * [False]
    told = [name for grave, name, _ in found["checks"] if not grave]
    assert told[0] == "broken"
    assert len(told) > 1
    assert checks["outside"][0]
    assert "fiducials" in checks


def test_a_map_that_photos_do_not_fit_stops_a_run__truth(data: Path) -> None:
    starting = Starting(data)
    for crs, stops, words in (("EPSG:3857", True, "as 1.5"), ("EPSG:3035", False, "of film")):
        starting.save(values_of(starting) | {DISTANCE: 211.59, "block.crs": crs})
        checks = starting.found()["checks"]
        assert [stops] == [grave for grave, _, told in checks if words in told.get("text", "")]


def test_a_scan_that_does_not_fit_its_camera_is_said_wherever_it_stands__truth(data: Path) -> None:
    starting = Starting(data)
    starting.save(values_of(starting) | {DISTANCE: 211.59})
    scan = sorted((data / "scans").glob("*.tif"))[-1]
    picture = cv2.imread(str(scan), cv2.IMREAD_UNCHANGED)
    cv2.imwrite(str(scan), picture[: picture.shape[0] // 2])
    told = [
        (grave, values["text"])
        for grave, name, values in starting.found()["checks"]
        if name == "error"
    ]
    ((grave, text),) = told
    assert not grave
    assert scan.name in text
    assert "does not fit" in text


@pytest.mark.parametrize(
    ("distance_mm", "told"),
    [(15.192, "15.192 mm for a frame of 180 mm is a field of view of 161 degrees"),
     (1519.2, "is a field of view of 7 degrees"), (70.4, ""), (477.4, "")],
)  # fmt: skip
def test_a_principal_distance_that_no_camera_has_is_told__truth(
    data: Path, distance_mm: float, told: str
) -> None:
    """A slip of the decimal point passed; the last two are 85 and 610 mm at 230 mm, scaled."""
    starting = Starting(data)
    starting.save(values_of(starting) | {DISTANCE: distance_mm})
    typed = values_of(starting) | {DISTANCE: distance_mm}
    checks = [one for one in starting.found()["checks"] if one[1] == "distance"]
    assert starting.judge(typed)["checks"] == checks, "told while it is written, too"
    assert [grave for grave, _, _ in checks] == [False] * bool(told)
    for _, _, values in checks:
        assert told in Teller("en")("check.distance", **values)
        assert "Konstantu komory" in Teller("cs")("check.distance", **values)


def test_a_block_in_the_list_tells_figures_open_faults_and_who_signed__truth(
    tiny_run: Tiny, tmp_path: Path
) -> None:
    folder = tmp_path / "block"
    shutil.copytree(tiny_run.folder, folder)
    (one,) = Starting(folder.parent).found()["blocks"]
    assert (one["path"], one["run"], one["open"], one["signed"]) == (folder.name, True, 0, [])
    assert one["sigma"] == pytest.approx(1.0, abs=0.3)
    figures = json.loads((folder / "results" / "report.json").read_text(encoding="utf-8"))
    assert one["predicted"] == figures["certificate"]["predicted_m"] > 0
    assert one["m_p"] is None
    with Session.open(folder, "ada") as session:
        for kind in ("tone", "cut"):
            session.record(Remark("place", "", "dark", (1.0, 2.0), kind))
        session.record(Remark("decision", f"{len(session.decisions())}", "mended", closes=True))
        report = session.products.latest_value("adjustment")
        version = version_on_disk(session.products)
        judged = judged_parts(session.decisions(), report, version)
        session.record(SignBlock("accept", "", judged))
    told = block_told(folder)
    assert (told["open"], told["signed"]) == (1, [["ada", "accept", True]])
    with Session.open(folder, "bob") as session:
        session.record(Remark("place", "", "again", (1.0, 2.0), "tone"))
        plan = new_plan(
            [CheckPlace(f"{n}", n, n) for n in range(4)],
            (2, 2),
            1,
            "",
            beforehand=True,
            decisions=(),
        )
        session.record(plan)
        for place in plan.places:
            session.record(ReadCheck(place.place_id, (3.0, 4.0), (0.0, 0.0), version))
    told = block_told(folder)
    assert (told["open"], told["signed"]) == (2, [["ada", "accept", False]])
    # By the session: what was read since the report was written.
    assert told["m_p"] == pytest.approx(5.0)
    assert told["why"] == ""
    (folder / "block.toml").write_text("[scans\n", encoding="utf-8")
    assert "line 1" in f"{block_told(folder)['why']}"


def test_a_folder_of_blocks_lists_them_and_opens_one__truth(
    tiny_block: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(tiny_block, tmp_path / "many" / "one")
    (tmp_path / "many" / "empty").mkdir()
    starting = Starting(tmp_path / "many")
    bare = {"path": "one", "run": False, "written": True, "why": "", "sigma": None}
    bare |= {"predicted": None, "m_p": None, "open": 0, "signed": []}
    assert starting.found()["blocks"] == [bare]
    # Scans beside blocks, for which nobody has written a block.toml yet.
    shutil.copytree(tiny_block / "scans", tmp_path / "many" / "new" / "scans")
    shutil.copytree(tiny_block / "ortho", tmp_path / "many" / "shared")
    new = bare | {"path": "new", "written": False}
    assert starting.found()["blocks"] == [bare, new]
    assert blocks_in(tmp_path / "many") == ["one"]
    monkeypatch.setattr("app.start.MOST_LISTED", 0)
    assert (starting.found()["blocks"], starting.found()["unlisted"]) == ([new], 1)
    assert blocks_in(tmp_path / "many" / "one") == []
    with pytest.raises(PhotogrammetryError):
        starting.open("nowhere")
    assert not starting.over.is_set()
    starting.open("one")
    assert starting.over.is_set()
    assert starting.chosen == tmp_path / "many" / "one"


def test_what_a_setting_makes_again_is_told__truth(tiny_run: Any, tmp_path: Path) -> None:
    starting = Starting(tiny_run.folder)
    assert not wants_start(tiny_run.folder)
    assert wants_start(tmp_path)
    found = starting.found()
    assert found["made"]
    assert found["ahead"] == []
    kept = (tiny_run.folder / SESSION_FILE).read_bytes()
    with Session.open(tiny_run.folder, "ada") as session:
        session.record(ReadCheck("1-01", None, None, "m", "blurred"))
    assert starting.found()["ahead"] == [], "a reading moves no photo"
    name, corners = tiny_run.names[0], ((0.0, 0.0), (40.0, 0.0), (0.0, 40.0))
    pairs = tuple((*corner, *corner) for corner in corners)
    for said, first in (
        (DrawMask(name, corners, 0.0, hides=True), "localisation"),
        (PlacePhoto(name, pairs), "georeference"),
    ):
        with Session.open(tiny_run.folder, "ada") as session:
            session.record(said)
        assert starting.found()["ahead"][0] == first
    (tiny_run.folder / SESSION_FILE).write_bytes(kept)
    file = tiny_run.folder / "block.toml"
    before = file.read_text(encoding="utf-8")
    # Before anything is saved.
    values = values_of(starting)
    distance = next(key for key in values if key.endswith(".principal_distance_mm"))
    for metres, ahead in ((211.59, None), (211.6, "scans"), (0.2116, None)):
        told = starting.judge(values | {distance: metres})
        assert next(iter(told["ahead"]), None) == ahead
        assert told["ready"] is (metres > 1)
    assert file.read_text(encoding="utf-8") == before
    try:
        file.write_text(before + "\n[adjustment]\nrisk = 0.002\n", encoding="utf-8")
        last = ["adjustment", "orthos", "mosaic", "report"]
        assert starting.found()["ahead"] == last
        file.write_text(before.replace("ortho_sigma_m = 0.25", "ortho_sigma_m = 0.3"), "utf-8")
        assert starting.found()["ahead"][-4:] == last
        assert "scans" not in starting.found()["ahead"]
        changed = before.replace("principal_distance_mm = 211.59", "principal_distance_mm = 211.6")
        file.write_text(changed, encoding="utf-8")
        assert starting.found()["ahead"][0] == "scans"
    finally:
        file.write_text(before, encoding="utf-8")
    with Session.open(tiny_run.folder, "reader") as session:
        assert session.products.latest_value("walked")


def test_a_session_that_cannot_be_opened_leaves_the_form_and_says_why__law(tiny_run: Any) -> None:
    """The page stayed empty for ever."""
    session = tiny_run.folder / SESSION_FILE
    kept = session.read_bytes()
    try:
        session.write_bytes(b"no database at all" * 100)
        starting = Starting(tiny_run.folder)
        found = starting.found()
        assert found["form"]["sections"]
        assert found["ahead"] == []
        assert [SESSION_FILE in values["text"] for grave, _, values in found["checks"] if grave]
        assert starting.judge(values_of(starting))["checks"][-1] == found["checks"][-1]
    finally:
        session.write_bytes(kept)


def test_a_field_that_another_saved_meanwhile_is_not_replaced_unseen__law(data: Path) -> None:
    """The later of two start pages won, and nobody was told."""
    starting = Starting(data)
    seen: dict[str, object] = {DISTANCE: None}
    # What the folder proposed was written by nobody.
    for distance in (211.59, 153.0):
        starting.save(values_of(starting) | {DISTANCE: distance}, seen)
        seen = {DISTANCE: distance}
    known, name = values_of(starting), "block.name"
    late = known | {DISTANCE: 180.0, name: "late"}
    with pytest.raises(ProjectError, match="principal_distance_mm"):
        starting.save(late, {DISTANCE: 211.59, name: known[name]})
    assert values_of(starting) == known
    assert starting.save(late | {DISTANCE: 153.0}, {DISTANCE: 211.59})["saved"], "the same is none"
    assert starting.save(late, {DISTANCE: 153.0})["saved"]
    assert values_of(starting)[DISTANCE] == 180.0


def test_who_saves_changes_what_he_wrote_and_nothing_that_another_wrote_meanwhile__law(
    data: Path,
) -> None:
    """The whole form went back, as it was when the page was opened."""
    starting = Starting(data)
    pixel, name = "scans.scan_pixel_um", "block.name"
    assert starting.save(
        values_of(starting) | {DISTANCE: 211.59, pixel: 20.0}, {DISTANCE: None, pixel: None}
    )
    mine = values_of(starting)
    assert mine["reference.ortho_sigma_m"] is not None
    starting.save(mine | {DISTANCE: 153.0}, {DISTANCE: 211.59})
    starting.save(mine | {pixel: 15.0, name: None}, {pixel: 20.0})
    now = values_of(starting)
    assert (now[DISTANCE], now[pixel], now[name]) == (153.0, 15.0, mine[name])
    # What the folder proposes is written with the rest, unless it was emptied by hand.
    file = data / "block.toml"
    lines = file.read_text(encoding="utf-8").splitlines()
    sigmas = [line for line in lines if line.startswith(("ortho_sigma_m", "dem_sigma_m"))]
    assert len(sigmas) == 2
    file.write_text("\n".join(line for line in lines if line not in sigmas), encoding="utf-8")
    proposed = values_of(starting)
    starting.save(proposed | {"reference.dem_sigma_m": None}, {"reference.dem_sigma_m": None})
    text = file.read_text(encoding="utf-8")
    assert "\northo_sigma_m" in text
    assert "\ndem_sigma_m" not in text


def test_a_scan_that_was_cut_off_is_not_counted_and_a_readme_is_told__truth(data: Path) -> None:
    """It was counted among those found beside a picture that said it cannot be read."""
    (data / "readme.txt").write_text("About these scans.\n", encoding="utf-8")
    (data / "about.pdf").write_bytes(b"%PDF")
    first, *others = sorted((data / "scans").glob("*.tif"))
    (data / "scans" / f"{first.name}.aux.xml").touch()
    first.write_bytes(first.read_bytes()[:-2000])
    (data / "scans" / "text.tif").write_text("No picture.", encoding="utf-8")
    (data / "session.gpkg-wal").touch()
    (data / "block.toml").write_text("[block]\n", encoding="utf-8")
    found = Starting(data).found()
    assert dict(found["found"])["scans"].startswith(f"{len(others)}: ")
    assert [scan["file"] for scan in found["scans"] if scan["why"]] == [first.name, "text.tif"]
    named = {
        name: [v["file"] for n, v in found["notes"] if n == name] for name, _ in found["notes"]
    }
    broken = {f"scans/{first.name}": "was cut off: its", "scans/text.tif": "not an image"}
    assert set(named.pop("broken")) == set(broken)
    assert named == {"unused": ["about.pdf", "readme.txt"]}
    why = {v["file"]: v["why"] for n, v in found["notes"] if n == "broken"}
    for language in ("en", "cs"):
        for file, part in broken.items():
            told = Teller(language)("found.note.broken", file=file, why=why[file])
            assert file in told
            assert Teller(language).again(why[file]) in told
            assert part in why[file]


def test_a_field_says_what_is_to_be_typed_into_it__truth(data: Path) -> None:
    """Brackets and quotes of the file were asked for, and some only once others were mended."""
    starting = Starting(data)
    values = values_of(starting) | {
        DISTANCE: "abc", "camera.film.frame_mm": [18, "x", 18, "cm"], "scans.taken": "May",
        "camera.film.fiducials_mm": {"1": [84.5]},
    }  # fmt: skip
    told = starting.judge(values)["errors"]
    assert set(told) == {DISTANCE, "camera.film.frame_mm", "scans.taken",
                         "camera.film.fiducials_mm"}  # fmt: skip
    assert told["camera.film.frame_mm"].startswith("2 numbers belong here. Write digits alone and")
    assert told[DISTANCE] == "This is not a number. Write digits alone, such as 12.5."
    assert "[" not in "".join(told.values())


def test_an_accuracy_that_pixels_cannot_bear_is_asked_about__truth(data: Path) -> None:
    """An ortho of 10 m was taken at 0.25 m without a word, and the block passed."""
    starting = Starting(data)
    (reference,) = (s for s in starting.found()["form"]["sections"] if s["table"] == "reference")
    shown = {field["key"]: field for field in reference["fields"]}
    sigmas = {name: shown[f"{name}_sigma_m"] for name in ("ortho", "dem")}
    assert [one["more"] for one in sigmas.values()] == [False, False]
    assert [one["value"] for one in sigmas.values()] == [0.8, 1.0]
    assert [one["why"] for one in sigmas.values()] == [["ortho", 0.8], ["dem", 5.0]]
    values = values_of(starting) | {DISTANCE: 211.59, "camera.film.fiducials_mm": MARKS}
    for ortho, dem, asked in ((0.8, 1.0, []), (0.21, 0.13, []), (0.19, 0.12, ["ortho", "dem"])):
        stated = {"reference.ortho_sigma_m": ortho, "reference.dem_sigma_m": dem}
        assert starting.save(values | stated)["saved"]
        told = [(grave, name) for grave, name, _ in starting.found()["checks"]]
        assert told == [(False, f"fine.{name}") for name in asked]
    (ortho, _) = (values for _, _, values in starting.found()["checks"])
    assert ortho == {"stated": 0.19, "pixel": 0.8, "expected": 0.8}


def test_what_is_required_is_marked_unless_points_do__truth(data: Path) -> None:
    def marked() -> set[str]:
        (reference,) = (s for s in Starting(data).found()["form"]["sections"]
                        if s["table"] == "reference")  # fmt: skip
        return {field["key"] for field in reference["fields"] if field["required"]}

    assert marked() == {"ortho", "dem"}
    starting = Starting(data)
    assert starting.save(values_of(starting) | {DISTANCE: 211.59})["saved"]
    assert marked() == {"ortho", "dem"}
    points = {"control.points": "points.csv", "reference.ortho": None, "reference.dem": None}
    (data / "points.csv").write_text("id,X,Y,Z\n1,1,1,1\n", encoding="utf-8")
    starting.save(values_of(starting) | points)
    assert "points.csv" in (data / "block.toml").read_text("utf-8")
    assert "ortho" not in marked()


def test_a_block_in_a_read_only_folder_is_opened_for_looking__law(
    tiny_run: Tiny, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was refused. Root may write anywhere: the system's answer is put in its place."""
    folder = tmp_path / "block"
    shutil.copytree(tiny_run.folder, folder)
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    may = os.access
    monkeypatch.setattr("os.access", lambda path, mode: mode != os.W_OK and may(path, mode))
    monkeypatch.setattr(Session, "open", lambda *_: pytest.fail("opened for writing"))
    opened: list[Any] = []

    def open_and_leave(inputs: Any) -> Any:
        opened.append(inputs)
        raise KeyboardInterrupt

    monkeypatch.setattr("app.verbs.review.open_desk", open_and_leave)
    said: list[str] = []
    given = argparse.Namespace(block=folder, port=0, address="", no_browser=True, operator="ada",
                               host="127.0.0.1", language="")  # fmt: skip
    with pytest.raises(KeyboardInterrupt):
        Visit(given, cast("Any", SimpleNamespace(say=said.append))).through_desk()
    assert opened[0].looking
    assert "nothing can be decided" in said[0]
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*")} == before


@pytest.mark.parametrize("ran", [True, False])
def test_after_a_run_or_settings_the_desk_opens_with_the_drafts_it_left__law(
    tiny_run: Tiny, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ran: bool
) -> None:
    folder = tmp_path / "block"
    shutil.copytree(tiny_run.folder, folder)
    opened: list[Any] = []
    left = (Seat("seat-1", "ada", marks=(PlaceFiducial("a", "1", 2.0, 3.0),)),)
    page = SimpleNamespace(port=0, token="", url="", guest_url="", wait=lambda: not ran, ran=ran,
                           leaving=SimpleNamespace(told={"who": ""}),
                           loop=SimpleNamespace(left=left))  # fmt: skip

    def open_once(inputs: Any) -> Any:
        opened.append(inputs)
        if len(opened) > 1:
            raise KeyboardInterrupt
        return nullcontext(page)

    monkeypatch.setattr("app.verbs.review.open_desk", open_once)
    monkeypatch.setattr(Visit, "through_start", lambda *_: None)
    given = argparse.Namespace(block=folder, port=0, address="", no_browser=True, operator="ada",
                               host="127.0.0.1", language="")  # fmt: skip
    with pytest.raises(KeyboardInterrupt):
        review(given, cast("Any", SimpleNamespace(say=lambda _: None)))
    assert [inputs.left for inputs in opened] == [(), left]


def test_a_block_named_by_its_file_is_opened_as_by_its_folder__law(
    tiny_block: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that was never run was refused: run it first."""
    opened: list[Path] = []

    def open_and_leave(folder: Path, *_: object) -> Any:
        opened.append(folder)
        raise KeyboardInterrupt

    monkeypatch.setattr("app.verbs.review.open_start", open_and_leave)
    for named in (tiny_block, tiny_block / "block.toml"):
        assert main(["review", str(named), "--no-browser"]) == CANCELLED
    assert opened == [tiny_block, tiny_block]


def test_plain_names__truth() -> None:
    assert is_plain("LMSA08.1938 (2).tif")
    assert is_plain("sn\u00edmek.tif")
    assert not is_plain(".part")


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_the_margin_of_a_scan_is_told_and_writes_nothing__truth(tmp_path: Path) -> None:
    scan_with_print(tmp_path / "0001.tif", "bottom")
    starting = Starting(tmp_path)
    starting.found()
    for values in ({}, {"camera.film.frame_mm": [80, "a"], "scans.scan_pixel_um": 100.0}):
        told = starting.margin("0001", values)["fields"]
        assert [(one["value"], one["key"]) for one in told] == [("1972-02-24", "scans.taken")]
    assert [path.name for path in tmp_path.iterdir()] == ["0001.tif"]
    with pytest.raises(PhotogrammetryError, match="no scan called 0002"):
        starting.margin("0002", {})


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
def test_where_nothing_reads_print_it_is_told_as_that__truth(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The page asked for a terminal."""
    monkeypatch.setattr("app.start.installed_reader", lambda: Failure("not installed"))
    scan_with_print(tmp_path / "0001.tif", "bottom")
    starting = Starting(tmp_path)
    starting.found()
    assert starting.margin("0001", {}) == {"photo": "0001", "fields": None}
