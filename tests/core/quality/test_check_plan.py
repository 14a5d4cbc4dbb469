"""Places to be checked: one a cell, on corners the reference shows, away from control."""

import cv2
import numpy as np
import pytest
import shapely
from shapely.geometry import box

from core.quality.check_plan import (
    RIM_M,
    DrawnPlan,
    PlanRequest,
    crossing_edges_px,
    draw_places,
)
from core.raster.grid import Grid
from core.raster.ortho import Ortho
from tests.tiny import Tiny


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
    return np.array([(one.east, one.north) for one in plan.places]).reshape(-1, 2)


def test_every_cell_has_one_place_within_the_ground__law(ortho: Ortho) -> None:
    plan, area = drawn(ortho), ground(ortho)
    found = places(plan)
    assert len(found) + plan.empty == 30
    assert plan.empty < 6
    assert shapely.contains_xy(area.buffer(-RIM_M), found).all()
    west, south, east, north = area.bounds
    columns = ((found[:, 0] - west) / (east - west) * 6).astype(int)
    rows = ((north - found[:, 1]) / (north - south) * 5).astype(int)
    assert len({*zip(rows.tolist(), columns.tolist(), strict=True)}) == len(found)


def test_places_lie_on_stronger_corners_than_chance_finds__truth(ortho: Ortho) -> None:
    """The smaller eigenvalue at the places, against that of places thrown anywhere."""
    area, found = ground(ortho), places(drawn(ortho))
    pixel = ortho.ground_sample_distance_m
    grid = Grid.over(area.bounds, pixel)
    strength = cv2.cornerMinEigenVal(ortho.read(grid).values, 5)

    def at(plan: np.ndarray) -> np.ndarray:
        columns, rows = np.floor(grid.grid_from_object(plan)).astype(int).T
        near = [
            strength[max(r - 4, 0) : r + 5, max(c - 4, 0) : c + 5].max()
            for c, r in zip(columns, rows, strict=True)
        ]
        return np.array(near)

    thrown = np.random.default_rng(0).uniform(area.bounds[:2], area.bounds[2:], (300, 2))
    assert np.median(at(found)) > 3 * np.median(at(thrown))


def test_the_same_seed_draws_the_same_and_another_draws_others__law(ortho: Ortho) -> None:
    assert drawn(ortho, 5) == drawn(ortho, 5)
    assert drawn(ortho, 5).places != drawn(ortho, 6).places


def test_no_place_is_drawn_near_control__law(ortho: Ortho) -> None:
    control = places(drawn(ortho))
    found = places(drawn(ortho, control=control))
    away = np.linalg.norm(found[:, None] - control[None], axis=2)
    assert len(found) > 20
    assert away.min() >= 40.0


def test_a_grid_not_asked_for_gives_enough_places_for_the_standard__law(ortho: Ortho) -> None:
    west, south, east, north = ground(ortho).bounds
    ring = shapely.Point((west + east) / 2, (south + north) / 2).buffer((north - south) / 2)
    request = PlanRequest(ring, ortho, np.zeros((0, 2)), 40.0, 1)
    found = draw_places(request)
    assert found.enough
    assert found.cells[0] * found.cells[1] > 30


def test_ground_beside_the_reference_has_no_places__law(ortho: Ortho) -> None:
    west, south, _, _ = ortho.bounds
    aside = box(west - 900, south - 900, west - 100, south - 100)
    assert not draw_places(PlanRequest(aside, ortho, np.zeros((0, 2)), 40.0, 1)).places


def test_corners_of_houses_come_before_crowns_of_trees__truth() -> None:
    """Crowns stand out more than roofs, and have no straight edges."""
    rng = np.random.default_rng(8201)
    picture = np.full((400, 400), 120.0)
    roofs, crowns = list[np.ndarray](), list[np.ndarray]()
    for number in range(24):
        middle = np.array([40 + 65 * (number % 6), 40 + 100 * (number // 6)])
        if number % 2:
            turn = rng.uniform(0, np.pi)
            sides = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
            corners = middle + np.array([[-12, -8], [12, -8], [12, 8], [-12, 8]]) @ sides
            cv2.fillPoly(picture, [np.rint(corners).astype(np.int32)], 150.0)
            roofs += list(np.rint(corners))
        else:
            cv2.circle(picture, middle.tolist(), 7, 40.0, -1)
            crowns += [middle + 7 * np.array([np.cos(a), np.sin(a)]) for a in range(6)]
    shown = cv2.GaussianBlur(picture, (0, 0), 0.8) + rng.normal(0, 2, picture.shape)
    on_roofs = crossing_edges_px(shown.astype(np.float32), np.array(roofs))
    on_crowns = crossing_edges_px(shown.astype(np.float32), np.array(crowns))
    # A roof's shorter side is sixteen pixels.
    assert (on_roofs > 8).mean() > 0.8
    assert (on_crowns > 8).mean() < 0.05
