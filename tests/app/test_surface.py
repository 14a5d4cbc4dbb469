"""The surface of a block on disk: written whole, not made twice, removed where there is none."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import laspy
import numpy as np
import pyogrio
import pytest
import rasterio
import shapely

from app.project import read_project
from app.run import WHEN_ASKED, Run, RunOptions
from app.surface import (
    CLOUD,
    CONTOURS,
    chosen_ground,
    make_block_surface,
    make_ground,
    make_layers,
    surface_line,
)
from core.doubts import Failure
from core.formats.vectors import write_polygons
from core.geometry.robust import nmad
from core.progress import Work
from core.raster.dem import open_dem
from core.surface.stage import SurfaceFiles, SurfaceOptions
from sessions.session import Session
from tests.app.test_run import Listener
from tests.tiny import Tiny

CELL_M = 10.0


class Told:
    """Progress that counts reports."""

    def __init__(self) -> None:
        self.shares: list[float] = []

    def report(self, done: float, total: float, what: str = "") -> None:
        self.shares.append(done / total)


@pytest.fixture
def asked(tiny_run: Tiny):
    project = read_project(tiny_run.folder)
    with Session.open(tiny_run.folder, "tester") as session:
        yield session, replace(project, surface=SurfaceOptions(CELL_M))
    for path in SurfaceFiles.within(tiny_run.folder / "results").paths:
        path.unlink(missing_ok=True)


def test_a_surface_is_made_once_and_is_the_ground__truth(asked, tiny_run):
    session, project = asked
    report = session.products.latest_value("adjustment")
    told, again = Told(), Told()
    made = make_block_surface(
        session, project, report, tiny_run.reference.dem, Work(told, seed="tiny")
    )
    assert told.shares == sorted(told.shares)
    assert told.shares[-1] == pytest.approx(1.0)
    kept = make_block_surface(session, project, report, tiny_run.reference.dem, Work(again))
    assert not again.shares
    assert kept.files == made.files
    assert f"cells of {CELL_M:.2f} m" in surface_line(kept)
    with rasterio.open(made.files.surface) as file:
        heights = file.read(1, masked=True)
    truth = open_dem([tiny_run.folder / "truth" / "terrain.tif"], report.block.crs).on(made.grid)
    errors = (heights - truth).compressed()
    assert made.completeness > 0.85
    assert nmad(errors) < 1.2
    assert abs(np.median(errors)) < 0.5
    made.files.count.unlink()
    make_block_surface(session, project, report, tiny_run.reference.dem, Work(again))
    assert again.shares


def test_where_there_is_no_surface_none_is_left__truth(asked, tiny_run):
    session, project = asked
    report = session.products.latest_value("adjustment")
    files = SurfaceFiles.within(session.results)
    files.surface.touch()
    photos = {name: replace(photo, oriented=False) for name, photo in report.block.photos.items()}
    alone = replace(report, block=report.block.with_photos(photos))
    made = make_block_surface(session, project, alone, tiny_run.reference.dem, Work())
    assert isinstance(made, Failure)
    assert surface_line(made).startswith("no surface: No two photos")
    assert not any(path.exists() for path in files.paths)


def test_on_water_nothing_is_measured__truth(asked, tiny_run, tmp_path):
    session, project = asked
    report = session.products.latest_value("adjustment")
    sea = shapely.box(*report.block.bounds).buffer(100)
    write_polygons(tmp_path / "water.gpkg", "water", [sea], {}, crs=report.block.crs)
    at_sea = replace(project.reference, water=tmp_path / "water.gpkg")
    wet = replace(project, reference=at_sea)
    made = make_block_surface(session, wet, report, tiny_run.reference.dem, Work())
    assert surface_line(made).startswith("no surface: Nothing of the ground was matched")


def test_it_is_walked_only_where_somebody_asks__law(tiny_run):
    project = read_project(tiny_run.folder)

    def names(wanted, options):
        with Session.open(tiny_run.folder, "tester") as session:
            walk = Run(wanted, session, Listener(), options)
            walk.threads.close()
            return [name for name in WHEN_ASKED if walk.asked(name)]

    assert names(project, RunOptions()) == []
    assert names(project, RunOptions(last="surface")) == ["surface"]
    assert names(project, RunOptions(first="surface")) == ["surface"]
    assert names(replace(project, surface=SurfaceOptions()), RunOptions()) == ["surface"]


def test_the_table_alone_asks_for_a_surface__truth(tiny_block, tmp_path):
    folder = Path(shutil.copytree(tiny_block, tmp_path / "block"))
    text = (folder / "block.toml").read_text()
    (folder / "block.toml").write_text(text + "\n[surface]\n")
    assert read_project(folder).surface == SurfaceOptions(None)
    (folder / "block.toml").write_text(text + "\n[surface]\ngsd_m = 2\n")
    assert read_project(folder).surface == SurfaceOptions(2.0)


def test_orthos_stand_on_the_ground_that_was_chosen__truth(asked, tiny_run):
    """Without a choice as before; with one on the DEM and its corrections."""
    session, project = asked
    report, dem = session.products.latest_value("adjustment"), tiny_run.reference.dem
    assert chosen_ground(session, project, dem, dem.bounds) == (dem, ())
    surface = make_block_surface(session, project, report, dem, Work())
    own = replace(project, ortho=replace(project.ortho, ground="auto"))
    assert "surface" in own.asked_for
    assert "surface" in replace(own, surface=None).asked_for
    assert "surface" not in replace(project, surface=None).asked_for
    make_ground(session, own, surface)
    heights, (file,) = chosen_ground(session, own, dem, dem.bounds)
    first = file.stat().st_mtime_ns
    make_ground(session, own, surface)
    assert file.stat().st_mtime_ns == first
    # The ground of this block has not changed.
    middle = report.block.origin[:2] + np.array([[0.0, 0.0], [150.0, 80.0], [-200.0, 120.0]])
    np.testing.assert_allclose(heights.heights(middle), dem.heights(middle), atol=0.01)
    with rasterio.open(file) as raster:
        raised = np.ones((raster.height, raster.width), np.float32)
        profile = raster.profile
    with rasterio.open(file, "w", **profile) as raster:
        raster.write(5 * raised, 1)
    higher, _ = chosen_ground(session, own, dem, dem.bounds)
    np.testing.assert_allclose(higher.heights(middle), dem.heights(middle) + 5, atol=0.01)
    # Bridges lie over either.
    east, north = middle[0]
    bridges = session.folder / "bridges.geojson"
    corners = shapely.box(east - 50, north - 50, east + 50, north + 50).exterior.coords
    deck = shapely.Polygon([(*corner, dem.heights(middle)[0] + 30) for corner in corners])
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::5514"}}
    feature = {"type": "Feature", "properties": {}, "geometry": shapely.geometry.mapping(deck)}
    collection = {"type": "FeatureCollection", "crs": crs, "features": [feature]}
    bridges.write_text(json.dumps(collection))
    over = replace(own, reference=replace(own.reference, bridges=bridges))
    bridged, files = chosen_ground(session, over, dem, dem.bounds)
    assert files == (file, bridges)
    lift = bridged.heights(middle) - dem.heights(middle)
    np.testing.assert_allclose(lift, [30, 5, 5], atol=0.01)
    make_ground(session, project, surface)
    assert not file.exists()


def test_point_cloud_and_contours_come_and_go_with_their_keys__law(asked, tiny_run):
    session, project = asked
    report, dem = session.products.latest_value("adjustment"), tiny_run.reference.dem
    wanted = replace(project, surface=SurfaceOptions(CELL_M, point_cloud=True, contours_m=5.0))
    surface = make_block_surface(session, wanted, report, dem, Work(seed="tiny"))
    assert not isinstance(surface, Failure)
    cloud, contours = session.results / CLOUD, session.results / CONTOURS
    with rasterio.open(surface.files.surface) as file:
        heights = file.read(1, masked=True)
    assert laspy.read(cloud).header.point_count == heights.count()
    lines = pyogrio.raw.read(contours)
    assert (lines[3][0] % 5 == 0).all()
    assert heights.min() <= lines[3][0].min()
    assert lines[3][0].max() <= heights.max()
    made = cloud.stat().st_mtime_ns, contours.stat().st_mtime_ns
    make_layers(session, wanted, surface, Work())
    assert (cloud.stat().st_mtime_ns, contours.stat().st_mtime_ns) == made
    # The surface itself is not made again for either.
    told = Told()
    make_block_surface(session, project, report, dem, Work(told, seed="tiny"))
    assert told.shares == []
    make_layers(session, project, surface, Work())
    assert not cloud.exists()
    assert not contours.exists()
