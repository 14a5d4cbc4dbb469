"""Blocks of several years: as references with their own standard deviation, and compared."""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pyogrio.raw
import pytest
import rasterio

from app.change import compare_years, dated_blocks, told_lines
from app.cli import UNUSABLE, main
from app.epochs import Epoch, origin_files
from app.project import described, read_project
from core.errors import ProjectError
from core.matching.reference import ORTHO_SIGMA
from core.progress import SILENT
from core.surface.ground import NODATA_M
from sessions.products import digest_of
from tests.app.test_project import TOML
from tests.core.raster_files import place, write_raster

SIGMA_M = 0.4


def block(folder: Path, year: int, more: str = "") -> Path:
    """A block with files small enough to be read; `more` follows its block.toml."""
    for name in ("scans/a.tif", "ortho/1.tif"):
        raster(folder / name, np.full((4, 4), 100, np.uint8), 0)
    raster(folder / "dem.tif", np.full((4, 4), 300, np.float32), NODATA_M)
    dated = TOML.replace('camera = "wide"', f'camera = "wide"\ntaken = "{year}"')
    (folder / "block.toml").write_text(dated + more, encoding="utf-8")
    return folder


def raster(path: Path, values: np.ndarray, nodata: float) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_raster(path, values, place(1.0), nodata=nodata)


def run(folder: Path) -> Path:
    """What a run leaves, as far as another block looks at it."""
    epoch = Epoch(folder)
    raster(epoch.mosaic, np.full((4, 4), 90, np.uint8), 0)
    sigmas = np.full((2, 4, 4), NODATA_M, np.float32)
    sigmas[0, :2], sigmas[1, :2] = SIGMA_M * np.sqrt(0.5), SIGMA_M * np.sqrt(1.5)
    raster(origin_files(folder / "results").sigma, sigmas, NODATA_M)
    return folder


def naming(path: str, more: str = "") -> str:
    return f'\n[[reference.other]]\nblock = "{path}"\n{more}'


def test_photos_are_tied_to_the_mosaic_by_its_own_sigma__law(tmp_path: Path) -> None:
    other = run(block(tmp_path / "1953", 1953))
    own = block(tmp_path / "1938", 1938, naming("../1953", "ties = true\n"))
    found = read_project(own).reference.other[0]
    assert (found.ortho, found.year, found.dem) == ((Epoch(other).mosaic,), 1953, ())
    assert found.name(own) == "../1953 (1953)"
    layers = described(read_project(own)).reference.layers
    assert layers[0].ortho == found.ortho
    assert layers[0].ortho_sigma_m == pytest.approx(np.hypot(SIGMA_M, ORTHO_SIGMA.usual_m))
    before = digest_of(described(read_project(own)).reference)
    assert before == digest_of(described(read_project(own)).reference)
    raster(Epoch(other).mosaic, np.full((4, 4), 91, np.uint8), 0)
    assert before != digest_of(described(read_project(own)).reference)
    stated = naming("../1953/block.toml", "ties = true\northo_sigma_m = 1.5\nyear = 1950\n")
    found = read_project(block(own, 1938, stated)).reference.other[0]
    assert (found.ortho_sigma_m, found.year) == (1.5, 1950)


def test_its_surface_serves_where_it_is_asked_for__law(tmp_path: Path) -> None:
    other = Epoch(run(block(tmp_path / "1953", 1953)))
    own = block(tmp_path / "1938", 1938, naming("../1953", "surface = true\n"))
    with pytest.raises(ProjectError, match=r"surface: .*has no surface.*--until surface"):
        read_project(own)
    raster(other.surface.surface, np.full((4, 4), 301, np.float32), NODATA_M)
    raster(other.surface.sigma, np.full((4, 4), 0.7, np.float32), NODATA_M)
    found = read_project(own).reference.other[0]
    assert found.dem == (other.surface.surface,)
    assert found.dem_sigma_m == pytest.approx(0.7)


