"""The block folder as a whole: complete, in the right place, and the same for the same seed."""

import hashlib
import tomllib
import warnings
from pathlib import Path

import cv2
import numpy as np
import pyogrio
import pytest
import rasterio
import shapely
from rasterio.errors import NotGeoreferencedWarning

from core.progress import Silent
from core.synthetic.archive import make_block, write_approximations
from core.synthetic.flight import make_flight
from core.synthetic.options import SyntheticOptions
from core.synthetic.truth import read_truth
from tests.core.synthetic.conftest import OPTIONS


def _digests(folder: Path) -> dict[str, str]:
    files = sorted(p for p in folder.rglob("*") if p.is_file())
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


def test_same_options_give_same_files__law(tiny_block, tmp_path):
    make_block(tmp_path, OPTIONS, Silent())
    assert _digests(tmp_path) == _digests(tiny_block)


def test_folder_is_complete_and_described__truth(tiny_block):
    project = tomllib.loads((tiny_block / "block.toml").read_text(encoding="utf-8"))
    assert project["camera"]["archive"]["principal_distance_mm"] == 211.59
    assert len(project["camera"]["archive"]["fiducials_mm"]) == 4
    scans = sorted(tiny_block.glob(project["scans"]["files"]))
    assert len(scans) == 6
    assert len(sorted(tiny_block.glob(project["reference"]["ortho"]))) == 4
    for name in [*project["reference"]["roads"], project["reference"]["dem"]]:
        assert (tiny_block / name).is_file()
    names = pyogrio.raw.read(tiny_block / "footprints.gpkg")[3][0]
    assert sorted(names) == [scan.name for scan in scans]


def test_rasters_lie_in_s_jtsk_and_differ_in_gsd__truth(tiny_block):
    sizes = set()
    for path in tiny_block.glob("ortho/*.tif"):
        with rasterio.open(path) as sheet:
            assert sheet.crs.to_epsg() == 5514
            assert sheet.count == 3
            assert sheet.bounds.right < -430_000
            assert sheet.bounds.top < -935_000
            sizes.add(sheet.res[0])
    assert sizes == {1.0, 0.8}
    with rasterio.open(tiny_block / "dem.tif") as dem:
        heights = dem.read(1, masked=True)
        assert 0 < heights.mask.sum() < 500


def test_scans_are_eight_bit_gray_tiled_and_stripped__truth(tiny_block):
    tiled = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        for path in sorted(tiny_block.glob("scans/*.tif")):
            with rasterio.open(path) as scan:
                assert (scan.count, scan.dtypes[0]) == (1, "uint8")
                assert scan.shape == (1078, 1078)
                tiled.append(scan.profile["tiled"])
    assert set(tiled) == {True, False}


def test_dem_error_is_as_stated__truth(tiny_block):
    truth = read_truth(tiny_block)
    with rasterio.open(tiny_block / "dem.tif") as dem:
        heights = dem.read(1, masked=True)
        rows, columns = np.nonzero(~heights.mask)
        east = dem.transform.c + (columns + 0.5) * dem.transform.a
        north = dem.transform.f + (rows + 0.5) * dem.transform.e
    points = np.column_stack([east, north, heights.data[rows, columns]]).astype(np.float64)
    error = points[:, 2] - truth.heights_at(points)
    assert 0.3 < error.std() < 0.5
    assert abs(error.mean()) < 0.05


def test_world_file_is_unmirrored_and_a_few_metres_off__truth(tiny_block):
    truth = read_truth(tiny_block)
    for name in truth.photos:
        lines = (tiny_block / "scans" / f"{name}.tfw").read_text().split()
        a, d, b, e, c, f = (float(line) for line in lines)
        assert a * e - b * d < 0
        middle = np.array([[539.0, 539.0]])
        shown = np.array([a, d]) * (539.0 - 0.5) + np.array([b, e]) * (539.0 - 0.5)
        true = truth.ground_of(name, middle, np.array([truth.heights[1].mean()]))[0]
        away = float(np.hypot(*(shown + np.array([c, f]) - true)))
        assert 2.0 < away < 30.0


@pytest.mark.parametrize("kind", ["points", "exterior", "none", "footprints"])
@pytest.mark.parametrize("quality", ["good", "bad"])
def test_other_georeferences_are_written__truth(tmp_path, kind, quality):
    options = SyntheticOptions(size="tiny", georeference=kind, georeference_quality=quality)
    (tmp_path / "scans").mkdir()
    write_approximations(tmp_path, make_flight(options), options)
    found = {p.suffix for p in tmp_path.rglob("*") if p.is_file()}
    expected = {"points": {".points"}, "exterior": {".csv"}, "none": set(), "footprints": {".gpkg"}}
    assert found == expected[kind]


def test_roads_of_today_are_seen_in_the_ortho__truth(tiny_block):
    """Carriageways differ from the ground beside them, in either direction, in most places."""
    geometry = pyogrio.raw.read(tiny_block / "roads" / "SilniceDalnice.shp")[2]
    lines = shapely.from_wkb(geometry)
    on, beside = [], []
    for path in tiny_block.glob("ortho/*.tif"):
        with rasterio.open(path) as sheet:
            gray = cv2.cvtColor(np.moveaxis(sheet.read(), 0, 2), cv2.COLOR_RGB2GRAY)
            for line in lines:
                at = shapely.get_coordinates(shapely.segmentize(line, 10.0))
                way = np.gradient(at, axis=0)
                left = np.column_stack([-way[:, 1], way[:, 0]])
                left /= np.linalg.norm(left, axis=1, keepdims=True)
                for offset, values in ((0.0, on), (12.0, beside)):
                    east, north = (at + offset * left).T
                    columns = np.floor((east - sheet.transform.c) / sheet.res[0]).astype(int)
                    rows = np.floor((sheet.transform.f - north) / sheet.res[0]).astype(int)
                    inside = (rows >= 0) & (rows < sheet.height)
                    inside &= (columns >= 0) & (columns < sheet.width)
                    near = np.where(inside, gray[rows * inside, columns * inside], np.nan)
                    values.append(near)
    difference = np.concatenate(on) - np.concatenate(beside)
    difference = difference[np.isfinite(difference)]
    assert len(difference) > 100
    assert np.mean(np.abs(difference) > 12) > 0.6
