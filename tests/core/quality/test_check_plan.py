"""Places to be checked: one a cell with its spares, on what lasts, away from control."""

from pathlib import Path

import numpy as np
import pytest
import shapely
from shapely.geometry import box

from core.formats.roads import read_roads
from core.quality.check_plan import (
    RIM_M,
    SPARES,
    DrawnPlan,
    PlanRequest,
    draw_places,
)
from core.raster.ortho import Ortho
from core.reference.junctions import Junction, find_junctions
from core.reference.road_graph import planar_graph
from tests.tiny import CRS, Tiny


@pytest.fixture(scope="module")
def ortho(tiny: Tiny) -> Ortho:
    return tiny.reference.ortho


def ground(ortho: Ortho) -> shapely.Polygon:
    west, south, east, north = ortho.bounds
    away = 0.2 * min(east - west, north - south)
    return box(west + away, south + away, east - away, north - away)


def drawn(ortho: Ortho, seed: int = 1, **changes: object) -> DrawnPlan:
    given = {"control": np.zeros((0, 2)), "apart_m": 40.0, "cells": (6, 5), **changes}
    return draw_places(PlanRequest(ground(ortho), ortho, seed=seed, **given))


def places(plan: DrawnPlan) -> np.ndarray:
    """Without the spares."""
    first = [one for one in plan.places if not one.after]
    return np.array([(one.east, one.north) for one in first]).reshape(-1, 2)


@pytest.fixture(scope="module")
def junctions(tiny: Tiny) -> tuple[Junction, ...]:
    roads = read_roads(sorted(Path(tiny.folder, "roads").glob("*.shp")), CRS)
    reference = tiny.reference
    return find_junctions(planar_graph(roads), reference.dem, sigmas_m=reference.sigmas_m)


def test_every_cell_has_one_place_within_the_ground__law(ortho: Ortho) -> None:
    plan, area = drawn(ortho), ground(ortho)
    found = places(plan)
    assert len(found) + plan.empty == 30
    assert plan.count == len(found)
    assert plan.empty < 15
    assert shapely.contains_xy(area.buffer(-RIM_M), found).all()
    west, south, east, north = area.bounds
    columns = ((found[:, 0] - west) / (east - west) * 6).astype(int)
    rows = ((north - found[:, 1]) / (north - south) * 5).astype(int)
    assert len({*zip(rows.tolist(), columns.tolist(), strict=True)}) == len(found)


def test_places_lie_on_junctions_that_both_epochs_show__truth(
    tiny: Tiny, ortho: Ortho, junctions: tuple[Junction, ...]
) -> None:
    """13 of 28; of the strongest corners of the cells one of 30 did, with four seeds."""
    plan = drawn(ortho, junctions=junctions)
    found, lasting = places(plan), tiny.truth.lasting_junctions
    assert lasting is not None
    away = np.linalg.norm(found[:, None] - lasting[None], axis=2).min(axis=1)
    assert (away < 3.0).mean() > 0.4


def test_spares_are_of_the_same_cell_one_after_the_other__law(ortho: Ortho) -> None:
    plan = drawn(ortho)
    west, south, east, north = ground(ortho).bounds
    cells: dict[str, tuple[int, int]] = {}
    for one in plan.places:
        column = int((one.east - west) / (east - west) * 6)
        row = int((north - one.north) / (north - south) * 5)
        cells[one.place_id] = (column, row)
        assert cells.get(one.after, (column, row)) == (column, row)
    after = [one.after for one in plan.places if one.after]
    assert len(after) == len(set(after)) > 0
    assert len(plan.places) <= (1 + SPARES) * plan.count


def test_the_same_seed_draws_the_same_and_another_draws_others__law(ortho: Ortho) -> None:
    assert drawn(ortho, 5) == drawn(ortho, 5)
    assert drawn(ortho, 5).places != drawn(ortho, 6).places


def test_no_place_is_drawn_near_control__law(ortho: Ortho) -> None:
    control = places(drawn(ortho))
    found = places(drawn(ortho, control=control))
    away = np.linalg.norm(found[:, None] - control[None], axis=2)
    assert len(found) > 15
    assert away.min() >= 40.0


def test_a_grid_not_asked_for_gives_enough_places_for_the_standard__law(ortho: Ortho) -> None:
    west, south, east, north = ground(ortho).bounds
    ring = shapely.Point((west + east) / 2, (south + north) / 2).buffer((north - south) / 2)
    request = PlanRequest(ring, ortho, np.zeros((0, 2)), 40.0, 1)
    found = draw_places(request)
    assert found.count >= 30
    assert found.cells[0] * found.cells[1] > 30


def test_ground_beside_the_reference_has_no_places__law(ortho: Ortho) -> None:
    west, south, _, _ = ortho.bounds
    aside = box(west - 900, south - 900, west - 100, south - 100)
    assert not draw_places(PlanRequest(aside, ortho, np.zeros((0, 2)), 40.0, 1)).places


def test_ground_that_only_bounds_join_to_the_reference_has_no_places__law(ortho: Ortho) -> None:
    """A strip that runs past the corner of the ortho."""
    west, south, _, _ = ortho.bounds
    away = [(-300, 150), (150, -300), (130, -320), (-320, 130)]
    strip = shapely.Polygon([(west + east, south + north) for east, north in away])
    assert strip.bounds[2] > west
    assert strip.bounds[3] > south
    assert not draw_places(PlanRequest(strip, ortho, np.zeros((0, 2)), 40.0, 1)).places