def test_what_is_no_epoch_is_refused__law(tmp_path: Path) -> None:
    other, own = block(tmp_path / "1953", 1953), tmp_path / "1938"
    for path, cause in (
        ("../gone", "is no block"),
        ("../1953", r"has no mosaic yet. Run it first: gruber run .*1953"),
        ("../1938", "this block itself"),
    ):
        with pytest.raises(ProjectError, match=rf"reference.other. block: .*{cause}"):
            read_project(block(own, 1938, naming(path)))
    run(other)
    with pytest.raises(ProjectError, match=r"ortho: .*Name one of the two"):
        read_project(block(own, 1938, naming("../1953", 'ortho = "ortho/1.tif"\n')))
    origin_files(other / "results").sigma.unlink()
    with pytest.raises(ProjectError, match=r"no standard deviations.*up to its report"):
        read_project(block(own, 1938, naming("../1953")))


def test_blocks_tied_in_a_circle_are_refused__law(tmp_path: Path) -> None:
    tied = "ties = true\n"
    for year, to in ((1938, 1953), (1953, 1966), (1966, 1938)):
        run(block(tmp_path / str(year), year, naming(f"../{to}", tied)))
    with pytest.raises(ProjectError, match="circle: 1938 → 1953 → 1966 → 1938"):
        read_project(tmp_path / "1938")
    block(tmp_path / "1966", 1966, naming("../1938"))
    assert read_project(tmp_path / "1938").reference.other[0].ties
    shutil.rmtree(tmp_path / "1953" / "results")
    with pytest.raises(ProjectError, match="has no mosaic yet"):
        read_project(tmp_path / "1938")


def test_years_are_compared_in_their_order__law(tmp_path: Path) -> None:
    blocks = [run(block(tmp_path / str(year), year)) for year in (1984, 1938, 1953)]
    assert [one.year for one in dated_blocks(blocks)] == [1938, 1953, 1984]
    with pytest.raises(ProjectError, match="Name two blocks or more"):
        dated_blocks(blocks[:1])
    with pytest.raises(ProjectError, match="it is of 1938, and so is"):
        dated_blocks([*blocks, run(block(tmp_path / "again", 1938))])
    with pytest.raises(ProjectError, match="has no mosaic yet"):
        dated_blocks([*blocks, block(tmp_path / "1999", 1999)])


def test_change_is_written_and_told__truth(tmp_path: Path) -> None:
    """A mosaic that shows the same in both years, and a hill that has come."""
    rng = np.random.default_rng(9227)
    picture = cv2.GaussianBlur(rng.uniform(1, 255, (320, 320)), (0, 0), 2).astype(np.uint8)
    blocks = [run(block(tmp_path / str(year), year)) for year in (1938, 1953)]
    for number, folder in enumerate(blocks):
        epoch = Epoch(folder)
        raster(epoch.mosaic, picture, 0)
        heights = np.full((320, 320), 300, np.float32) + rng.normal(0, 0.3, (320, 320))
        heights[100:150, 100:150] += 5 * number
        raster(epoch.surface.surface, heights.astype(np.float32), NODATA_M)
        raster(epoch.surface.sigma, np.full((320, 320), 0.3, np.float32), NODATA_M)
    out = tmp_path / "change"
    assert main(["change", *map(str, blocks), "--out", str(out), "--log-json"]) == 0
    _, _, _, fields = pyogrio.raw.read(out / "change.gpkg", "1938-1953")
    table = list(zip(*fields, strict=True))
    assert [row[:3] for row in table] == [("raised", 1938, 1953)]
    assert table[0][6] == pytest.approx(5 * 2500, rel=0.1)
    with rasterio.open(out / "height_change_1938_1953.tif") as file:
        assert np.count_nonzero(file.read(1) > 2.5) == pytest.approx(2500, rel=0.1)
    assert main(["change", *map(str, blocks), "--out", str(blocks[0] / "results")]) == UNUSABLE
    assert not (blocks[0] / "results" / "change.gpkg").exists()
    (pair,) = compare_years(dated_blocks(blocks), out, SILENT)
    assert pair.picture.shares["different"] == 0
    assert "raised 1 area, 0.27 ha" in "".join(told_lines(pair))
