"""The mosaic of a block: edited seams hold, and what is still right is taken over."""

import shutil
from dataclasses import replace

import numpy as np
import pyogrio.raw
import pytest
import rasterio
import shapely
from affine import Affine

from app.block_sections import BlockSection, OrthoSection
from app.mosaic import edited_seams, make_mosaic, seam_guides
from app.project import ListedScan, Project, ScansSection
from app.references import ReferenceSection
from app.stage_lines import notes_ahead
from core.errors import ProjectError, ReferenceDataError
from core.formats.vectors import write_polygons
from core.mosaic.seam_edits import SeamArea
from core.mosaic.seams import read_seams, write_seams
from core.progress import SILENT
from core.raster.grid import Grid
from sessions.checks import version_on_disk
from sessions.session import Session
from tests.core.mosaic.conftest import CRS, write_ortho
from tests.core.raster_files import write_raster
from tests.flights import FlightPlan, fly

WEST, NORTH, SIDE = 500_000.0, 4_101_000.0, 400


@pytest.fixture
def block(tmp_path):
    """A project, its session and the orthos of two photos that overlap by half."""
    rng = np.random.default_rng(9)
    ground = np.kron(rng.integers(60, 190, (20, 40)), np.ones((20, 20))).astype(np.uint8)
    orthos = []
    for number, name in enumerate(("a", "b")):
        left = 200 * number
        grid = Grid(WEST + left, NORTH, 1.0, SIDE, SIDE)
        nadir = (WEST + left + SIDE / 2, NORTH - SIDE / 2)
        values = ground[:, left : left + SIDE]
        orthos.append(write_ortho(tmp_path / f"{name}.tif", name, grid, values, nadir))
    listed = tuple(ListedScan(n, tmp_path / f"{n}.tif", "wide", 15.0, "1938-05-16") for n in "ab")
    project = Project(
        tmp_path / "block.toml",
        BlockSection("pair", CRS),
        {},
        ScansSection(listed),
        ReferenceSection(),
    )
    with Session.open(tmp_path, "tester") as session:
        yield project, session, orthos


def made(block, **more):
    project, session, orthos = block
    return make_mosaic(session, project, orthos, SILENT, **more)


def edited(path):
    """The seams written again by hand, with the border moved 30 m to the east."""
    a, b = read_seams(path)
    strip = shapely.box(WEST, NORTH - SIDE, b.area.bounds[0] + 30, NORTH).intersection(b.area)
    moved = replace(a, area=a.area.union(strip)), replace(b, area=b.area.difference(strip))
    path.unlink()
    write_seams(moved, path, CRS)
    return [seam.area.area for seam in moved]


def test_seams_carry_the_date_of_their_photo__truth(block):
    made(block)
    seams = read_seams(block[1].results / "seams.gpkg")
    assert {seam.photo_id: seam.date for seam in seams} == dict.fromkeys("ab", "1938-05-16")


def test_nothing_is_made_twice__law(block):
    made(block)
    stamp = (block[1].results / "mosaic.tif").stat().st_mtime_ns
    made(block)
    assert (block[1].results / "mosaic.tif").stat().st_mtime_ns == stamp


def test_edited_seams_hold_and_are_not_written_over__law(block):
    made(block)
    path = block[1].results / "seams.gpkg"
    areas, content = edited(path), path.read_bytes()
    found = made(block)
    assert [seam.area.area for seam in found.seams] == pytest.approx(areas)
    assert path.read_bytes() == content
    # Not even where all is made again, and after another ortho has changed.
    project, session, orthos = block
    orthos[0].path.touch()
    again = make_mosaic(session, project, orthos, SILENT)
    assert [seam.area.area for seam in again.seams] == pytest.approx(areas)
    made(block, anew=True)
    assert path.read_bytes() == content
    path.unlink()
    drawn = made(block)
    assert [seam.area.area for seam in drawn.seams] != pytest.approx(areas)
    assert read_seams(path)[0].area.equals(drawn.seams[0].area)


