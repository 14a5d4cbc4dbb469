"""An archive whose blocks share photos and points: sound ones agree, a displaced one is told."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from app.neighbours import (
    Archive,
    KnownBlock,
    archive_of,
    namesakes,
    neighbours_among,
)
from app.neighbours_told import told_lines
from app.project import Project, read_project
from core.adjustment.block_adjustment import adjust_block
from core.errors import PhotogrammetryError
from sessions.products import Products
from sessions.session import HIDDEN
from tests.journeys.copies import gruber
from tests.neighbouring import in_utm, part_of
from tests.tiny import Tiny


def products_of(folder: Path) -> Products:
    return Products(folder / HIDDEN / "products", folder.resolve())


def keep(folder: Path, report: object, digest: str) -> None:
    """Give a block another adjustment, as its last run would have."""
    products_of(folder).save_value("adjustment", digest * 64, report)


@pytest.fixture
def archive(tiny_run: Tiny, tmp_path: Path) -> Path:
    """Two blocks of one flight with four photos each, of which two are in both."""
    names = sorted(tiny_run.photos)
    for path, left_out in (("east", (names[2], names[5])), ("west", (names[0], names[3]))):
        folder = tmp_path / "archive" / path
        shutil.copytree(tiny_run.folder, folder)
        for name in left_out:
            (folder / "scans" / f"{name}.tif").unlink()
        report = products_of(folder).latest_value("adjustment")
        kept = [name for name in names if name not in left_out]
        keep(folder, adjust_block(part_of(report.block, kept), report.options), "a")
    return tmp_path / "archive"


def displaced(folder: Path, name: str, shift_m: float) -> None:
    report = products_of(folder).latest_value("adjustment")
    photo = report.block.photos[name]
    centre = photo.exterior.centre + np.array([shift_m, 0, 0])
    moved = replace(photo, exterior=replace(photo.exterior, centre=centre))
    block = replace(report.block, photos={**report.block.photos, name: moved})
    keep(folder, replace(report, block=block), "b")


def test_sound_blocks_of_one_flight_agree__truth(archive: Path, tiny_run: Tiny) -> None:
    names = sorted(tiny_run.photos)
    figures = Archive(archive).figures()
    (pair,) = figures["pairs"]
    assert (figures["blocks"], pair["one"], pair["other"]) == (2, "east", "west")
    photos = [row for row in pair["rows"] if row["kind"] == "photo"]
    assert sorted(row["name"] for row in photos) == [names[1], names[4]]
    assert any(row["kind"] == "point" for row in pair["rows"])
    assert {row["verdict"] for row in pair["rows"]} <= {"agree", "differ"}
    assert pair["told"] == 0
    assert pair["same"]
    assert 0.2 < np.sqrt(np.mean([row["ratio"] ** 2 for row in photos])) < 2.5
    assert pair["correlation"] > 0.9
    json.dumps(figures)


def test_a_displaced_photo_is_told_by_page_and_command__truth(
    archive: Path, tiny_run: Tiny, capsys: pytest.CaptureFixture[str]
) -> None:
    name = sorted(tiny_run.photos)[1]
    known = Archive(archive)
    (sound,) = known.figures()["pairs"]
    assert sound["told"] == 0
    before = next(row for row in sound["rows"] if row["name"] == name)
    displaced(archive / "west", name, 3.0)
    # What was kept of the block is of its former adjustment.
    (pair,) = known.figures()["pairs"]
    (row,) = [row for row in pair["rows"] if row["verdict"] == "disagree"]
    assert (row["kind"], row["name"]) == ("photo", name)
    assert row["length_m"] == pytest.approx(3.0, abs=1.0)
    assert row["shift_m"][0] - before["shift_m"][0] == pytest.approx(3.0)
    told = gruber(capsys, "check", "neighbours", archive)
    assert told.code == 0
    assert "! east and west disagree: 2 photos" in told.out
    assert f"photo {name}: its ground lies" in told.out
    lines = gruber(capsys, "check", "neighbours", archive, "--log-json").out.splitlines()
    said = [json.loads(line) for line in lines]
    (found,) = [one["figures"] for one in said if one["event"] == "figures"]
    assert found["pairs"][0]["told"] == 1
    assert "neshodují" in gruber(capsys, "check", "neighbours", archive, "--language", "cs").out


def test_scans_are_known_by_their_content_or_else_by_name_and_size__truth(
    archive: Path, tiny_run: Tiny
) -> None:
    """A copy under another name is the same scan; another scan of the same name is not."""
    name = sorted(tiny_run.photos)[1]
    west, scans = archive / "west", archive / "west" / "scans"
    report = products_of(west).latest_value("adjustment")
    (scans / f"{name}.tif").rename(scans / "copy.tif")
    photo = replace(report.block.photos[name], photo_id="copy", scan=scans / "copy.tif")
    photos = {one: p for one, p in report.block.photos.items() if one != name} | {"copy": photo}
    ties = report.block.ties
    ids = tuple("copy" if one == name else one for one in ties.photo_ids)
    measured = {
        (point, "copy" if one == name else one): replace(m, photo_id="copy" if one == name else one)
        for (point, one), m in report.block.measurements.items()
    }
    block = replace(
        report.block, photos=photos, ties=replace(ties, photo_ids=ids), measurements=measured
    )
    keep(west, adjust_block(block, report.options), "c")

    asked = Archive(archive)

    def found() -> tuple[set[tuple[str, str]], list[str]]:
        """Asked again, as the page does: a scan that was changed meanwhile is seen."""
        (pair,) = asked.figures()["pairs"]
        pairs = {(r["name"], r["other_name"]) for r in pair["rows"] if r["kind"] == "photo"}
        return pairs, pair["namesakes"]

    other = sorted(tiny_run.photos)[4]
    assert found() == ({(name, "copy"), (other, other)}, [])
    (scans / f"{other}.tif").write_bytes(b"another scan")
    assert found() == ({(name, "copy")}, [other])
    assert any(
        f"{other} is in both under one name, but is not the same file" in line
        for line in told_lines(asked.figures())
    )
    (scans / f"{other}.tif").unlink()
    assert found() == ({(name, "copy"), (other, other)}, [])


def test_photos_of_one_name_are_told_only_where_their_blocks_meet__truth(tiny_run: Tiny) -> None:
    """Hundreds of blocks number their photos from one."""
    project = read_project(tiny_run.folder)
    one, near, far = (known(number, 3, project) for number in (0, 1, 2))
    near, far = (replace(block, scans=one.scans) for block in (near, far))
    assert namesakes(one, near, {}) == sorted(one.scans)
    assert namesakes(one, far, {}) == []
    assert namesakes(one, near, {name: name for name in one.scans}) == []


def test_blocks_that_cannot_be_compared_are_named_in_a_line__truth(archive: Path) -> None:
    shutil.copytree(archive / "east", archive / "broken")
    (archive / "broken" / "block.toml").write_text("[scans\n", encoding="utf-8")
    shutil.copytree(archive / "east", archive / "older")
    for file in (archive / "older" / HIDDEN / "products" / "adjustment").glob("*.value"):
        file.write_bytes(b"gruber-product-0 1 0\nx")
    figures = Archive(archive).figures()
    assert [one["path"] for one in figures["left_out"]] == ["broken", "older"]
    assert figures["blocks"] == 2
    lines = [line for line in told_lines(figures) if "not compared" in line]
    assert "line 1" in lines[0]
    assert "run it" in lines[1]


def test_blocks_that_were_not_run_are_counted__truth(archive: Path) -> None:
    for name in ("new", "newer"):
        (archive / name).mkdir()
        shutil.copy(archive / "east" / "block.toml", archive / name)
    lines = [*told_lines(Archive(archive).figures())]
    assert "2 blocks are not adjusted yet: run them." in lines
    shutil.rmtree(archive / "newer")
    lines = [*told_lines(Archive(archive).figures())]
    assert "1 block is not adjusted yet: run it." in lines


@pytest.mark.parametrize(
    ("path", "cause"),
    [
        ("gone", "does not exist"),
        ("notes.txt", "is no folder"),
        ("block", "is a block. Name the folder above it"),
        ("block/block.toml", "is a block. Name the folder above it"),
        (".", "holds no block that was run"),
    ],
)
def test_a_folder_without_blocks_says_what_it_is__truth(
    tmp_path: Path, path: str, cause: str
) -> None:
    (tmp_path / "notes.txt").write_text("", encoding="utf-8")
    (tmp_path / "block").mkdir()
    (tmp_path / "block" / "block.toml").write_text("", encoding="utf-8")
    with pytest.raises(PhotogrammetryError, match=cause):
        archive_of(tmp_path / path)


def test_a_block_in_another_crs_is_transformed__truth(archive: Path) -> None:
    west = archive / "west"
    report = products_of(west).latest_value("adjustment")
    block, _ = in_utm(report.block)
    keep(west, adjust_block(block, report.options), "d")
    before = Archive(archive).figures()["pairs"][0]
    assert before["why"] == ""
    assert {row["verdict"] for row in before["rows"]} == {"agree"}
    assert {row["kind"] for row in before["rows"]} == {"photo", "point"}


def known(number: int, side: int, project: Project) -> KnownBlock:
    """A block of ten by six photos that reaches into its neighbours on an archive's grid."""
    west, south = number % side * 1.0, number // side * 0.6
    outlines = {
        f"{number}_{row}": shapely.box(east, north, east + 0.25, north + 0.25)
        for row in range(60)
        for east, north in [(west + row % 10 * 0.1, south + row // 10 * 0.1)]
    }
    scans = {name: (Path(f"{name}.tif"), (12000, 12000)) for name in outlines}
    return KnownBlock(f"{number}", project, ("", ""), "EPSG:5514", scans, outlines, frozenset(), {})


def test_hundreds_of_blocks_are_sifted_by_an_index__truth(tiny_run: Tiny) -> None:
    """Four hundred blocks of sixty photos: only pairs of neighbours are compared."""
    side, project = 20, read_project(tiny_run.folder)
    blocks = [known(number, side, project) for number in range(side * side)]
    pairs = neighbours_among(blocks)
    # Along rows, columns and both diagonals of the grid.
    assert len(pairs) == 2 * side * (side - 1) + 2 * (side - 1) ** 2
    # A scan of one name and size is looked for wherever it lies.
    far = replace(blocks[-1], scans={**blocks[-1].scans, **blocks[0].scans})
    assert (blocks[0], far) in neighbours_among([*blocks[:-1], far])
