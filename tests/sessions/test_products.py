"""Products named by what made them."""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from core.block import Block
from sessions.codec import CodecError, encode
from sessions.products import Products, digest_of

ONE, TWO = digest_of(1), digest_of(2)


@dataclass(frozen=True)
class Options:
    spacing_m: float
    scan: Path


def test_digest_is_of_the_value_and_of_nothing_else__law(block: Block) -> None:
    assert digest_of(block, 1.5) == digest_of(block, 1.5)
    assert digest_of({"a": 1, "b": 2}) == digest_of({"b": 2, "a": 1})
    assert len({digest_of(1, 2), digest_of(12), digest_of((1, 2)), digest_of("1", 2)}) == 4
    assert digest_of(np.array([1.0])) != digest_of(np.array([1.0], np.float32))
    assert digest_of(float("nan")) == digest_of(float("nan"))


def test_digest_follows_the_content_of_files_wherever_they_stand__truth(tmp_path: Path) -> None:
    scan = tmp_path / "00150.tif"
    seen = set()
    for change in (
        lambda: None,
        lambda: scan.write_bytes(bytes(200_000)),
        lambda: scan.write_bytes(bytes(199_999) + b"x"),
        lambda: os.utime(scan, ns=(0, 5)),
        lambda: scan.with_suffix(".tfw").write_text("0.5"),
    ):
        change()
        first, second = digest_of(Options(5.0, scan)), digest_of(Options(5.0, scan))
        assert first == second
        seen.add(first)
    assert len(seen) == 5


def test_a_value_comes_back_only_for_its_own_digest__truth(tmp_path: Path, block: Block) -> None:
    products = Products(tmp_path)
    assert products.fresh("adjustment", ONE) is None
    assert products.load_value("adjustment", ONE) is None
    path = products.save_value("adjustment", ONE, block)
    assert products.fresh("adjustment", ONE) == path
    assert encode(products.load_value("adjustment", ONE)) == encode(block)
    assert products.fresh("adjustment", TWO) is None
    assert products.fresh("control", ONE) is None


def test_stale_products_go_only_after_the_new_one_is_there__truth(tmp_path: Path) -> None:
    products = Products(tmp_path)
    products.save_value("control", ONE, "old")
    with pytest.raises(CodecError):
        products.save_value("control", TWO, object())
    assert products.load_value("control", ONE) == "old"
    products.save_value("control", TWO, "new")
    assert products.fresh("control", ONE) is None
    assert products.load_value("control", TWO) == "new"


def test_the_latest_value_is_there_for_showing__truth(tmp_path: Path) -> None:
    products = Products(tmp_path)
    assert products.latest_value("adjustment") is None
    products.save_value("adjustment", ONE, "as it was")
    assert products.latest_value("adjustment") == "as it was"


def test_the_pass_that_a_walk_ended_with_is_the_latest_in_a_copy_too__law(tmp_path: Path) -> None:
    """Files of a copy are as old as the copying made them."""
    products = Products(tmp_path)
    products.save_value("control", ONE, "first pass")
    products.save_value("control/2", TWO, "second pass")
    products.count_as_last("control", "control/2", TWO)
    later = (tmp_path / "control" / "2" / f"{TWO}.value").stat().st_mtime + 60
    os.utime(tmp_path / "control" / f"{ONE}.value", (later, later))
    assert Products(tmp_path).latest_value("control") == "second pass"
    (tmp_path / "control" / "last").write_text("spoilt")
    assert Products(tmp_path).latest_value("control") == "first pass"


def test_a_product_that_is_a_circle_of_links_is_none__truth(tmp_path: Path) -> None:
    products = Products(tmp_path)
    products.save_value("scans", ONE, "found")
    circle = tmp_path / "scans" / f"{TWO}.value"
    circle.symlink_to(circle)
    assert Products(tmp_path).latest_value("scans") == "found"


