"""The rasters of origin of a block that was run: photo, standard deviation and ground."""

from dataclasses import replace

import numpy as np
import pytest
import rasterio
import shapely
from cv2 import erode

from app.desk.inputs import desk_inputs, first_snapshot
from app.epochs import origin_files
from app.origin import make_origin
from app.project import described, read_project
from core.formats.xml_files import read_xml
from core.matching.reference import level_of, open_heights
from core.mosaic.origin import MOST_CELLS, ground_classes, origin_grid
from core.raster.grid import Grid
from core.surface.ground import NODATA_M, Ground
from sessions.session import Session
from tests.core.raster_files import write_raster
from ui.review.mosaic import MosaicPicked, picked_part
from ui.web.access import Door


def cells(path):
    with rasterio.open(path) as file:
        east, north = file.transform @ np.stack(
            np.meshgrid(np.arange(file.width) + 0.5, np.arange(file.height) + 0.5)
        )
        return file.read(), east, north


def test_each_cell_has_the_photo_of_the_seams_and_the_sigma_of_the_desk__law(tiny_run):
    results, project = tiny_run.folder / "results", read_project(tiny_run.folder)
    files = origin_files(results)
    (shown,), east, north = cells(files.photo)
    rows = read_xml(results / f"{files.photo.name}.aux.xml").iterfind(".//Row")
    told = [[field.text or "" for field in row] for row in rows]
    names = {int(number): name for number, name, _ in told}
    assert {name: date for _, name, date in told[1:]} == {
        name: project.taken.get(name, "") for name in tiny_run.names
    }
    with Session.open(tiny_run.folder, "ada") as session:
        mosaic = session.products.latest_value("mosaic")
        inputs = desk_inputs(project, session, "ada", Door())
        desk = first_snapshot(inputs)
        # As the desk finds it in the background.
        known = replace(desk.state, evidence=inputs.evidence(inputs.report))
        desk = replace(desk, state=known)
    with rasterio.open(mosaic.path) as file:
        side = round((east[0, 1] - east[0, 0]) / file.res[0])
        seen = np.zeros((shown.shape[0] * side, shown.shape[1] * side), dtype=bool)
        seen[: file.height, : file.width] = file.read_masks(1) > 0
    seen = seen.reshape(shown.shape[0], side, -1, side).any(axis=(1, 3))
    expected = np.zeros(shown.shape, dtype=int)
    for seam in mosaic.seams:
        number = next(number for number, name in names.items() if name == seam.photo_id)
        expected[shapely.contains_xy(seam.area, east, north) & seen] = number
    # Middles that lie on an edge belong to either side.
    edges = shapely.union_all([shapely.boundary(seam.area) for seam in mosaic.seams])
    differs = np.argwhere(shown != expected)
    assert len(differs) < 0.01 * shown.size
    assert all(edges.distance(shapely.Point(east[*p], north[*p])) < 1e-6 for p in differs)
    assert 2 < len(np.unique(shown)) <= 1 + len(tiny_run.names)

    (ground,), _, _ = cells(files.ground)
    assert np.array_equal(ground, np.where(shown > 0, Ground.DEM, Ground.NONE))
    sigmas, _, _ = cells(files.sigma)
    assert np.array_equal(sigmas[0] == NODATA_M, shown == 0)
    rng = np.random.default_rng(9218)
    # Away from the rim, where seams reach up to a cell beyond the picture.
    inside = np.argwhere(erode((shown > 0).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0)
    for row, column in inside[rng.choice(len(inside), 20)]:
        place = float(east[row, column]), float(north[row, column])
        picked = picked_part(MosaicPicked("s", *place, 1), desk)
        assert picked["photo"] == names[int(shown[row, column])]
        # The desk tells centimetres, the raster millimetres.
        assert sigmas[:, row, column] == pytest.approx(picked["sigma"], abs=0.005 + 1 / 2048)


def test_nothing_of_it_is_made_twice__law(tiny_run):
    project = read_project(tiny_run.folder)
    given = described(project)
    with Session.open(tiny_run.folder, "ada") as session:
        products = session.products
        report, mosaic = (products.latest_value(name) for name in ("adjustment", "mosaic"))
        block = products.latest_value("control").report.block
        bounds = products.latest_value("georeference").block.search_bounds
        dem = open_heights(given.reference, level_of(block)).cropped(bounds)

        def stamps():
            files = make_origin(session, project, given, mosaic, report, dem)
            return {path: path.stat().st_mtime_ns for path in files.every}

        first = stamps()
        assert first == stamps()
        content = {path: path.read_bytes() for path in first}
        origin_files(session.results).ground.unlink()
        again = stamps()
        assert again.keys() == first.keys()
        assert all(again[path] > first[path] for path in first)
        assert {path: path.read_bytes() for path in first} == content


def test_cells_are_whole_pixels_and_not_too_many__law():
    for gsd, columns, cell in [(0.5, 3000, 2.0), (0.25, 40_000, 5.0), (5.0, 900, 5.0)]:
        mosaic = Grid(1000.0, 9000.0, gsd, columns, 700)
        grid = origin_grid(mosaic)
        assert grid.ground_sample_distance_m == cell
        assert grid.columns == -(-columns * gsd // cell) <= MOST_CELLS
        assert (grid.west, grid.north) == (mosaic.west, mosaic.north)


def test_classes_are_those_of_the_ground_and_beyond_it_the_dem__truth(tmp_path):
    classes = np.array([[1, 2], [3, 4]], dtype=np.uint8)
    path = write_raster(
        tmp_path / "ground.tif", classes, rasterio.Affine(3, 0, 103, 0, -3, 197), crs="EPSG:32633"
    )
    shown = np.ones((6, 5), dtype=np.int32)
    shown[0] = 0
    found = ground_classes(shown, Grid(100.0, 200.0, 2.0, 5, 6), path)
    # Middles at 101, 103, 105, 107, 109 east, and down from 199.
    assert found.tolist() == [
        [0, 0, 0, 0, 0],
        [4, 1, 1, 2, 4],
        [4, 1, 1, 2, 4],
        [4, 3, 3, 4, 4],
        [4, 4, 4, 4, 4],
        [4, 4, 4, 4, 4],
    ]