def test_edited_seams_hold_alone_and_say_so_where_seams_were_laid_at_the_desk__law(block):
    _, session, _ = block
    first = made(block)
    west, south, _, north = next(s for s in first.seams if s.photo_id == "b").area.bounds
    border = (
        (west, south + 10),
        (west + 10, south + 10),
        (west + 10, north - 10),
        (west, north - 10),
    )
    session.record(SeamArea("a", border))
    laid = made(block)
    assert laid.seams[0].area.area > first.seams[0].area.area
    assert edited_seams(session) is None
    path = session.results / "seams.gpkg"
    areas = edited(path)
    found = made(block)
    assert edited_seams(session)
    assert [seam.area.area for seam in found.seams] == pytest.approx(areas)
    assert [str(note).count("1 seam laid at the desk") for note in found.notes] == [1]
    path.unlink()
    again = made(block)
    assert [one.area.area for one in again.seams] == [one.area.area for one in laid.seams]
    assert not again.notes


def test_seams_name_only_photos_that_show_the_ground_and_what_was_edited_stays__truth(block):
    """The polygon of b is renamed to a, which does not reach its eastern half."""
    made(block)
    path = block[1].results / "seams.gpkg"
    a, b = read_seams(path)
    write_seams([a, replace(b, photo_id="a")], path, CRS)
    content = path.read_bytes()
    found = made(block)
    (told,) = found.notes
    assert told.startswith("Edited seams gave a ")
    assert "that it does not show" in told
    # The file stays as it was edited; what holds is told with the mosaic.
    assert path.read_bytes() == content
    area_of = {seam.photo_id: seam.area for seam in found.seams}
    # Its eastern edge, to some cells.
    assert area_of["a"].bounds[2] == pytest.approx(WEST + SIDE, abs=8)
    assert area_of["b"].bounds[0] == pytest.approx(WEST + SIDE, abs=8)
    assert sum(area.area for area in area_of.values()) == pytest.approx(a.area.area + b.area.area)
    # Nothing is made twice.
    stamp = found.path.stat().st_mtime_ns
    assert made(block).notes == found.notes
    assert found.path.stat().st_mtime_ns == stamp


def test_a_file_that_a_gis_only_opened_counts_as_drawn__law(block):
    made(block)
    path = block[1].results / "seams.gpkg"
    seams = read_seams(path)
    path.unlink()
    write_seams(seams, path, CRS)
    pyogrio.raw.write(
        path,
        geometry=shapely.to_wkb(np.array([shapely.Point(0, 0)], dtype=object)),
        field_data=[],
        fields=[],
        geometry_type="Point",
        crs=CRS,
        driver="GPKG",
        layer="layer_styles",
        append=True,
    )
    project, session, orthos = block
    buildings = project.folder / "houses.gpkg"
    east = seams[0].area.bounds[2]
    house = shapely.box(east - 10, NORTH - 210, east, NORTH - 190)
    write_polygons(buildings, "houses", [house], {}, crs=CRS)
    with_houses = replace(project, reference=ReferenceSection(buildings=buildings))
    found = make_mosaic(session, with_houses, orthos, SILENT)
    border = found.seams[0].area.intersection(found.seams[1].area)
    assert border.distance(house) >= 5.0
    assert read_seams(path)[0].area.equals(found.seams[0].area)


def test_an_edit_composes_only_what_it_touches_to_the_same_bytes__law(block):
    made(block)
    path = block[1].results / "seams.gpkg"
    edited(path)
    made(block)
    target = block[1].results / "mosaic.tif"
    part = target.read_bytes()
    made(block, anew=True)
    assert target.read_bytes() == part


def test_seams_of_an_earlier_version_are_drawn_again__law(block):
    first = made(block)
    shutil.rmtree(block[1].products.folder / "mosaic-seams")
    block[2][0].path.touch()
    again = made(block)
    assert [seam.photo_id for seam in again.seams] == [seam.photo_id for seam in first.seams]
    assert (block[1].products.folder / "mosaic-seams").is_dir()


