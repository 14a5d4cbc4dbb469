"""World files: the worked example of the thesis, round trips, and the defect of the seed script."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyproj import CRS

from core.errors import ScanError
from core.formats.qgis_points import read_qgis_points
from core.formats.world_file import (
    find_world_file,
    read_georeference,
    read_world_file,
    write_world_file,
)
from core.geometry.transforms import PlaneTransform, fit_affine, rotation_and_scale
from core.raster.files import open_plain
from tests.core.scans.film_maker import write_gray

finite = st.floats(-1e3, 1e3, allow_nan=False)


def test_kobyli_1984__paper(tmp_path: Path) -> None:
    """Thesis, figure 9: GSD 0.3560 m, kappa 173.9 degrees."""
    path = tmp_path / "scan.tfw"
    path.write_text("-0.35403\n0.03754\n0.03754\n0.35403\n-576837.67\n-1195069.54\n")
    world = read_world_file(path)
    assert world.ground_sample_distance_m == pytest.approx(0.3560, abs=5e-5)
    assert not world.mirrored
    (a, _, _), (d, _, _) = world.object_from_pixel
    assert math.degrees(math.atan2(d, a)) == pytest.approx(173.9, abs=0.05)


def test_origin_is_the_centre_of_the_first_pixel__paper(tmp_path: Path) -> None:
    """FORMATS 4.19: corner (-743000, -1043000) at 0.5 m is written -742999.75, -1043000.25."""
    path = tmp_path / "sheet.tfw"
    write_world_file(path, np.array([[0.5, 0, -743000.0], [0, -0.5, -1043000.0]]))
    assert [float(line) for line in path.read_text().split()] == [
        0.5, 0, 0, -0.5, -742999.75, -1043000.25,
    ]  # fmt: skip


@settings(max_examples=60)
@given(finite, finite, finite, finite, st.floats(-1e7, 1e7), st.floats(-1e7, 1e7))
def test_written_and_read__law(
    tmp_path_factory: pytest.TempPathFactory,
    a: float, b: float, d: float, e: float, c: float, f: float,
) -> None:  # fmt: skip
    matrix = np.array([[a + 2000, b, c], [d, e - 2000, f]])
    path = tmp_path_factory.mktemp("world") / "scan.jgw"
    write_world_file(path, matrix)
    np.testing.assert_allclose(
        read_world_file(path).object_from_pixel, matrix, atol=2e-6, rtol=1e-9
    )


def test_sheared_points_keep_their_shear__truth(tmp_path: Path) -> None:
    """METHODS W1: the seed script exchanged lines 2 and 3, 60 and 90 m off at (6000, 4000)."""
    truth = np.array([[0.5, 0.02, -743000.0], [0.001, -0.5, -1043000.0]])
    pixels = [(100.0, 200.0), (6000.0, 300.0), (5900.0, 4000.0), (200.0, 3900.0)]
    rows = [(*(truth @ [c, r, 1.0]), c, -r, 1, 0, 0, 0) for c, r in pixels]
    (tmp_path / "scan.points").write_text(
        "mapX,mapY,sourceX,sourceY,enable,dX,dY,residual\n"
        + "".join(",".join(f"{v:.6f}" for v in row) + "\n" for row in rows)
    )
    points = read_qgis_points(tmp_path / "scan.points")
    fit = fit_affine(points.pixels, points.plane)
    assert isinstance(fit, PlaneTransform)
    write_world_file(tmp_path / "scan.tfw", fit.matrix)
    a, d, b, e, c, f = (float(word) for word in (tmp_path / "scan.tfw").read_text().split())
    assert (d, b) == (pytest.approx(0.001, abs=1e-6), pytest.approx(0.02, abs=1e-6))
    # Lines as GDAL and QGIS read them: the centre of pixel (6000, 4000) is (6000.5, 4000.5) for us.
    expected = truth @ [6000.5, 4000.5, 1.0]
    assert [a * 6000 + b * 4000 + c, d * 6000 + e * 4000 + f] == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize(
    ("raster", "world"),
    [("s.tif", "s.tfw"), ("s.tif", "S.TFW"), ("s.TIF", "s.tifw"), ("s.tiff", "s.tfw"),
     ("s.jpg", "s.JGW"), ("s.jp2", "s.j2w"), ("s.jpeg", "s.jgw"), ("s.tif", "s.wld"),
     ("LMS.1938.00859.tif", "LMS.1938.00859.tfw"), ("s.tif", "s.tif.wld")],
)  # fmt: skip
def test_found_beside_the_scan__truth(tmp_path: Path, raster: str, world: str) -> None:
    (tmp_path / world).write_text("1 0 0 -1 0 0")
    (tmp_path / "other.tfw").write_text("2 0 0 -2 0 0")
    assert find_world_file(tmp_path / raster) == tmp_path / world


def test_georeference_inside_the_tiff__truth(tmp_path: Path) -> None:
    from rasterio.transform import Affine

    write_gray(
        tmp_path / "g.tif",
        np.zeros((8, 8), np.uint8),
        transform=Affine(0.5, 0.1, 7e5, 0.1, -0.5, 5e6),
    )
    inside = read_georeference(tmp_path / "g.tif")
    assert inside is not None
    np.testing.assert_allclose(inside.object_from_pixel, [[0.5, 0.1, 7e5], [0.1, -0.5, 5e6]])
    write_gray(tmp_path / "plain.tif", np.zeros((8, 8), np.uint8))
    assert read_georeference(tmp_path / "plain.tif") is None


def test_points_inside_the_tiff_and_its_crs__truth(tmp_path: Path) -> None:
    """Column and row of a point count from the outer corner, as in the affine."""
    from rasterio.control import GroundControlPoint

    path = tmp_path / "p.tif"
    write_gray(path, np.zeros((8, 8), np.uint8))
    places = [(0, 0), (8, 0), (8, 8), (0, 8)]
    with open_plain(path, {"mode": "r+"}) as dataset:
        points = [GroundControlPoint(r, c, 7e5 + 0.5 * c, 5e6 - 0.5 * r) for c, r in places]
        dataset.gcps = (points, "EPSG:32633")
    inside = read_georeference(path)
    assert inside is not None
    np.testing.assert_allclose(inside.object_from_pixel, [[0.5, 0, 7e5], [0, -0.5, 5e6]], atol=1e-6)
    assert CRS(inside.crs) == CRS("EPSG:32633")
    with open_plain(path, {"mode": "r+"}) as dataset:
        dataset.gcps = (points[:2], "EPSG:32633")
    assert read_georeference(path) is None


def test_mirrored_is_told_by_the_determinant__law(tmp_path: Path) -> None:
    path = tmp_path / "m.tfw"
    path.write_text("0.5 0 0 0.5 0 0")
    assert read_world_file(path).mirrored


@pytest.mark.parametrize(
    ("text", "words"),
    [("1 0 0\n", "six numbers"), ("a b c d e f", "six numbers"), ("", "six numbers"),
     ("1 1 1 1 5 5", "no area"), ("nan 0 0 1 2 3", "no area")],
)  # fmt: skip
def test_unusable_world_file_says_why__truth(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "bad.tfw"
    path.write_text(text)
    with pytest.raises(ScanError, match=words):
        read_world_file(path)


FIGURE_9 = """-0.3540303707910937
0.03754364929849707
0.03754364929849707
0.3540303707910937
-576837.6652261121
-1195069.5395885226
"""


def test_world_file_of_figure_9_of_the_thesis__paper(tmp_path: Path) -> None:
    """Kobylí 1984: a similarity, 0.3560 m on the ground, turned by 173.9 degrees (METHODS 1.1)."""
    (tmp_path / "scan.jgw").write_text(FIGURE_9)
    world = read_world_file(tmp_path / "scan.jgw")
    assert not world.mirrored
    assert world.ground_sample_distance_m == pytest.approx(0.3560, abs=5e-5)
    turn, scale = rotation_and_scale(world.object_from_pixel, mirrored=True)
    assert np.degrees(turn) == pytest.approx(173.9, abs=0.06)
    assert scale == pytest.approx(world.ground_sample_distance_m, rel=1e-12)
    # Lines 5 and 6 are the centre of the first pixel, half a pixel inside its corner.
    centre = world.object_from_pixel @ [0.5, 0.5, 1.0]
    assert centre == pytest.approx([-576837.6652261121, -1195069.5395885226], abs=1e-9)
    write_world_file(tmp_path / "again.jgw", world.object_from_pixel)
    lines = [float(word) for word in (tmp_path / "again.jgw").read_text().split()]
    assert lines == pytest.approx([float(word) for word in FIGURE_9.split()], abs=1e-6)
