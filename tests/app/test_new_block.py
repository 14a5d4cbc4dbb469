"""A folder looked through, and a `block.toml` written from what it holds."""

import json
import shutil
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio.raw
import pyproj
import pytest
import rasterio
import shapely
from rasterio.errors import NotGeoreferencedWarning

from app.folder_scan import FoundLayer
from app.new_block import Recognition, recognise, write_block_toml
from app.project import read_project
from core.errors import ProjectError
from ui.words.catalogue import Teller

CRS = "EPSG:5514"
NORTH_UP = rasterio.Affine(2.0, 0.0, -743000.0, 0.0, -2.0, -1043000.0)


def raster(path: Path, side: int = 500, bands: int = 1, dtype: str = "uint8", **more: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    shape = {"width": side, "height": side, "count": bands, "dtype": dtype}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        with rasterio.open(path, "w", driver="GTiff", compress="deflate", **shape, **more) as file:
            if "dpi" in path.stem:
                resolution = {"TIFFTAG_XRESOLUTION": "66", "TIFFTAG_YRESOLUTION": "66"}
                file.update_tags(**resolution, TIFFTAG_RESOLUTIONUNIT="2")


def vector(path: Path, shape: shapely.Geometry, kind: str, crs: str = CRS, **fields: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    columns = [np.array([value], object) for value in fields.values()]
    geometry = np.array([shapely.to_wkb(shape)], object)
    pyogrio.raw.write(path, geometry, columns, list(fields), geometry_type=kind, crs=crs)


tell = Teller()
LINE, BOX = shapely.LineString([(0, 0), (1, 1)]), shapely.box(0, 0, 1, 1)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("dpi_150", "dpi_151"):
        raster(tmp_path / "scans" / f"{name}.tif")
        (tmp_path / "scans" / f"{name}.tfw").write_text(
            "0.2\n0.01\n0.01\n-0.2\n-743000\n-1043000\n"
        )
    for name in ("a", "b"):
        raster(tmp_path / "ortho" / f"{name}.tif", bands=3, crs=CRS, transform=NORTH_UP)
    raster(tmp_path / "dmr5g.tif", side=100, dtype="float32", crs=CRS, transform=NORTH_UP)
    vector(tmp_path / "roads" / "Ulice.shp", LINE, "LineString", TYP="1")
    vector(tmp_path / "footprints.gpkg", BOX, "Polygon", LMS_TIF_UP="dpi_150.tif")
    return tmp_path


def noted(found: Recognition) -> str:
    return " ".join(tell(f"found.note.{note.name}", **note.values) for note in found.notes)


def missing(found: Recognition) -> str:
    return " ".join(tell(f"gap.{gap.name}") for gap in found.gaps)


def test_a_usual_folder_is_recognised__truth(folder: Path) -> None:
    found = recognise(folder)
    assert (found.scans, found.scan_count) == (("scans/*.tif",), 2)
    assert found.ortho == ("ortho/*.tif",)
    assert (found.dem, found.roads) == (("dmr5g.tif",), ("roads/Ulice.shp",))
    assert found.footprints == ("footprints.gpkg", "LMS_TIF_UP")
    assert (found.georeference, found.crs) == ("world-file", "EPSG:5514")
    assert found.notes == ()


def test_a_block_of_its_own_inside_is_passed_over__law(folder: Path) -> None:
    alone = recognise(folder)
    shutil.copytree(folder / "scans", folder / "another" / "scans")
    (folder / "another" / "block.toml").touch()
    assert recognise(folder) == alone


def test_a_crs_without_a_code_is_told_by_its_projection__truth(folder: Path) -> None:
    local = pyproj.CRS.from_proj4("+proj=tmerc +lon_0=25 +datum=WGS84 +units=m")
    found = replace(recognise(folder), crs=local.to_wkt())
    assert dict(found.found)["crs"] == "an unnamed CRS (Transverse Mercator)"


def test_scan_pixel_and_frame_come_from_the_resolution_tag__truth(folder: Path) -> None:
    found = recognise(folder)
    assert found.scan_pixel_um == pytest.approx(25400 / 66, rel=1e-5)
    assert found.frame_mm == 180.0


def test_with_the_principal_distance_filled_in_the_block_can_be_read__truth(folder: Path) -> None:
    path = write_block_toml(recognise(folder))
    unknown = read_project(folder).cameras["film"]
    assert unknown.sigma_principal_distance_mm > 0
    assert len(unknown.distances_mm) > 1
    text = path.read_text()
    assert "# FILL IN: principal distance from the camera certificate" in text
    path.write_text(text.replace("# principal_distance_mm =", "principal_distance_mm = 211.59"))
    project = read_project(folder)
    assert project.cameras["film"].distances_mm == ()
    assert len(project.scans.listed) == 2
    assert project.scans.footprints == folder / "footprints.gpkg"
    assert project.cameras["film"].frame_mm == (180.0, 180.0)


def test_a_block_that_is_there_is_left_alone__law(folder: Path) -> None:
    (folder / "block.toml").write_text("mine")
    with pytest.raises(ProjectError, match="is there already"):
        write_block_toml(recognise(folder))
    assert (folder / "block.toml").read_text() == "mine"


def test_what_is_missing_is_said_with_what_it_leaves_out__truth(tmp_path: Path) -> None:
    found = recognise(tmp_path)
    for word in ("principal distance", "scans:", "orthophoto", "terrain", "CRS", "road layers"):
        assert word in missing(found)
    assert all(tell(f"gap.out.{gap.out}") for gap in found.gaps)
    text = write_block_toml(found).read_text()
    for key in ("files", "ortho", "dem", "crs", "scan_pixel_um", "frame_mm"):
        assert f"\n# {key} =" in text


def test_nothing_is_missed_that_is_there__truth(folder: Path) -> None:
    vector(folder / "budovy.gpkg", BOX, "Polygon", id="1")
    vector(folder / "lesni_puda.gpkg", BOX, "Polygon", id="1")
    vector(folder / "woods.gpkg", LINE, "LineString", id="1")
    vector(folder / "vodni_plocha.gpkg", BOX, "Polygon", id="1")
    vector(folder / "bridges.gpkg", BOX, "Polygon", id="1")
    vector(folder / "sm5.gpkg", BOX, "Polygon", name="Praha 7-1")
    (folder / "eo.csv").write_text("scan,X,Y,Z,omega_deg,phi_deg,kappa_deg\n")
    (folder / "points.csv").write_text("id,X,Y,Z,sigma_xy,sigma_z,role\n")
    found = recognise(folder)
    assert (found.buildings, found.bridges, found.sheets) == (
        "budovy.gpkg",
        "bridges.gpkg",
        "sm5.gpkg",
    )
    assert (found.woods, found.water) == ("lesni_puda.gpkg", "vodni_plocha.gpkg")
    assert (found.exterior, found.control) == ("eo.csv", "points.csv")
    assert [tell(f"gap.{gap.name}").split(":")[0] for gap in found.gaps] == [
        "the principal distance",
        "fiducials",
    ]


@pytest.mark.parametrize("name", ["dpi_150.points", "dpi_150.tif.points"])
def test_qgis_points_are_what_scans_without_world_files_begin_from__truth(
    folder: Path, name: str
) -> None:
    for path in (folder / "scans").glob("*.tfw"):
        path.unlink()
    assert recognise(folder).georeference == "footprints"
    for stem in ("150", "151"):
        (folder / "scans" / name.replace("150", stem)).touch()
    assert recognise(folder).georeference == "points"


def test_lines_that_are_no_roads_and_other_systems_are_noted__truth(folder: Path) -> None:
    vector(folder / "vrstevnice.gpkg", LINE, "LineString", elev="250")
    vector(folder / "roads" / "gps.gpkg", LINE, "LineString", crs="EPSG:4326", id="1")
    (folder / "scans" / "broken.tif").write_bytes(b"II*\0 not a raster")
    notes = " ".join(
        tell(f"found.note.{note.name}", **note.values) for note in recognise(folder).notes
    )
    assert "vrstevnice.gpkg holds lines that are probably no roads" in notes
    assert "roads/gps.gpkg is in EPSG:4326, not in EPSG:5514" in notes
    assert "scans/broken.tif cannot be read" in notes


def test_scans_among_other_files_are_named_one_by_one__truth(folder: Path) -> None:
    shutil.copy(folder / "dmr5g.tif", folder / "scans" / "dmr.tif")
    found = recognise(folder)
    assert found.scans == ("scans/dpi_150.tif", "scans/dpi_151.tif")
    assert set(found.dem) == {"dmr5g.tif", "scans/dmr.tif"}


def test_a_glob_is_written_where_it_means_no_other_file__law(folder: Path) -> None:
    """Previews and broken sheets, which are left out, were in the glob of what lies beside them."""
    raster(folder / "scans" / "thumb.tif", side=120)
    (folder / "ortho" / "c.tif").write_bytes(b"II*\0 not a raster")
    found = recognise(folder)
    assert found.scans == ("scans/dpi_150.tif", "scans/dpi_151.tif")
    assert found.ortho == ("ortho/a.tif", "ortho/b.tif")
    # The run tells of a broken scan why it was set aside.
    (folder / "scans" / "thumb.tif").write_bytes(b"II*\0 not a raster")
    assert recognise(folder).scans == ("scans/*.tif",)


def test_brackets_in_names_mean_themselves__law(folder: Path) -> None:
    """The glob of such a folder matched no file, and no override such a scan."""
    (folder / "scans").rename(folder / "scans [1938]")
    for name in ("dpi_a[1].tif", "dpi_a1.tif"):
        raster(folder / "roll [2]" / name)
    raster(folder / "roll [2]" / "thumb.tif", side=120)
    path = write_block_toml(recognise(folder))
    with path.open("a", encoding="utf-8") as text:
        text.write('[[scans.override]]\nfile = "dpi_a[1].tif"\ntaken = "1938"\n')
        text.write('[[scans.override]]\nfile = "dpi_15[0].tif"\ntaken = "1939"\n')
    taken = {scan.photo_id: scan.taken for scan in read_project(folder).scans.listed}
    assert taken == {"dpi_a[1]": "1938", "dpi_a1": "", "dpi_150": "1939", "dpi_151": ""}


def test_rows_may_run_to_the_north_and_pixels_be_floats__truth(folder: Path) -> None:
    """Such an ortho was taken for a scan or passed over, such heights for a broken scan."""
    south_up = rasterio.Affine(2.0, 0.0, -743000.0, 0.0, 2.0, -1044000.0)
    raster(folder / "ortho" / "c.tif", bands=3, crs=CRS, transform=south_up)
    raster(folder / "ortho" / "d.tif", bands=3, dtype="float32", crs=CRS, transform=NORTH_UP)
    raster(folder / "dem2.tif", side=100, dtype="float32", crs=CRS, transform=south_up)
    found = recognise(folder)
    assert (found.scans, found.ortho) == (("scans/*.tif",), ("ortho/*.tif",))
    assert found.dem == ("*.tif",)
    assert found.notes == ()
    raster(folder / "ortho" / "classes.tif", bands=7, crs=CRS, transform=NORTH_UP)
    assert noted(recognise(folder)).startswith("ortho/classes.tif is not used")


def test_turned_georeference_with_crs_is_a_scan_and_a_named_sheet_without_is_none__truth(
    tmp_path: Path,
) -> None:
    turned = NORTH_UP @ rasterio.Affine.rotation(12)
    raster(tmp_path / "frame.tif", crs=CRS, transform=turned)
    raster(tmp_path / "ortofoto" / "PRAH71.tif", bands=3, transform=NORTH_UP)
    found = recognise(tmp_path)
    assert found.scans == ("frame.tif",)
    assert found.ortho == ("ortofoto/PRAH71.tif",)
    assert "PRAH71.tif tells no CRS" in " ".join(
        tell(f"found.note.{note.name}", **note.values) for note in found.notes
    )


def test_a_missing_folder_is_told__truth(tmp_path: Path) -> None:
    with pytest.raises(ProjectError, match="is no folder"):
        recognise(tmp_path / "nowhere")


def test_real_block_is_recognised_as_its_own_file_says__real(shared_data: Path) -> None:
    found, project = (
        recognise(shared_data / "vovcha-film"),
        read_project(shared_data / "vovcha-film"),
    )
    assert found.crs == project.block.crs
    assert found.scan_count == len(project.scans.listed)
    assert found.dem == ("dem.tif",)
    assert found.footprints == ("footprints.gpkg", project.scans.footprint_name)
    assert {found.folder / path for path in found.roads} == set(project.reference.roads)


@pytest.mark.parametrize(("pixel_m", "sigmas"), [(0.2, (0.25, 0.5)), (10.0, (10.0, 2.0))])
def test_accuracies_are_expected_of_the_pixels__truth(
    tmp_path: Path, pixel_m: float, sigmas: tuple[float, float]
) -> None:
    """A pixel of the ortho, a fifth of a cell of the terrain: 0.25 m and 0.5 m were proposed."""
    to_scale = rasterio.Affine(pixel_m, 0.0, -743000.0, 0.0, -pixel_m, -1043000.0)
    raster(tmp_path / "ortho.tif", bands=3, crs=CRS, transform=to_scale)
    # In degrees: 9e-5 of them are 10 m to the north, and the mean of both axes counts.
    small = rasterio.Affine(pixel_m * 9e-6, 0.0, 14.0, 0.0, -pixel_m * 9e-6, 0.5)
    raster(tmp_path / "dem.tif", dtype="float32", crs="EPSG:4326", transform=small)
    found = recognise(tmp_path)
    assert found.pixels_m == pytest.approx({"ortho": pixel_m, "dem": pixel_m}, rel=0.01)
    assert tuple(found.sigmas_m.values()) == sigmas
    text = write_block_toml(found).read_text()
    assert (
        f"ortho_sigma_m = {sigmas[0]}  # accuracy of the orthophoto, expected of its pixel" in text
    )


def test_nothing_is_expected_of_a_reference_that_is_not_there__law(tmp_path: Path) -> None:
    assert "sigma" not in write_block_toml(recognise(tmp_path)).read_text()


def test_real_frames_with_a_small_terrain_model__real(shared_data: Path, tmp_path: Path) -> None:
    found = recognise(shared_data / "ngi-baviaanskloof")
    assert (found.scan_count, found.dem) == (4, ("frames/dem.tif",))
    assert "reference/sentinel2_b432_byte.tif" in found.ortho
    (tmp_path / "frames").symlink_to(shared_data / "ngi-baviaanskloof" / "frames")
    (tmp_path / "reference").symlink_to(shared_data / "ngi-baviaanskloof" / "reference")
    assert recognise(tmp_path).sigmas_m == {"ortho_sigma_m": 10.0, "dem_sigma_m": 4.8}


def test_names_are_read_from_a_layer_with_open_rings_without_a_remark__truth(tmp_path):
    ring = [[0, 0], [1, 0], [1, 1]]
    open_ring = {"type": "Polygon", "coordinates": [ring]}
    feature = {"type": "Feature", "properties": {"scan": "00150"}, "geometry": open_ring}
    path = tmp_path / "footprints.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    layer = FoundLayer(path, "footprints", "polygon", None, ("scan",))
    assert layer.values("scan") == {"00150"}
