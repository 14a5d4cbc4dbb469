"""Lines of text files, and names of scans as lists have them."""

import csv
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.formats.exchange import read_format
from core.formats.exchange_formats import FORMATS
from core.formats.records import guarded, scan_stem, unguarded
from tests.exchanged import block_of

HOSTILE = (
    '=HYPERLINK("http://x.example";"a")', "=1+1", "@SUM(A1)", "+cmd|'/c calc'!A0", "-SUM(A1)",
    "'=1", "''@x", "\t=1", "<script>alert(1)</script>", "../../etc", "-12", "+3.5", "- a remark",
)  # fmt: skip


def test_names_lose_folder_and_image_extension_only__truth() -> None:
    assert scan_stem("LMSA08.1938.HUST25.00859") == "LMSA08.1938.HUST25.00859"
    assert scan_stem("a/b/LMSA08.1938.HUST25.00859.TIF") == "LMSA08.1938.HUST25.00859"
    assert scan_stem("C:\\scans\\1989_16401.jp2") == "1989_16401"


@pytest.mark.parametrize("text", HOSTILE)
def test_no_spreadsheet_runs_a_cell__truth(text: str) -> None:
    """What calls something has the sign of text before it; numbers and remarks are as they were."""
    told = guarded(text)
    runs = text.lstrip("'")[0] in "=@\t" or ("|" in text or "SUM(" in text)
    assert told == (f"'{text}" if runs else text)
    assert guarded(-1.5) == -1.5


@given(st.text(alphabet="'=+-@\t(|!a1. ", max_size=6))
def test_a_guarded_cell_is_read_as_it_was__law(text: str) -> None:
    assert unguarded(str(guarded(text))) == text


@pytest.mark.parametrize("name", ["points", "metashape-points", "pix4d-points"])
def test_names_that_are_formulas_go_out_guarded_and_come_back__truth(
    name: str, tmp_path: Path
) -> None:
    form = FORMATS[name]
    block = block_of((11, 2, 0, False), form.holds)
    names = dict(zip(block.points, ("=1+1", *HOSTILE[:1], "@x", "../../etc", "<b>"), strict=True))
    points = {names[n]: replace(p, point_id=names[n]) for n, p in block.points.items()}
    measured = tuple(replace(m, point_id=names[m.point_id]) for m in block.measurements)
    path = tmp_path / form.default_name
    assert form.write is not None
    form.write(path, replace(block, points=points, measurements=measured))
    for file in [path] if path.is_file() else path.iterdir():
        with file.open(newline="") as stream:
            cells = [cell for row in csv.reader(stream) for cell in row]
        assert not any(cell.startswith(("=", "@")) for cell in cells)
    assert set(read_format(form, path).points) == set(points)


def test_orientations_of_odd_scans_come_back__truth(tmp_path: Path) -> None:
    block = block_of((11, 1, 0, False))
    (photo,) = block.photos.values()
    odd = replace(photo, photo_id="=1", file="=1.tif")
    form = FORMATS["eo"]
    assert form.write is not None
    form.write(tmp_path / "eo.csv", replace(block, photos={"=1": odd}))
    assert "\n'=1.tif," in (tmp_path / "eo.csv").read_text()
    assert list(read_format(form, tmp_path / "eo.csv").photos) == ["=1"]