@pytest.mark.parametrize("keep", [0, 10, 90, -1])
def test_a_truncated_value_counts_as_not_there__truth(tmp_path: Path, keep: int) -> None:
    products = Products(tmp_path)
    path = products.save_value("control", ONE, ["a value"] * 20)
    path.write_bytes(path.read_bytes()[:keep])
    assert products.fresh("control", ONE) is None
    assert products.load_value("control", ONE) is None


def test_a_damaged_value_counts_as_not_there__truth(tmp_path: Path) -> None:
    products = Products(tmp_path)
    path = products.save_value("control", ONE, "a value")
    path.write_bytes(path.read_bytes().replace(b"value", b"valve"))
    assert products.load_value("control", ONE) is None


def test_a_folder_of_rasters_is_there_when_it_is_whole__truth(tmp_path: Path) -> None:
    products = Products(tmp_path)
    stage = "ortho/LMSA08 1984/é"
    with products.making(stage, ONE) as folder:
        (folder / "ortho.tif").write_text("raster")
        assert products.fresh(stage, ONE) is None
    found = products.fresh(stage, ONE)
    assert found is not None
    assert (found / "ortho.tif").read_text() == "raster"
    (found / "ortho.tif").write_text("rast")
    assert products.fresh(stage, ONE) is None
    with products.making(stage, ONE) as folder:
        (folder / "ortho.tif").write_text("raster")
    assert products.fresh(stage, ONE) == found


def test_a_folder_replaces_only_its_own_stages_stale_products__truth(tmp_path: Path) -> None:
    products = Products(tmp_path)
    for stage, digest in (("ortho/A", ONE), ("ortho", ONE), ("ortho", TWO)):
        with products.making(stage, digest) as folder:
            (folder / "ortho.tif").write_text("raster")
    assert products.fresh("ortho", ONE) is None
    assert products.fresh("ortho", TWO) is not None
    assert products.fresh("ortho/A", ONE) is not None


def test_value_and_folder_of_one_digest_stand_side_by_side__truth(tmp_path: Path) -> None:
    products = Products(tmp_path)
    with products.making("mosaic", ONE) as folder:
        (folder / "mosaic.tif").write_text("raster")
    products.save_value("mosaic", ONE, "seams")
    with products.making("mosaic", ONE) as folder:
        (folder / "mosaic.tif").write_text("raster")
    assert (tmp_path / "mosaic" / ONE / "mosaic.tif").exists()
    assert products.load_value("mosaic", ONE) == "seams"


def test_an_interrupted_folder_is_not_there__truth(tmp_path: Path) -> None:
    products = Products(tmp_path)
    with pytest.raises(KeyboardInterrupt), products.making("ortho", ONE) as folder:  # noqa: PT012
        (folder / "ortho.tif").write_text("half")
        raise KeyboardInterrupt
    assert products.fresh("ortho", ONE) is None
    assert [path.name for path in (tmp_path / "ortho").iterdir()] == []


def test_a_block_that_was_moved_keeps_its_products__truth(tmp_path: Path, block: Block) -> None:
    seen = []
    for folder in (tmp_path / "before", tmp_path / "elsewhere"):
        if seen:
            (tmp_path / "before").rename(folder)
        else:
            folder.mkdir()
            (folder / "00150.tif").write_bytes(bytes(9))
        products = Products(folder / "products", folder)
        outside = tmp_path / "ortho.tif"
        digest = products.digest_of(Options(5.0, folder / "00150.tif"), outside)
        if not seen:
            products.save_value("scans", digest, (folder / "00150.tif", outside, block))
        seen.append(digest)
        inside, stays, again = products.load_value("scans", digest) or ()
        assert (inside, stays) == (folder / "00150.tif", outside)
        assert encode(again) == encode(block)
    assert seen[0] == seen[1]


def test_one_layer_of_a_file_is_as_new_as_the_file__truth(tmp_path: Path) -> None:
    file, layer = tmp_path / "change.gpkg", Path(f"{tmp_path / 'change.gpkg'}|layername=same")
    file.write_bytes(b"one")
    before = digest_of(layer)
    file.write_bytes(b"other")
    assert digest_of(layer) != before
    assert digest_of(layer) != digest_of(file)