def test_edited_seams_of_nothing_are_refused_and_leave_the_mosaic__truth(block):
    made(block)
    target, path = (block[1].results / name for name in ("mosaic.tif", "seams.gpkg"))
    before = target.read_bytes()
    path.write_bytes(b"no geopackage")
    with pytest.raises(ReferenceDataError, match=r"seams\.gpkg"):
        made(block)
    assert target.read_bytes() == before
    assert path.read_bytes() == b"no geopackage"


def test_guides_are_the_polygons_and_lines_of_the_reference__truth(block):
    project = block[0]
    house, far = (
        shapely.box(WEST + 10, NORTH - 20, WEST + 20, NORTH - 10),
        shapely.box(WEST, NORTH - 900, WEST + 9, NORTH - 890),
    )
    path = project.folder / "houses.gpkg"
    write_polygons(path, "houses", [house, far], {}, crs=CRS)
    for kind in ("buildings", "woods", "water"):
        given = replace(project, reference=ReferenceSection(**{kind: path}))
        guides = seam_guides(given, (WEST, NORTH - 100, WEST + 100, NORTH))
        assert [shape.equals(house) for shape in getattr(guides, kind)] == [True]
        others = {"roads", "buildings", "woods", "water"} - {kind}
        assert not any(getattr(guides, other) for other in others)


def test_buildings_that_are_lines_are_refused_and_nothing_is_written__truth(block):
    """The seams ran through every house, and nothing was said."""
    project, session, orthos = block
    path = project.folder / "houses.gpkg"
    house = shapely.box(WEST + 290, NORTH - 210, WEST + 310, NORTH - 190)
    pyogrio.raw.write(
        path,
        geometry=shapely.to_wkb(np.array([house.boundary], dtype=object)),
        field_data=[],
        fields=[],
        geometry_type="LineString",
        crs=CRS,
        driver="GPKG",
    )
    given = replace(project, reference=ReferenceSection(buildings=path))
    # A run tells it before its stages take minutes.
    with pytest.raises(ReferenceDataError, match="has no polygons in the block"):
        notes_ahead(["orthos", "mosaic"], given)
    assert notes_ahead(["orthos"], given) == []
    with pytest.raises(ReferenceDataError, match="has no polygons in the block") as refused:
        make_mosaic(session, given, orthos, SILENT)
    assert str(path) in str(refused.value)
    assert not [one.name for one in session.results.iterdir() if one.is_file()]


def test_a_mosaic_has_the_tone_it_is_given__truth(block):
    project, session, orthos = block
    lost = replace(project, ortho=OrthoSection(tone="reference"))
    with pytest.raises(ProjectError, match="neither a scan nor a reference ortho is 'reference'"):
        notes_ahead(["mosaic"], lost)
    grays = np.random.default_rng(1).integers(60, 101, (1, 400, 600)).astype(np.uint8)
    ground = write_raster(project.folder / "o.tif", grays, at(1.0), crs=CRS)
    alike = replace(lost, reference=replace(project.reference, ortho=(ground,)))
    assert notes_ahead(["mosaic"], alike) == []
    made = make_mosaic(session, alike, orthos, SILENT)
    with rasterio.open(made.path) as file:
        shown = file.read(1)
    assert np.median(shown[shown > 0]) == pytest.approx(80, abs=2)


def test_buildings_of_another_place_are_told__truth(block):
    project, session, orthos = block
    path = project.folder / "houses.gpkg"
    far = shapely.box(WEST + 9000, NORTH - 210, WEST + 9020, NORTH - 190)
    write_polygons(path, "houses", [far], {}, crs=CRS)
    given = replace(project, reference=ReferenceSection(buildings=path))
    said = ("houses.gpkg has nothing in the block that seams could avoid.",)
    ground = write_raster(
        project.folder / "o.tif", np.full((1, 400, 600), 90, np.uint8), at(1.0), crs=CRS
    )
    on_ortho = replace(given, reference=replace(given.reference, ortho=(ground,)))
    assert notes_ahead(["mosaic"], on_ortho) == [*said]
    assert make_mosaic(session, given, orthos, SILENT).notes == said
    # It stands for as long as the mosaic does.
    assert make_mosaic(session, given, orthos, SILENT).notes == said
    near = shapely.box(WEST + 290, NORTH - 210, WEST + 310, NORTH - 190)
    path.unlink()
    write_polygons(path, "houses", [near], {}, crs=CRS)
    assert make_mosaic(session, given, orthos, SILENT).notes == ()


