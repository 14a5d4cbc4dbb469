"""Names with blanks go out as words, each its own, where blanks part the columns."""

from dataclasses import replace
from pathlib import Path

import pytest

from core.formats.exchange import ExchangeBlock, read_format
from core.formats.exchange_formats import FORMATS
from core.formats.words import in_words
from tests.exchanged import block_of


def with_blanks(block: ExchangeBlock) -> ExchangeBlock:
    """The block with a blank in every name, and one name that is the word of another."""

    def blank(name: str) -> str:
        return name if name == "P0" else f"{name[0]} {name[1:]}"

    photos = {
        blank(name): replace(one, photo_id=blank(name), file=f"{blank(name)}.tif")
        for name, one in block.photos.items()
    }
    points = {blank(name): replace(one, point_id=blank(name)) for name, one in block.points.items()}
    first = points.pop("P0")
    points["P_1"] = replace(first, point_id="P_1")
    measured = [
        replace(one, point_id=blank(one.point_id), photo_id=blank(one.photo_id))
        for one in block.measurements
        if one.point_id != "P0"
    ]
    ties = replace(block.ties, photo_ids=tuple(map(blank, block.ties.photo_ids)))
    return replace(block, photos=photos, points=points, measurements=tuple(measured), ties=ties)


def test_every_name_becomes_a_word_of_its_own__law() -> None:
    block = with_blanks(block_of((7, 3, 1, False), "upright"))
    out, (told,) = in_words(block)
    assert set(out.points) == {"P_1", "P_1_2", "P_2", "P_3", "P_4"}
    assert [photo.file for photo in out.photos.values()] == [f"{name}.tif" for name in out.photos]
    assert "P 1" in told
    assert in_words(out) == (out, ())
    assert len(out.measurements) == len(block.measurements)


@pytest.mark.parametrize("name", ["odm", "asp", "bundler", "bingo", "inpho", "opk"])
def test_names_with_blanks_come_back_as_words__law(name: str, tmp_path: Path) -> None:
    form = FORMATS[name]
    block = with_blanks(block_of((7, 3, 1, False), form.holds))
    path = tmp_path / form.default_name
    assert form.write is not None
    if form.folder:
        path.mkdir()
    notes = form.write(path, block)
    assert any("1 938_000" in note for note in notes)
    again, words = read_format(form, path), in_words(block)[0]
    assert set(again.photos) == set(words.photos)
    if again.measurements:
        measured = {(one.point_id, one.photo_id) for one in words.measurements}
        assert {(one.point_id, one.photo_id) for one in again.measurements} == measured
