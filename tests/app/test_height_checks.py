"""Heights of block, DEM and list of different systems are asked about."""

from dataclasses import replace

import numpy as np
import pytest
import rasterio

from app.height_checks import height_doubts
from app.project import described, read_project
from app.references import OtherReference
from core.block import SurveyedPoint


def listed(tiny, above_m):
    """Points of the true ground, so much above it."""
    centres = [photo.exterior.centre for photo in tiny.photos.values()]
    places = np.array(centres)
    places[:, 2] = tiny.reference.dem.heights(places[:, :2]) + above_m
    return [
        SurveyedPoint(f"P{row}", place, np.full(3, 0.1), "check", "surveyed")
        for row, place in enumerate(places)
    ]


def told(project, surveyed, dem):
    return [doubt.message for doubt in height_doubts(project, surveyed, dem)]


def test_a_list_of_ellipsoidal_heights_is_asked_about__truth(tiny):
    project, dem = read_project(tiny.folder), tiny.reference.dem
    assert told(project, listed(tiny, 0.3), dem) == []
    found = told(project, listed(tiny, 44.7), dem)
    assert len(found) == 1
    assert "+44.7 m off the DEM" in found[0]


@pytest.mark.parametrize(("word", "count"), [("Bpv", 0), ("EPSG:8357", 0), ("EPSG:5705", 1)])
def test_the_dem_s_own_height_system_is_compared__truth(tiny, tmp_path, word, count):
    project = read_project(tiny.folder)
    dem = tmp_path / "dem.tif"
    with rasterio.open(project.reference.dem[0]) as file:
        profile, heights = file.profile, file.read()
    with rasterio.open(dem, "w", **{**profile, "crs": "EPSG:5514+8357"}) as file:
        file.write(heights)
    other = replace(
        project,
        block=replace(project.block, heights=word),
        reference=replace(project.reference, dem=(dem,)),
    )
    found = told(other, (), tiny.reference.dem)
    assert len(found) == count
    assert all("EPSG:8357 (Baltic 1957 height)" in one for one in found)


def test_an_unknown_word_is_a_doubt__law(tiny):
    project = read_project(tiny.folder)
    other = replace(project, block=replace(project.block, heights="above the pub"))
    assert "above the pub" in told(other, (), tiny.reference.dem)[0]
    assert described(other).crs == described(project).crs


def test_further_heights_of_another_system_are_asked_about__truth(tiny, tmp_path):
    project, dem = read_project(tiny.folder), tmp_path / "other.tif"
    with rasterio.open(project.reference.dem[0]) as file:
        profile, heights = file.profile, file.read()
    for above_m, count in ((0.3, 0), (44.7, 1)):
        with rasterio.open(dem, "w", **profile) as file:
            file.write(heights + np.float32(above_m))
        further = replace(project.reference, other=(OtherReference(dem=(dem,)),))
        found = told(replace(project, reference=further), (), tiny.reference.dem)
        assert len(found) == count
    assert "other.tif: heights lie +44.7 m off the DEM" in found[0]
