"""Tie points of MicMac: text and binary, both ways round."""

from pathlib import Path

import numpy as np
import pytest

from core.errors import ExchangeError
from core.formats.exchange import ExchangeBlock
from core.formats.micmac_ties import (
    read_couples,
    read_homol,
    read_pairs,
    write_couples,
    write_homol,
)
from tests.core.formats.random_blocks import block_of, tie_set


def tied_block() -> ExchangeBlock:
    return next(
        block for block in (block_of(n, film=False) for n in range(99)) if len(block.photos) == 3
    )


@pytest.mark.parametrize("text", [False, True])
def test_both_forms_hold_each_pair_both_ways_round__law(tmp_path: Path, text: bool) -> None:
    block = tied_block()
    files = {name: photo.file for name, photo in block.photos.items()}
    couples = write_homol(tmp_path, block.ties, files, text)
    ending = "txt" if text else "dat"
    assert len(list(tmp_path.glob(f"Pastis*/*.{ending}"))) == 6 == 2 * len(couples)
    one, other = couples[0]
    here = read_pairs(tmp_path / f"Pastis{one}" / f"{other}.{ending}")
    there = read_pairs(tmp_path / f"Pastis{other}" / f"{one}.{ending}")
    assert np.array_equal(here, there[:, [2, 3, 0, 1]])
    read = read_homol(tmp_path).ties
    names = tuple(name.removesuffix(".tif") for name in read.photo_ids)
    found = ExchangeBlock(ties=type(read)(names, read.point, read.photo, read.pixels))
    assert tie_set(found) == tie_set(block)
    write_couples(tmp_path / "img_pairs.xml", couples)
    assert read_couples(tmp_path / "img_pairs.xml") == couples


def test_a_binary_pair_is_laid_out_as_micmac_lays_it__truth(tmp_path: Path) -> None:
    # source of the layout: MicMac writes its dimension, the count, and for each pair its count,
    # a weight as double, and two places as doubles.
    path = tmp_path / "b.dat"
    numbers = np.array([1.25, 2.5, 3.0, 4.75]).tobytes()
    path.write_bytes(b"\2\0\0\0\1\0\0\0\2\0\0\0" + np.array([1.0]).tobytes() + numbers)
    assert read_pairs(path).tolist() == [[1.25, 2.5, 3.0, 4.75]]


def test_a_chain_with_two_places_in_a_scan_is_left_out_and_told__truth(tmp_path: Path) -> None:
    (tmp_path / "Pastisa").mkdir()
    (tmp_path / "Pastisa/b.txt").write_text("1 1 2 2\n1 1 3 3\n7 7 8 8\n")
    found = read_homol(tmp_path)
    assert found.ties.pixels.tolist() == [[7.5, 7.5], [8.5, 8.5]]
    assert "1 tie point meets a scan in two places" in found.notes[0]


CUT = (
    b"",
    b"\2\0\0\0",
    b"\2\0\0\0\2\0\0\0" + b"\0" * 44,
    b"\3\0\0\0\0\0\0\0",
    b"\2\0\0\0\1\0\0\0" + b"\0" * 44,
)


@pytest.mark.parametrize("content", CUT)
def test_damaged_binaries_are_told__truth(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "b.dat"
    path.write_bytes(content)
    with pytest.raises(ExchangeError, match="cut off"):
        read_pairs(path)


def test_couples_are_of_two_names__truth(tmp_path: Path) -> None:
    path = tmp_path / "img_pairs.xml"
    path.write_text("<SauvegardeNamedRel><Cple>a b c</Cple></SauvegardeNamedRel>")
    with pytest.raises(ExchangeError, match="is no couple"):
        read_couples(path)
