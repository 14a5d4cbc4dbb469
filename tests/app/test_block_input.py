"""`block.toml` in the engine's own terms."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import rasterio
from rasterio import Affine

from app.project import described, read_project
from core.block import UNKNOWN_M, surveyed_point
from core.errors import PhotogrammetryError
from core.formats.listed_point import ListedPoint, ListedRole


def own_toml(tiny_block: Path, folder: Path, more: str = "") -> Path:
    """The block's description in a folder of its own; its files stay where they are."""
    for part in ("scans", "ortho", "roads"):
        (folder / part).symlink_to(tiny_block / part)
    shutil.copy(tiny_block / "dem.tif", folder)
    shutil.copy(tiny_block / "footprints.gpkg", folder)
    text = (tiny_block / "block.toml").read_text(encoding="utf-8")
    (folder / "block.toml").write_text(text + more, encoding="utf-8")
    return folder


def test_every_part_of_a_description_arrives__truth(tiny_block):
    given = described(read_project(tiny_block))
    assert given.crs == "EPSG:5514"
    assert len(given.scans) == 6
    assert {scan.camera for scan in given.scans} == set(given.cameras) == {"archive"}
    assert given.scans[0].scan_pixel_um == 180.0
    assert len(given.reference.ortho) >= 2
    assert [path.name for path in given.reference.dem] == ["dem.tif"]
    assert len(given.reference.roads) == 3
    assert (given.reference.ortho_sigma_m, given.reference.dem_sigma_m) == (0.25, 0.5)
    assert given.surveyed == ()
    assert (given.reference.mask, given.reference.bridges) == (None, None)


def test_the_user_s_points_keep_role_and_accuracy__truth(tiny_block, tmp_path):
    (tmp_path / "points.csv").write_text(
        "id,X,Y,Z,sigma_xy,sigma_z,role\n"
        "A,-580000,-1190000,250,0.05,0.08,control\nB,-580100,-1190100,251,,,check\n"
    )
    folder = own_toml(tiny_block, tmp_path, '[control]\npoints = "points.csv"\n')
    first, second = described(read_project(folder)).surveyed
    assert (first.point_id, first.role, first.source) == ("A", "control", "surveyed")
    np.testing.assert_array_equal(first.position, [-580000, -1190000, 250])
    np.testing.assert_array_equal(first.sigma_m, [0.05, 0.05, 0.08])
    assert second.role == "check"


@pytest.mark.parametrize(("pixel_m", "sigmas_m"), [(0.2, (0.25, 0.5)), (10.0, (10.0, 2.0))])
def test_accuracies_that_nobody_states_are_those_of_the_pixels__truth(
    tiny_block, tmp_path, pixel_m: float, sigmas_m: tuple[float, float]
):
    """Sentinel-2 was taken to be good to 0.25 m."""
    folder = own_toml(tiny_block, tmp_path)
    file = folder / "block.toml"
    text = file.read_text(encoding="utf-8").replace("ortho/*.tif", "coarse.tif")
    text = text.replace('"dem.tif"', '"coarse.tif"')
    file.write_text(re.sub(r"(ortho|dem)_sigma_m = .*", "", text), encoding="utf-8")
    place = Affine(pixel_m, 0, -580000, 0, -pixel_m, -1190000)
    with rasterio.open(
        folder / "coarse.tif", "w", width=20, height=20, count=1, dtype="uint8", crs="EPSG:5514",
        transform=place,
    ) as raster:  # fmt: skip
        raster.write(np.full((1, 20, 20), 99, np.uint8))
    given = described(read_project(folder)).reference
    assert (given.ortho_sigma_m, given.dem_sigma_m) == sigmas_m


def test_points_of_another_country_are_told__truth(tiny_block, tmp_path):
    (tmp_path / "points.csv").write_text("id,X,Y,Z\nA,500000,5400000,250\n")
    folder = own_toml(tiny_block, tmp_path, '[control]\npoints = "points.csv"\n')
    with pytest.raises(PhotogrammetryError, match=r"points\.csv"):
        described(read_project(folder))


def test_a_listed_point_is_a_surveyed_one__law():
    given = ListedPoint("A", 1.0, 2.0, 3.0, (0.1, 0.2, 0.3), "check", "stone", "a.jpg")
    point = surveyed_point(given)
    np.testing.assert_array_equal(point.position, [1, 2, 3])
    np.testing.assert_array_equal(point.sigma_m, [0.1, 0.2, 0.3])
    assert (point.role, point.source) == ("check", "surveyed")
    assert (point.description, point.sketch) == ("stone", "a.jpg")


@pytest.mark.parametrize(
    ("role", "sigma"), [("plan", [0.1, 0.2, UNKNOWN_M]), ("height", [UNKNOWN_M, UNKNOWN_M, 0.3])]
)
def test_what_a_role_leaves_open_is_not_known__truth(role: ListedRole, sigma: list[float]):
    point = surveyed_point(ListedPoint("A", 1.0, 2.0, 3.0, (0.1, 0.2, 0.3), role))
    np.testing.assert_array_equal(point.sigma_m, sigma)
    assert point.role == "control"
