"""Two clicks in one photo: what is clicked is what the pipeline reads."""

import shutil

import numpy as np
import pytest

from app.placing import Clicking, Placeable, in_crs
from app.project import described, read_project
from app.running import Running
from core.errors import ScanError
from core.formats.qgis_points import QgisPoints, read_qgis_points, write_qgis_points
from core.georeference.approximation import Ground, approximate_from_points
from core.scans.interior_orientation import orient_scan
from core.scans.stage import ScanSet


@pytest.fixture
def clicking(copy_of_one):
    """The page's hand on one scan, which may be written beside."""
    folder, tiny, name = copy_of_one
    given = described(read_project(folder))
    scan = next(one for one in given.scans if one.path.stem == name)
    oriented = orient_scan(scan.path, given.cameras[scan.camera], scan.scan_pixel_um)
    scans = ScanSet({name: oriented}, {}, ())
    placeable = Placeable(given, scans, tiny.reference)
    return Clicking(placeable, Running(folder)), oriented, given


@pytest.fixture
def copy_of_one(tiny, tmp_path):
    name = tiny.names[0]
    shutil.copytree(tiny.folder / "scans", tmp_path / "scans")
    shutil.copy(tiny.folder / "block.toml", tmp_path)
    for part in ("dem.tif", "ortho", "roads", "footprints.gpkg"):
        if (tiny.folder / part).exists():
            (tmp_path / part).symlink_to(tiny.folder / part)
    return tmp_path, tiny, name


def true_pairs(tiny, name: str, count: int) -> list[tuple[float, float, float, float]]:
    photo, camera = tiny.photos[name], tiny.truth.camera
    pixels = np.array([[250.0, 300.0], [850.0, 820.0], [300.0, 800.0], [800.0, 280.0]])[:count]
    heights = np.full(count, tiny.reference.dem.mean_height())
    for _ in range(5):
        ground = photo.object_from_pixel(pixels, heights, camera)
        heights = tiny.reference.dem.heights(ground[:, :2])
    return [tuple(row) for row in np.column_stack([pixels, ground[:, :2]]).tolist()]


def test_what_is_clicked_places_the_photo__truth(clicking, tiny):
    hand, oriented, given = clicking
    pairs = true_pairs(tiny, oriented.photo_id, 4)
    fit = hand.save(oriented.photo_id, pairs)
    assert fit["saved"] == oriented.scan.path.name + ".points"
    # Relief and tilt are what a similarity leaves.
    assert fit["rms"] < 15
    points = read_qgis_points(oriented.scan.path.with_name(fit["saved"]))
    assert np.allclose(np.column_stack([points.pixels, points.plane]), pairs, atol=1e-9)
    camera = next(iter(given.cameras.values()))
    ground = Ground(given.crs, tiny.reference.dem.mean_height())
    placed = approximate_from_points(points, oriented.interior, camera, ground)
    true = tiny.photos[oriented.photo_id].exterior
    assert np.hypot(*(placed.exterior.centre - true.centre)[:2]) < 60
    assert abs(placed.exterior.kappa - true.kappa) < np.radians(1)
    # The page, opened again, shows them.
    assert np.allclose(hand.photos()["scans"][0]["pairs"], pairs, atol=1e-3)


def test_points_switched_off_stay_and_nothing_half_is_written__law(clicking, tiny):
    hand, oriented, given = clicking
    pairs = true_pairs(tiny, oriented.photo_id, 3)
    path = oriented.scan.path.with_name(oriented.scan.path.name + ".points")
    values = np.array(pairs)
    before = QgisPoints(
        path, given.crs, values[:, 2:], values[:, :2], np.array([True, True, False])
    )
    write_qgis_points(path, before)
    assert len(hand.photos()["scans"][0]["pairs"]) == 2
    with pytest.raises(ScanError, match="One pair is too few"):
        hand.save(oriented.photo_id, pairs[:1])
    with pytest.raises(ScanError):
        hand.save(oriented.photo_id, [pairs[0], pairs[0]])
    assert read_qgis_points(path).enabled.tolist() == [True, True, False]
    hand.save(oriented.photo_id, pairs[:2])
    assert read_qgis_points(path).enabled.tolist() == [True, True, False]
    assert hand.save(oriented.photo_id, [])["saved"] == path.name
    assert read_qgis_points(path).enabled.tolist() == [False]
    with pytest.raises(ScanError, match="no scan of this block"):
        hand.fitted("../elsewhere", pairs)


def test_a_file_is_removed_only_when_nothing_in_it_is_lost__law(clicking, tiny):
    hand, oriented, _ = clicking
    pairs = true_pairs(tiny, oriented.photo_id, 2)
    path = oriented.scan.path.with_name(oriented.scan.path.name + ".points")
    assert hand.save(oriented.photo_id, pairs)["saved"] == path.name
    assert hand.save(oriented.photo_id, [])["saved"] == ""
    assert not path.exists()
    path.write_text("mapX,mapY,sourceX,sourceY\nsome,words,for,numbers\n", encoding="utf-8")
    for kept in ([], pairs):
        with pytest.raises(ScanError, match="not written over"):
            hand.save(oriented.photo_id, kept)
    assert "words" in path.read_text(encoding="utf-8")
    for empty in ("", "mapX,mapY,sourceX,sourceY,enable\n"):
        path.write_text(empty, encoding="utf-8")
        assert hand.save(oriented.photo_id, pairs)["saved"] == path.name


def test_points_in_another_crs_are_brought_to_the_blocks__oracle(tmp_path):
    from pyproj import Transformer

    plane = np.array([[-577000.0, -1193000.0], [-576000.0, -1192000.0]])
    there = Transformer.from_crs("EPSG:5514", "EPSG:32633", always_xy=True)
    utm = np.column_stack(there.transform(*plane.T))
    points = QgisPoints(tmp_path, "EPSG:32633", utm, np.zeros((2, 2)), np.ones(2, dtype=bool))
    assert np.allclose(in_crs(points, "EPSG:5514").plane, plane, atol=2.0)
