"""Orthos of a block on disk: which are made, which stay, which go."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest
import shapely
from affine import Affine
from shapely.geometry import box

import app.orthos
from app.block_sections import OrthoSection
from app.orthos import default_gsd_m, make_orthos
from core.errors import Cancelled, ProjectError, StorageError
from core.formats.vectors import write_polygons
from core.mosaic.composition import MosaicProduct
from core.mosaic.seams import Seam
from core.orthos.rectification import OrthoProduct, ortho_grid
from core.progress import SILENT
from core.raster.dem import level_ground, open_dem
from core.raster.grid import Grid
from sessions.checks import version_on_disk
from sessions.session import Session
from tests.core.raster_files import write_raster
from tests.flights import FlightPlan, fly


def test_orthos_are_as_fine_as_the_scans__truth():
    """15 um at 1 : 15 000 is 22 cm on the ground, and the next round figure 25 cm."""
    flight = fly(FlightPlan(ties=40), np.random.default_rng(0))
    assert default_gsd_m(flight.block) == 0.25


BLOCK = fly(FlightPlan(ties=40), np.random.default_rng(0)).block
GROUND = level_ground(0.0, BLOCK.crs)
PROJECT: Any = SimpleNamespace(
    file="block.toml",
    block=SimpleNamespace(crs=BLOCK.crs),
    ortho=OrthoSection(gsd_m=1.0),
    reference=SimpleNamespace(dem=()),
)


@pytest.fixture
def made(monkeypatch):
    """The photos of which an ortho was made, of one pixel and no scan."""

    class Names(list[str]):
        asked: ClassVar[dict[str, bool]] = {}

    names = Names()

    def rectified(photo, camera, heights, gsd, path, crs, *, options, **how):
        names.append(photo.photo_id)
        names.asked[photo.photo_id] = options.visibility
        path.write_bytes(b"pixels")
        return OrthoProduct(photo.photo_id, path, Grid(0, 1, 1.0, 1, 1), 1.0, (0.0, 0.0))

    monkeypatch.setattr(app.orthos, "rectify_photo", rectified)
    monkeypatch.setattr(app.orthos, "chosen_ground", lambda *given: (GROUND, ()))
    return names


def test_an_ortho_goes_with_its_photo_and_nothing_else_does__law(tmp_path, made):
    block, ground, project = BLOCK, GROUND, PROJECT
    first, *others = block.photos
    fewer = replace(
        block, photos={**block.photos, first: replace(block.photos[first], oriented=False)}
    )
    with Session.open(tmp_path, "ada") as session:
        make_orthos(session, project, block, ground, SILENT)
        folder = session.results / "ortho"
        foreign = folder / "somebodys.tif"
        foreign.write_bytes(b"not ours")
        make_orthos(session, project, fewer, ground, SILENT, only=frozenset(others[:1]))
        assert (folder / f"{first}.tif").is_file(), "the desk makes some anew, and keeps the rest"
        make_orthos(session, project, fewer, ground, SILENT)
        assert {path.stem for path in folder.iterdir()} == {*others, "somebodys"}
        made.clear()
        make_orthos(session, project, block, ground, SILENT)
    assert made == [first]


def test_orthos_with_visibility_are_made_again_and_those_without_come_back__law(tmp_path, made):
    asked: Any = SimpleNamespace(
        **(vars(PROJECT) | {"ortho": replace(PROJECT.ortho, visibility=True)})
    )
    with Session.open(tmp_path, "ada") as session:
        for project, makes in ((PROJECT, 1), (asked, 1), (asked, 0), (PROJECT, 1)):
            made.clear()
            make_orthos(session, project, BLOCK, GROUND, SILENT)
            assert len(made) == makes * len(BLOCK.photos)
            assert all(made.asked[name] is project.ortho.visibility for name in made)


def test_a_mosaic_keeps_its_version_while_its_orthos_are_made_again__law(tmp_path, made):
    """Readings of a mosaic became those of another as soon as the first of its orthos was new."""
    seams = tuple(
        Seam(name, "", box(10 * k, 0, 10 * k + 10, 10)) for k, name in enumerate(BLOCK.photos)
    )
    aside = {
        name: replace(photo, exterior=replace(photo.exterior, centre=photo.exterior.centre + 1.0))
        for name, photo in BLOCK.photos.items()
    }

    class Stopped:
        def report(self, done, total, what=""):
            if len(made) == 1:
                raise Cancelled

    with Session.open(tmp_path, "ada") as session:
        products = session.products
        make_orthos(session, PROJECT, BLOCK, GROUND, SILENT)
        mosaic = MosaicProduct(tmp_path / "mosaic.tif", Grid(0, 10, 1, 10, 10), seams, {}, 1.0)
        # As earlier versions left it: nothing is kept but the mosaic.
        products.save_value("mosaic", products.digest_of("earlier"), mosaic)
        before = version_on_disk(products)
        made.clear()
        with pytest.raises(Cancelled):
            make_orthos(session, PROJECT, BLOCK.with_photos(aside), GROUND, Stopped())
        assert len(made) == 1
        assert version_on_disk(products) == before
        make_orthos(session, PROJECT, BLOCK.with_photos(aside), GROUND, SILENT)
        products.save_value("mosaic", products.digest_of("later"), mosaic)
        assert version_on_disk(products) != before


def test_an_ortho_is_made_again_for_heights_under_it_and_for_no_others__law(
    tmp_path, made, monkeypatch
):
    """A DEM that was changed anywhere, or only copied, had every ortho cut again."""
    grids = [ortho_grid(p, BLOCK.camera_of(n), GROUND, 1.0) for n, p in BLOCK.photos.items()]
    west, south, east, north = shapely.total_bounds([box(*grid.bounds) for grid in grids])
    # Fifteen cells inside the first, so that what heights are read with reaches no other's edge.
    under = shapely.Point(grids[0].west + 150, grids[0].north - 150)
    beside = (east + 150, south - 150)
    heights = np.zeros((int(north - south) // 10 + 60, int(east - west) // 10 + 60), np.float32)
    transform = Affine(10, 0, west - 300, 0, -10, north + 300)
    path = tmp_path / "dem.tif"

    def orthos(easting: float, northing: float) -> list[str]:
        column, row = map(int, ~transform @ (easting, northing))
        heights[row, column] += 1e-3
        write_raster(path, heights, transform, crs=BLOCK.crs)
        dem = open_dem(path, BLOCK.crs).cropped((west - 300, south - 300, east + 300, north + 300))
        made.clear()
        make_orthos(session, project, BLOCK, dem, SILENT)
        return made

    project: Any = SimpleNamespace(**(vars(PROJECT) | {"reference": SimpleNamespace(dem=(path,))}))
    monkeypatch.setattr(app.orthos, "chosen_ground", lambda *given: (given[2], ()))
    with Session.open(tmp_path, "ada") as session:
        assert set(orthos(*beside)) == set(BLOCK.photos)
        assert orthos(*beside) == []
        areas = {name: box(*grid.bounds) for name, grid in zip(BLOCK.photos, grids, strict=True)}
        there = {name for name, area in areas.items() if area.covers(under)}
        assert set(orthos(under.x, under.y)) == there
        assert 0 < len(there) < len(BLOCK.photos)


def test_a_setting_makes_again_what_it_touches_and_nothing_else__law(tmp_path, made):
    grids = {n: ortho_grid(p, BLOCK.camera_of(n), GROUND, 1.0) for n, p in BLOCK.photos.items()}
    west, south, east, north = shapely.total_bounds([box(*grid.bounds) for grid in grids.values()])
    file = tmp_path / "area.gpkg"

    def orthos(*areas, **settings) -> set[str]:
        if areas:
            file.unlink(missing_ok=True)
            write_polygons(file, "area", areas, {}, crs=BLOCK.crs)
            settings["area"] = file
        section = replace(OrthoSection(gsd_m=1.0), **settings)
        project = SimpleNamespace(**(vars(PROJECT) | {"ortho": section}))
        made.clear()
        make_orthos(session, project, BLOCK, GROUND, SILENT)
        return set(made)

    def reached(area) -> set[str]:
        return {name for name, grid in grids.items() if box(*grid.bounds).intersects(area)}

    wide, every = box(west - 9, south - 9, east + 9, north + 9), set(BLOCK.photos)
    half = box(west, south, west + 0.3 * (east - west), north)
    nook = box(west + 20, north - 40, west + 60, north - 20)
    with Session.open(tmp_path, "ada") as session:
        folder = session.results / "ortho"
        assert orthos() == every
        assert orthos(wide) == set(), "an area that cuts nothing off is none"
        within = orthos(half)
        assert set() < within < every
        assert {path.stem for path in folder.iterdir()} == within <= reached(half)
        assert orthos(half) == set(), "the same area in another file"
        smaller = half.difference(nook)
        touched = orthos(smaller)
        assert touched == reached(nook)
        assert set() < touched < within
        assert orthos(smaller, edge_mm=2.0) == orthos(smaller, edge_mm=2.0, resampling="nearest")
        assert orthos() == every
        assert orthos(resampling="lanczos") == orthos() == every
        with pytest.raises(ProjectError, match="no photo"):
            orthos(box(*(edge + 1e5 for edge in wide.bounds)))
        with pytest.raises(ProjectError, match="no polygons"):
            orthos(shapely.MultiPolygon())


def test_orthos_that_can_never_fit_are_refused_before_the_first__truth(tmp_path, made):
    fine = SimpleNamespace(**vars(PROJECT) | {"ortho": OrthoSection(gsd_m=1e-5)})
    with Session.open(tmp_path, "anna") as session:
        with pytest.raises(StorageError, match=r"has room for .* too little for \d+ Gpx"):
            make_orthos(session, fine, BLOCK, GROUND, SILENT)
        assert not made