def at(pixel_m):
    """A raster's place, from the corner of the block."""
    return Affine(pixel_m, 0, WEST, 0, -pixel_m, NORTH)


def test_a_hole_of_the_mosaic_where_the_dem_has_no_height_says_so__truth(block):
    project, session, orthos = block
    for number, ortho in enumerate(orthos):
        with rasterio.open(ortho.path, "r+") as file:
            values = file.read(1)
            for column in (250, 350):
                values[100:120, column - 200 * number :][:, :20] = 0
            file.write(values, 1)
    heights = np.full((200, 300), 250, dtype=np.float32)
    heights[48:62, 123:137] = -9999
    dem = write_raster(project.folder / "d.tif", heights, at(2.0), crs=CRS, nodata=-9999)
    given = replace(project, reference=ReferenceSection(dem=(dem,)))
    holes = make_mosaic(session, given, orthos, SILENT).holes
    assert {hole.east - WEST: hole.without_height for hole in holes} == {260: True, 360: False}


def test_a_hole_names_the_photos_that_something_higher_hides_it_from__truth(block):
    """A yard between walls 30 m high, photographed from 1000 m and 400 m aside of it."""
    project, session, orthos = block
    flight = fly(FlightPlan(ties=40), np.random.default_rng(0)).block
    for ortho, photo, east in zip(orthos, flight.photos.values(), (-100.0, 700.0), strict=False):
        centre = np.array([WEST + east, NORTH - 110, 1250.0])
        high = replace(photo, exterior=replace(photo.exterior, centre=centre))
        camera = flight.camera_of(photo.photo_id)
        session.products.save_value(f"made-with/{ortho.photo_id}", ortho.photo_id, (high, camera))
        left = round(ortho.grid.west - WEST)
        with rasterio.open(ortho.path, "r+") as file:
            values = file.read(1)
            values[100:120, 297 - left : 303 - left] = 0
            values[200:220, 297 - left : 303 - left] = 0
            file.write(values, 1)
    heights = np.full((400, 600), 250, dtype=np.float32)
    heights[90:130, 280:295] = heights[90:130, 305:320] = 280
    dem = write_raster(project.folder / "d.tif", heights, at(1.0), crs=CRS)
    given = replace(project, reference=ReferenceSection(dem=(dem,)))
    for visibility, why in ((True, "hidden"), (False, "masked")):
        asked = replace(given, ortho=OrthoSection(visibility=visibility))
        holes = make_mosaic(session, asked, orthos, SILENT, anew=True).holes
        assert {round(NORTH - hole.north): hole.why for hole in holes} == {110: why, 210: "masked"}
        assert {hole.told_photos for hole in holes} == {("a", "b")}


def test_a_mosaic_that_is_gone_or_another_has_no_version__law(block):
    """Readings and signatures stood for a file that another program had shifted."""
    project, session, orthos = block
    mosaic = make_mosaic(session, project, orthos, SILENT)
    version = version_on_disk(session.products)
    assert version
    aside = mosaic.path.with_suffix(".aside")
    shutil.copy(mosaic.path, aside)
    mosaic.path.unlink()
    assert version_on_disk(session.products) == ""
    with rasterio.open(aside) as kept:
        pixels, profile = kept.read(), kept.profile
    with rasterio.open(mosaic.path, "w", **profile) as shifted:
        shifted.write(np.roll(pixels, 10, axis=2))
    assert version_on_disk(session.products) == ""
    # A copy of the same is the same, whatever its time.
    shutil.copy(aside, mosaic.path)
    assert version_on_disk(session.products) == version
