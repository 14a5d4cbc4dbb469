"""Approximate exterior orientation from each source, judged by photos we placed ourselves."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from affine import Affine
from hypothesis import given, settings
from hypothesis import strategies as st
from pyproj import CRS
from rasterio.control import GroundControlPoint
from shapely.geometry import Polygon, box

from core.doubts import Failure
from core.errors import CrsError, ProjectError, ScanError
from core.formats.eo_list import EoRecord
from core.formats.outlines import Footprint, Footprints
from core.formats.qgis_points import QgisPoints
from core.formats.world_file import WorldFile, write_world_file
from core.geometry.camera import Camera
from core.geometry.collinearity import object_from_film
from core.geometry.crs import operation_between
from core.geometry.exterior import ExteriorOrientation
from core.geometry.interior import fit_interior, nominal_interior
from core.geometry.transforms import apply_affine, compose_affine, fit_affine, fit_similarity
from core.georeference.approximation import (
    Ground,
    approximate_from_eo,
    approximate_from_footprint,
    approximate_from_points,
    approximate_from_world_file,
    flight_directions,
    world_in_block,
)
from core.georeference.archive import (
    Georeference,
    footprints_in_block,
    georeference_photo,
    open_archive,
)
from core.raster.dem import Dem, open_dem
from core.raster.files import open_plain
from core.raster.scan_file import open_scan
from core.scans.film_area import area_from_interior
from core.scans.interior_orientation import ScanOrientation, orient_scan
from tests.core.raster_files import write_footprints
from tests.core.scans.film_maker import Film, make_film, write_gray

CAMERA = Camera("wide", 152.0, (230.0, 230.0), principal_point_mm=(0.1, -0.2))
INTERIOR = nominal_interior((16000, 16200), CAMERA, 0.015)
CZECH = Ground("EPSG:5514", 250.0)
PIXELS = np.array([[500.0, 700], [15000, 900], [14800, 15500], [600, 15200]])


def on_ground(
    exterior: ExteriorOrientation, pixels: np.ndarray, height: float = 250.0
) -> np.ndarray:
    film = INTERIOR.film_from_pixel(pixels)
    return object_from_film(film, np.full(len(film), height), exterior, CAMERA)[:, :2]


def world_of(exterior: ExteriorOrientation) -> WorldFile:
    fit = fit_similarity(PIXELS, on_ground(exterior, PIXELS), mirrored=True)
    return WorldFile(Path("scan.tfw"), fit.matrix)


def angle_apart(one: float, other: float) -> float:
    return float(abs(np.angle(np.exp(1j * (one - other)))))


@settings(max_examples=30)
@given(st.floats(-3.1, 3.1), st.floats(1500, 6000))
def test_world_file_of_a_vertical_photo__law(kappa: float, height: float) -> None:
    true = ExteriorOrientation(np.array([-580000.0, -1190000.0, height]), 0.0, 0.0, kappa)
    found = approximate_from_world_file(world_of(true), INTERIOR, CAMERA, CZECH)
    np.testing.assert_allclose(found.exterior.centre, true.centre, atol=1e-3)
    assert angle_apart(found.exterior.kappa, kappa) < 1e-9
    assert not found.doubts


def test_world_file_of_a_tilted_photo_lies_within_its_prior__truth() -> None:
    rng = np.random.default_rng(1)
    for _ in range(40):
        tilt = np.radians(rng.normal(0, 2, 2)).tolist()
        true = ExteriorOrientation(
            np.array([-580000.0, -1190000.0, 3600.0]), tilt[0], tilt[1], float(rng.uniform(-3, 3))
        )
        found = approximate_from_world_file(world_of(true), INTERIOR, CAMERA, CZECH)
        # The centre of a tilted photo is not over its principal point: H tan(tilt) aside.
        aside_m = (3600 - 250) * found.prior.sigma_angles[[1, 0, 0]] * [1, 1, 0]
        off = (found.exterior.centre - true.centre) / np.hypot(found.prior.sigma_centre_m, aside_m)
        assert np.abs(off).max() < 3
        assert angle_apart(found.exterior.kappa, true.kappa) < 4 * found.prior.sigma_angles[2]


def test_kobyli_1984__paper() -> None:
    """METHODS 1.1: GSD 0.3560 m, c 151.99 mm and 15 um pixels give 3607 m over ground."""
    corner = np.array([[-0.35403, 0.03754], [0.03754, 0.35403]])
    world = WorldFile(Path("s.tfw"), np.column_stack([corner, [-576837.67, -1195069.54]]))
    camera = Camera("wide", 151.99, (230.0, 230.0))
    found = approximate_from_world_file(world, INTERIOR, camera, CZECH)
    assert found.exterior.centre[2] - 250 == pytest.approx(3607, abs=1)
    assert np.degrees(found.exterior.kappa) == pytest.approx(173.9, abs=0.1)


def test_mirrored_world_file_is_refused__truth() -> None:
    world = WorldFile(Path("s.tfw"), np.array([[0.5, 0, -580000.0], [0, 0.5, -1190000.0]]))
    with pytest.raises(ScanError, match="mirrored"):
        approximate_from_world_file(world, INTERIOR, CAMERA, CZECH)


def test_a_mirrored_scan_has_a_mirrored_world_file__truth() -> None:
    """Film scanned from its back: columns run the other way, in the scan and on the ground."""
    true = ExteriorOrientation(np.array([-580000.0, -1190000.0, 3600.0]), 0.0, 0.0, 0.7)
    straight = world_of(true)
    over = np.array([[-1.0, 0.0, 16000.0], [0.0, 1.0, 0.0]])
    film = INTERIOR.film_from_pixel(apply_affine(over, PIXELS))
    back = fit_interior(("1", "2", "3", "4"), PIXELS, film, "similarity", mirrored=True)
    turned = replace(straight, object_from_pixel=compose_affine(straight.object_from_pixel, over))
    found = approximate_from_world_file(turned, back, CAMERA, CZECH)
    np.testing.assert_allclose(found.exterior.centre, true.centre, atol=0.01)
    assert angle_apart(found.exterior.kappa, true.kappa) < 1e-6
    with pytest.raises(ScanError, match="from its back"):
        approximate_from_world_file(straight, back, CAMERA, CZECH)


@pytest.mark.parametrize("crs", ["EPSG:32633", "EPSG:3857", "EPSG:4326", "EPSG:5514"])
def test_the_crs_of_a_georeferenced_scan_is_obeyed__truth(crs: str) -> None:
    czech = world_of(ExteriorOrientation(np.array([-580000.0, -1190000, 3600]), 0.0, 0.0, 0.7))
    corners = np.array([[0.0, 0.0], [16000, 0], [16000, 16200], [0, 16200]])
    plane = apply_affine(czech.object_from_pixel, corners)
    there = operation_between("EPSG:5514", crs, plane, "scan.tif").forward(plane)
    world = WorldFile(Path("scan.tif"), fit_affine(corners, there).matrix, CRS(crs).to_wkt())
    moved = world_in_block(world, (16000, 16200), "EPSG:5514")
    away = apply_affine(moved.object_from_pixel, corners) - plane
    assert np.abs(away).max() < 2.0
    assert not moved.mirrored


def test_exchanged_lines_are_doubted__truth() -> None:
    """METHODS W1 seen from the reader: lines 2 and 3 exchanged make a stretched photo."""
    world = WorldFile(Path("s.tfw"), np.array([[0.5, 0.04, -580000.0], [0.04, -0.45, -1190000.0]]))
    found = approximate_from_world_file(world, INTERIOR, CAMERA, CZECH)
    assert [doubt.kind for doubt in found.doubts] == ["world-file-affine"]


@pytest.mark.parametrize(
    ("east", "north", "words"),
    [(580000.0, 1190000.0, "positive"), (1190000.0, 580000.0, "5513"),
     (-1190000.0, -580000.0, "swapped")],
)  # fmt: skip
def test_krovak_slips_are_named__truth(east: float, north: float, words: str) -> None:
    world = WorldFile(Path("s.tfw"), np.array([[0.5, 0, east], [0, -0.5, north]]))
    with pytest.raises(CrsError, match=words):
        approximate_from_world_file(world, INTERIOR, CAMERA, CZECH)


def test_far_outside_the_dem_is_refused__truth() -> None:
    ground = Ground("EPSG:5514", 250.0, (-700000.0, -1100000.0, -690000.0, -1090000.0))
    with pytest.raises(CrsError, match=r"km outside the DEM.*crs"):
        approximate_from_world_file(
            world_of(ExteriorOrientation(np.array([-580000.0, -1190000, 3000]), 0.0, 0.0, 0.0)),
            INTERIOR,
            CAMERA,
            ground,
        )


def test_clicked_points_place_the_photo__truth() -> None:
    rng = np.random.default_rng(2)
    true = ExteriorOrientation(np.array([-580000.0, -1190000.0, 3600.0]), 0.01, -0.02, 2.0)
    plane = on_ground(true, PIXELS) + rng.normal(0, 5, (4, 2))
    plane[3] += 4000.0
    points = QgisPoints(
        Path("s.points"), "EPSG:5514", plane, PIXELS, np.array([True, True, True, False])
    )
    found = approximate_from_points(points, INTERIOR, CAMERA, CZECH)
    assert np.abs((found.exterior.centre - true.centre) / found.prior.sigma_centre_m).max() < 5
    assert angle_apart(found.exterior.kappa, true.kappa) < 0.02
    with pytest.raises(ScanError, match="Click two points"):
        approximate_from_points(
            QgisPoints(Path("s.points"), "", plane, PIXELS, np.array([True, False, False, False])),
            INTERIOR,
            CAMERA,
            CZECH,
        )


def test_clicked_points_of_another_crs_are_moved__oracle() -> None:
    from pyproj import Transformer

    true = ExteriorOrientation(np.array([-580000.0, -1190000.0, 3600.0]), 0.0, 0.0, 0.5)
    to_utm = Transformer.from_crs("EPSG:5514", "EPSG:32633", always_xy=True)
    plane = np.column_stack(to_utm.transform(*on_ground(true, PIXELS).T))
    points = QgisPoints(Path("s.points"), "EPSG:32633", plane, PIXELS, np.ones(4, dtype=bool))
    found = approximate_from_points(points, INTERIOR, CAMERA, CZECH)
    np.testing.assert_allclose(found.exterior.centre[:2], true.centre[:2], atol=3)


@pytest.mark.parametrize("kappa_deg", [-170.0, -91.0, 3.0, 44.0, 120.0])
def test_one_hypothesis_of_a_footprint_is_right__truth(kappa_deg: float) -> None:
    true = ExteriorOrientation(
        np.array([-580000.0, -1190000, 3600]), 0.0, 0.0, float(np.radians(kappa_deg))
    )
    corners = INTERIOR.pixel_from_film(CAMERA.frame_corners_mm)
    footprint = Footprint(Path("f.gpkg"), "a", Polygon(on_ground(true, corners)))
    found = approximate_from_footprint(footprint, CAMERA, CZECH)
    assert len(found.hypotheses) == 4
    assert min(angle_apart(h.kappa, true.kappa) for h in found.hypotheses) < 1e-6
    np.testing.assert_allclose(found.exterior.centre, true.centre, atol=10)


def test_oblong_footprint_has_two_hypotheses__truth() -> None:
    camera = Camera("dmc", 120.0, (92.16, 165.888))
    footprint = Footprint(Path("f.gpkg"), "a", box(-581659, -1190500, -580000, -1189578))
    found = approximate_from_footprint(footprint, camera, CZECH)
    assert sorted(round(np.degrees(h.kappa)) for h in found.hypotheses) == [-90, 90]
    assert found.exterior.centre[2] - 250 == pytest.approx(1200, rel=0.01)


def test_list_with_and_without_angles__truth() -> None:
    full = EoRecord("a", (-580000.0, -1190000.0, 3000.0), (0.01, 0.02, 3.0), (1.0, 1.0, 2.0))
    found = approximate_from_eo(full, Path("eo.csv"), CZECH)
    assert found.exterior.kappa == 3.0
    assert found.prior.sigma_centre_m.tolist() == [1.0, 1.0, 2.0]
    np.testing.assert_allclose(np.degrees(found.prior.sigma_angles), 0.5)
    bare = EoRecord("a", (-580000.0, -1190000.0, 3000.0), None, (200.0, 200.0, 50.0))
    found = approximate_from_eo(bare, Path("eo.csv"), CZECH, direction=0.3)
    assert [round(h.kappa, 6) for h in found.hypotheses] == pytest.approx(
        [0.3, 0.3 - np.pi, 0.3 + np.pi / 2, 0.3 - np.pi / 2], abs=1e-5
    )
    with pytest.raises(ProjectError, match="below the ground"):
        approximate_from_eo(EoRecord("a", (-580000.0, -1190000.0, 90.0)), Path("eo.csv"), CZECH)


def test_direction_of_flight_is_along_the_strip__truth() -> None:
    along = np.array([np.cos(0.4), np.sin(0.4)])
    across = np.array([-along[1], along[0]])
    centres = {
        f"{s}{i}": np.array([*(i * 900 * along + s * 1700 * across), 3000.0])
        for s in range(2)
        for i in range(3)
    }
    for direction in flight_directions(centres).values():
        assert abs(np.sin(direction - 0.4)) < 1e-9
    assert flight_directions({"a": np.zeros(3)}) == {}


def test_footprints_without_crs_are_told_by_range__truth() -> None:
    czech = Footprint(Path("f"), "a", box(-581000, -1191000, -578000, -1188000))
    assert footprints_in_block(Footprints(Path("f"), None, {"a": czech}), "EPSG:5514") == {
        "a": czech
    }
    utm = Footprint(Path("f"), "a", box(640000, 5410000, 643000, 5413000))
    moved = footprints_in_block(Footprints(Path("f"), None, {"a": utm}), "EPSG:5514")["a"].polygon
    assert -700000 < moved.centroid.x < -500000
    assert -1250000 < moved.centroid.y < -1100000
    nowhere = Footprint(Path("f"), "a", box(100, 200, 300, 400))
    with pytest.raises(CrsError, match="names no CRS"):
        footprints_in_block(Footprints(Path("f"), None, {"a": nowhere}), "EPSG:5514")


@pytest.fixture
def small_block(tmp_path: Path) -> Path:
    from rasterio.transform import Affine

    make_film(tmp_path / "p1.tif", Film(fiducials={}))
    write_gray(
        tmp_path / "dem.tif",
        np.full((60, 60), 300.0, np.float32),
        transform=Affine(50, 0, 640000, 0, -50, 5413000),
        crs="EPSG:32633",
    )
    return tmp_path


LITTLE = Camera("little", 60.0, (60.0, 60.0))


def plain_scan(folder: Path) -> tuple[ScanOrientation, Dem]:
    """A scan of nothing, and level ground around it."""
    path = folder / "p1.tif"
    write_gray(path, np.zeros((1500, 1500), np.uint8))
    scan, interior = open_scan(path), nominal_interior((1500, 1500), LITTLE, 0.04)
    write_gray(
        folder / "dem.tif", np.full((60, 60), 300.0, np.float32),
        transform=Affine(50, 0, 640000, 0, -50, 5413000), crs="EPSG:32633",
    )  # fmt: skip
    area = area_from_interior(interior, LITTLE)
    oriented = ScanOrientation("p1", scan, interior, (), area, ())
    return oriented, open_dem([folder / "dem.tif"], "EPSG:32633")


@pytest.mark.parametrize("spoilt", ["mapX,mapY\n1,2\n", "mapX,mapY,sourceX,sourceY\n1,2,3,4\n"])
def test_points_that_cannot_be_used_hold_up_no_other_source__truth(
    tmp_path: Path, spoilt: str
) -> None:
    """A scan with a sound world file was set aside for the sake of its .points."""
    oriented, dem = plain_scan(tmp_path)
    (tmp_path / "p1.tif.points").write_text(spoilt)
    archive = open_archive(Georeference(), "EPSG:32633", ["p1"], dem.bounds)
    with pytest.raises(ScanError, match=r"p1\.tif\.points"):
        georeference_photo(oriented, LITTLE, archive, dem)
    write_world_file(tmp_path / "p1.tfw", np.array([[0.8, 0, 641000.0], [0, -0.8, 5412300.0]]))
    found = georeference_photo(oriented, LITTLE, archive, dem)
    assert not isinstance(found, Failure)
    assert found.source == "world-file"
    (doubt,) = found.doubts
    assert (doubt.kind, doubt.subject) == ("georeference-unused", "p1")
    assert "p1.tif.points: " in doubt.message
    asked = replace(archive, georeference=Georeference("points"))
    with pytest.raises(ScanError, match=r"p1\.tif\.points"):
        georeference_photo(oriented, LITTLE, asked, dem)
    sought = replace(archive, georeference=Georeference("none", scale_number=20_000))
    found = georeference_photo(oriented, LITTLE, sought, dem)
    assert not isinstance(found, Failure)
    assert (found.source, found.doubts[-1].kind) == ("area", "georeference-unused")


def test_who_wants_no_source_is_placed_by_none__truth(tmp_path: Path) -> None:
    """World files and footprints were read all the same."""
    oriented, dem = plain_scan(tmp_path)
    write_world_file(tmp_path / "p1.tfw", np.array([[0.8, 0, 641000.0], [0, -0.8, 5412300.0]]))
    outline = {"p1.tif": box(641000, 5411000, 642200, 5412200)}
    write_footprints(tmp_path / "f.gpkg", outline, "n", "EPSG:32633")
    wanted = Georeference("none", tmp_path / "f.gpkg", "n")
    archive = open_archive(wanted, "EPSG:32633", ["p1"], dem.bounds)
    found = georeference_photo(oriented, LITTLE, archive, dem)
    assert isinstance(found, Failure)
    assert 'georeference is "none"' in found.reason
    (tmp_path / "p1.tif.points").write_text(
        "mapX,mapY,sourceX,sourceY\n641000,5412300,0,0\n642200,5412300,1500,0\n"
    )
    found = georeference_photo(oriented, LITTLE, archive, dem)
    assert not isinstance(found, Failure)
    assert (found.source, found.doubts) == ("points", ())


@pytest.mark.parametrize("inside", ["transform", "points"])
def test_a_scan_georeferenced_inside_in_another_crs__truth(tmp_path: Path, inside: str) -> None:
    """The same scan with a georeference in the block's CRS lies in the same place."""
    oriented, dem = plain_scan(tmp_path)
    camera, path = LITTLE, tmp_path / "p1.tif"
    pixels = np.array([[0.0, 0.0], [1500, 0], [1500, 1500], [0, 1500]])
    plane = np.array([641000.0, 5412300.0]) + pixels * (0.8, -0.8)
    web = operation_between("EPSG:32633", "EPSG:3857", plane, path).forward(plane)
    with open_plain(path, {"mode": "r+"}) as dataset:
        if inside == "transform":
            dataset.transform = Affine(*fit_affine(pixels, web).matrix.ravel().tolist())
            dataset.crs = "EPSG:3857"
        else:
            pairs = zip(pixels, web, strict=True)
            points = [GroundControlPoint(p[1], p[0], w[0], w[1]) for p, w in pairs]
            dataset.gcps = (points, "EPSG:3857")
    archive = open_archive(Georeference("world-file"), "EPSG:32633", ["p1"], dem.bounds)
    found = georeference_photo(oriented, camera, archive, dem)
    assert not isinstance(found, Failure)
    np.testing.assert_allclose(found.exterior.centre, (641600, 5411700, 300 + 1200), atol=1.0)
    assert abs(found.exterior.kappa) < 1e-3


