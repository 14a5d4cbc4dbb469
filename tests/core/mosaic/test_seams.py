"""Seams divide exactly what the photos show, where the photos agree and away from buildings."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pyogrio.raw
import pytest
import shapely
from pyproj import Transformer

from core.errors import ReferenceDataError
from core.mosaic.overview import SeamView
from core.mosaic.seam_cut import SeamGuides, label_ground
from core.mosaic.seams import (
    EditedSeams,
    Seam,
    fill_gaps,
    outline_seams,
    read_edited,
    read_seams,
    write_seams,
)
from core.raster.grid import Grid
from tests.core.mosaic.conftest import CRS

CELL, SIDE = 2.0, 160


@pytest.fixture
def views():
    """Three photos in a row over the same detail, each with grain of its own."""
    rng = np.random.default_rng(4)
    ground = np.kron(rng.uniform(60, 190, (20, 50)), np.ones((8, 8)))
    made = []
    for number in range(3):
        across = 60 * number
        gray = ground[:SIDE, across : across + SIDE] + rng.normal(0, 2, (SIDE, SIDE))
        shown, inner = np.ones((2, SIDE, SIDE), dtype=bool)
        inner[:] = False
        inner[5:-5, 5:-5] = True
        grid = Grid(1000 + CELL * across, 3000.0, CELL, SIDE, SIDE)
        nadir = (1000 + CELL * (across + SIDE / 2), 3000 - CELL * SIDE / 2)
        made.append(
            SeamView(f"p{number}", nadir, grid, gray.astype(np.float16), shown, shown, inner)
        )
    return made


def outlined(views, **more):
    return outline_seams(label_ground(views, **more), [view.photo_id for view in views])


def borders(seams):
    return shapely.union_all(
        [a.area.intersection(b.area) for k, a in enumerate(seams) for b in seams[:k]]
    )


def test_seams_are_an_exact_partition_of_what_is_shown__law(views):
    seams = outlined(views)
    whole = shapely.union_all([seam.area for seam in seams])
    assert sum(seam.area.area for seam in seams) == pytest.approx(whole.area, rel=1e-12)
    assert shapely.coverage_is_valid([seam.area for seam in seams])
    shown = shapely.union_all([shapely.box(*view.grid.bounds) for view in views])
    assert shown.difference(whole).area == 0
    # Grown by a cell all round, no more.
    assert whole.difference(shown.buffer(CELL, join_style="mitre")).area < 1e-6


def test_seams_by_nadir_lie_midway__truth(views):
    seams = outlined(views, by_nadir=True)
    lines = borders(seams)
    eastings = {line.centroid.x for line in shapely.get_parts(lines)}
    middles = [(a.nadir[0] + b.nadir[0]) / 2 for a, b in pairwise(views)]
    assert all(min(abs(east - middle) for middle in middles) <= CELL for east in eastings)


def test_a_seam_goes_round_what_one_photo_shows_otherwise__truth(views):
    changed = views[1].gray.copy()
    changed[40:110, 35:65] += 90
    views[1] = replace(views[1], gray=changed)
    west, north = views[1].grid.west, views[1].grid.north
    place = shapely.box(west + 37 * CELL, north - 108 * CELL, west + 63 * CELL, north - 42 * CELL)
    through = [
        borders(outlined(views, by_nadir=flag)).intersection(place).length for flag in (True, False)
    ]
    assert through[0] > 60 * CELL
    assert through[1] == 0


def test_seams_keep_five_metres_from_buildings__truth(views):
    rng = np.random.default_rng(8)
    places = rng.uniform((1000, 2690), (1560, 2990), (60, 2))
    houses = tuple(shapely.box(e, n, e + 12, n + 9) for e, n in places)
    near = shapely.union_all(shapely.buffer(np.array(houses, dtype=object), 5.0))
    by_nadir = borders(outlined(views, by_nadir=True))
    seams = borders(outlined(views, guides=SeamGuides(buildings=houses)))
    assert by_nadir.intersection(near).length > 30
    assert seams.intersection(near).length == 0


def test_a_seam_follows_a_road_near_its_way__truth(views):
    plain = [
        SeamView(
            v.photo_id, v.nadir, v.grid, v.gray * 0 + np.float16(100), v.full, v.touched, v.inner
        )
        for v in views[:2]
    ]
    middle = (plain[0].nadir[0] + plain[1].nadir[0]) / 2
    road = shapely.LineString([(middle + 14, 3000), (middle + 14, 2680)])
    seams = borders(outlined(plain, guides=SeamGuides(roads=(road,))))
    along = seams.intersection(road.buffer(5)).length
    assert along > 0.7 * seams.length
    assert borders(outlined(plain)).intersection(road.buffer(5)).length < 0.1 * seams.length


@pytest.mark.parametrize("kind", ["woods", "water"])
def test_a_seam_goes_round_woods_and_water_unless_the_way_is_long__law(views, kind):
    plain = [replace(v, gray=v.gray * 0 + np.float16(100)) for v in views[:2]]
    middle = (plain[0].nadir[0] + plain[1].nadir[0]) / 2
    straight = borders(outlined(plain))
    wood = shapely.box(middle - 16, 2780, middle + 16, 2900)
    assert straight.intersection(wood).length == pytest.approx(120, abs=CELL)
    round_it = borders(outlined(plain, guides=SeamGuides(**{kind: (wood,)})))
    assert round_it.intersection(wood.buffer(-CELL)).length == 0
    across = shapely.box(0, 2820, 9999, 2860)
    through = borders(outlined(plain, guides=SeamGuides(**{kind: (across,)})))
    assert through.length == pytest.approx(straight.length, abs=4 * CELL)


def test_seams_are_the_same_at_every_run__law(views):
    first, again = outlined(views), outlined(views)
    assert all(a.area.equals_exact(b.area) for a, b in zip(first, again, strict=True))


def test_seams_are_read_back__law(views, tmp_path):
    dates = {"p1": "1938-07-09"}
    seams = outline_seams(label_ground(views), [view.photo_id for view in views], dates)
    write_seams(seams, tmp_path / "seams.gpkg", CRS)
    again = read_seams(tmp_path / "seams.gpkg")
    assert [(s.photo_id, s.date) for s in again] == [("p0", ""), ("p1", "1938-07-09"), ("p2", "")]
    assert all(a.area.equals(b.area) for a, b in zip(again, seams, strict=True))


WEST, SOUTH = 500_000.0, 4_100_000.0
NAMES = ("a", "b")


def box(west, south, east, north):
    return shapely.box(WEST + west, SOUTH + south, WEST + east, SOUTH + north)


def written(path, scans, areas, crs=CRS, layer="seams", column="scan"):
    pyogrio.raw.write(
        path,
        geometry=shapely.to_wkb(np.array(areas, dtype=object)),
        field_data=[np.array(scans, dtype=object)],
        fields=[column],
        geometry_type="Polygon",
        crs=crs,
        driver="GPKG",
        layer=layer,
    )
    return path


def test_edited_seams_are_read_as_drawn__law(tmp_path):
    path = written(tmp_path / "seams.gpkg", ["b", "a"], [box(50, 0, 100, 80), box(0, 0, 50, 80)])
    found = read_edited(path, CRS, NAMES)
    assert [seam.photo_id for seam in found.seams] == ["b", "a"]
    assert found.seams[0].area.equals(box(50, 0, 100, 80))
    assert found.notes == ()


def test_the_later_of_two_overlapping_seams_holds_and_is_told__truth(tmp_path):
    path = written(tmp_path / "seams.gpkg", ["a", "b"], [box(0, 0, 60, 80), box(40, 0, 100, 80)])
    found = read_edited(path, CRS, NAMES)
    assert [seam.area.area for seam in found.seams] == [40 * 80, 60 * 80]
    assert found.notes == (
        "Edited seams overlapped over 1600 m²; the later one in the file holds.",
    )


def test_gaps_are_filled_and_told__truth(tmp_path):
    path = written(tmp_path / "seams.gpkg", ["a"], [box(0, 0, 40, 80)])
    drawn = (Seam("a", "1938", box(0, 0, 50, 80)), Seam("b", "1938", box(50, 0, 100, 80)))
    filled = fill_gaps(read_edited(path, CRS, NAMES), drawn)
    assert {seam.photo_id: seam.area.area for seam in filled.seams} == {"a": 4000, "b": 4000}
    assert "4800 m² open, the largest part about E 500075 N 4100040;" in filled.notes[0]
    assert fill_gaps(EditedSeams(drawn, ()), drawn).notes == ()


def test_ground_that_a_photo_does_not_show_goes_to_those_that_do_and_is_told__truth(tmp_path):
    areas = [box(0, 0, 40, 80), box(40, 0, 100, 80)]
    edited = read_edited(written(tmp_path / "seams.gpkg", ["a", "a"], areas), CRS, NAMES)
    drawn = (Seam("a", "1938", box(0, 0, 50, 80)), Seam("b", "1939", box(50, 0, 100, 80)))
    filled = fill_gaps(edited, drawn, {"a": box(0, 0, 60, 80), "b": box(30, 0, 100, 80)})
    assert [(seam.photo_id, seam.area.area) for seam in filled.seams] == [("a", 4800), ("b", 3200)]
    assert filled.seams[1].date == "1939"
    # Nothing was left open: that is not told.
    (told,) = filled.notes
    assert "gave a 3200 m² that it does not show" in told
    assert "E 500080 N 4100040" in told
    # What lies outside of all photos takes nothing from anybody.
    outside = EditedSeams((Seam("a", "", box(-50, 0, 60, 80)), drawn[1]), ())
    assert fill_gaps(outside, drawn, {"a": box(0, 0, 60, 80)}).notes == ()


def test_scans_without_an_ortho_are_left_out_and_told__truth(tmp_path):
    path = written(tmp_path / "seams.gpkg", ["a", "x"], [box(0, 0, 50, 80), box(50, 0, 100, 80)])
    found = read_edited(path, CRS, NAMES)
    assert [seam.photo_id for seam in found.seams] == ["a"]
    assert found.notes == ("Edited seams of scans without an ortho were left out: x.",)


def test_a_crossed_polygon_is_mended_and_told__truth(tmp_path):
    corners = np.array([(0, 0), (10, 10), (10, 0), (0, 10)])
    bow = shapely.Polygon(np.add(corners, (WEST, SOUTH)))
    found = read_edited(written(tmp_path / "seams.gpkg", ["a"], [bow]), CRS, NAMES)
    assert found.seams[0].area.is_valid
    assert found.seams[0].area.area == pytest.approx(50)
    assert found.notes == ("1 edited seam was not valid and mended.",)


def test_seams_in_another_system_are_transformed_and_told__oracle(tmp_path):
    area = box(0, 0, 400, 300)
    there = shapely.transform(area, _to_degrees)
    found = read_edited(written(tmp_path / "s.gpkg", ["a"], [there], "EPSG:4326"), CRS, NAMES)
    assert found.seams[0].area.symmetric_difference(area).area < 0.01
    assert found.notes == ("Edited seams were transformed from EPSG:4326.",)


def _to_degrees(points):
    transformer = Transformer.from_crs(CRS, "EPSG:4326", always_xy=True)
    return np.column_stack(transformer.transform(points[:, 0], points[:, 1]))


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ({"column": "photo"}, 'no attribute "scan". It has photo'),
        ({"scans": ["x"]}, "no polygon of it belongs to a photo of the block"),
        ({"scans": [], "areas": []}, "has no polygons"),
    ],
)
def test_seams_that_cannot_be_used_are_refused__truth(tmp_path, how, said):
    given = {"scans": ["a"], "areas": [box(0, 0, 50, 80)]} | how
    path = written(tmp_path / "seams.gpkg", **given)
    with pytest.raises(ReferenceDataError) as refused:
        read_edited(path, CRS, NAMES)
    assert said in str(refused.value)
    assert str(path) in str(refused.value)


def test_a_damaged_file_is_refused__truth(tmp_path):
    path = tmp_path / "seams.gpkg"
    path.write_bytes(b"SQLite format 3\0 cut off")
    with pytest.raises(ReferenceDataError, match="delete or rename the file"):
        read_edited(path, CRS, NAMES)