@pytest.mark.slow
def test_sources_stand_in_for_each_other__truth(small_block: Path) -> None:
    camera = Camera("little", 60.0, (60.0, 60.0))
    oriented = orient_scan(small_block / "p1.tif", camera, 40.0)
    dem = open_dem([small_block / "dem.tif"], "EPSG:32633")
    nothing = open_archive(Georeference(), "EPSG:32633", ["p1"], dem.bounds)
    assert isinstance(georeference_photo(oriented, camera, nothing, dem), Failure)
    somewhere = replace(nothing, georeference=Georeference(scale_number=20_000))
    found = georeference_photo(oriented, camera, somewhere, dem)
    assert not isinstance(found, Failure)
    assert found.source == "area"
    assert found.exterior.centre[2] == pytest.approx(300 + 1200)
    assert len(found.hypotheses) == 4
    west, south, east, north = dem.bounds
    assert 2.5 * found.prior.sigma_centre_m[0] >= max(east - west, north - south) / 2

    write_footprints(
        small_block / "f.gpkg", {"P1.TIF": box(641000, 5411000, 642200, 5412200)}, "n", "EPSG:32633"
    )
    georeference = Georeference("world-file", small_block / "f.gpkg", "n")
    archive = open_archive(georeference, "EPSG:32633", ["p1"], dem.bounds)
    found = georeference_photo(oriented, camera, archive, dem)
    assert not isinstance(found, Failure)
    assert found.source == "footprints"
    assert [doubt.kind for doubt in found.doubts] == ["georeference-missing"]
    assert found.exterior.centre[2] == pytest.approx(300 + 1200)

    write_world_file(small_block / "p1.tfw", np.array([[0.8, 0, 641000.0], [0, -0.8, 5412300.0]]))
    found = georeference_photo(oriented, camera, archive, dem)
    assert not isinstance(found, Failure)
    assert found.source == "world-file"
    assert found.exterior.centre[2] == pytest.approx(300 + 1200, rel=0.01)

    (small_block / "eo.csv").write_text("scan,X,Y,Z\nP1.tif,641600,5411600,1500\n")
    listed = open_archive(
        Georeference(exterior=small_block / "eo.csv"), "EPSG:32633", ["p1"], dem.bounds
    )
    found = georeference_photo(oriented, camera, listed, dem)
    assert not isinstance(found, Failure)
    assert found.source == "exterior"
    assert len(found.hypotheses) == 4
