"""What there is to judge: residuals that hang together with radius or height."""

from dataclasses import replace

import numpy as np
import pytest

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block
from core.geometry.exterior import ExteriorOrientation
from core.quality.residuals import (
    MEAN_OF,
    TREND_PARTS,
    UsedRays,
    displacement,
    mean_pattern,
    residual_trends,
)
from tests.flights import FlightPlan, fly


@pytest.fixture(scope="module")
def report():
    flight = fly(FlightPlan(ties=400, control=30, check=0), np.random.default_rng(4))
    return adjust_block(flight.block, AdjustmentOptions())


def test_without_distortion_no_part_stands_out__truth(report):
    trends = residual_trends(report)
    assert set(trends) == {"radius", "height"}
    for trend in trends.values():
        assert len(trend.along) == TREND_PARTS
        assert np.all(np.diff(trend.along) > 0)
        assert np.abs(trend.mean_px / trend.sigma_px).max() < 4.5


def test_distortion_put_in_is_the_trend_along_the_radius__truth(report):
    """Every ray of a tie is moved outwards by a cubic of its radius, known in pixels."""
    block = report.block
    moved = report.tie_residuals_px.copy()
    radius = np.zeros(len(moved))
    for number, name in enumerate(block.ties.photo_ids):
        photo, camera = block.photos[name], block.camera_of(name)
        mine = block.ties.photo == number
        middle = np.array([camera.principal_point_mm])
        away = block.ties.pixels[mine] - photo.interior.pixel_from_film(middle)
        film = photo.interior.film_from_pixel(block.ties.pixels[mine]) - middle
        radius[mine] = np.linalg.norm(film, axis=1)
        outwards = away / np.linalg.norm(away, axis=1, keepdims=True)
        moved[mine] += outwards * (radius[mine, None] / 100) ** 3
    plain, bent = (
        residual_trends(replace(report, tie_residuals_px=rays, residuals_px={}))["radius"]
        for rays in (report.tie_residuals_px, moved)
    )
    np.testing.assert_allclose(bent.mean_px - plain.mean_px, (bent.along / 100) ** 3, atol=0.05)
    assert bent.mean_px[-1] / bent.sigma_px[-1] > 10


def test_too_few_residuals_are_no_trend__law(report):
    none = np.full_like(report.tie_residuals_px, np.nan)
    none[: TREND_PARTS * MEAN_OF - 1] = 0.0
    assert residual_trends(replace(report, tie_residuals_px=none, residuals_px={})) == {}


def test_a_pattern_is_of_the_film_however_scans_lie_on_it__truth(report):
    """Scans turned by half and quarter turns and of two pixel sizes, whose means cancelled."""
    block, rays = report.block, {}
    line = np.linspace(-85, 85, 36)
    film = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    outwards_mm = film * 1e-4
    for turns, (name, photo) in enumerate(block.photos.items()):
        turn = np.linalg.matrix_power(np.array([[0.0, -1.0], [1.0, 0.0]]), turns)
        matrix = photo.interior.film_from_pixel_matrix
        laid = np.column_stack([matrix[:, :2] @ turn * (1 + turns % 2), matrix[:, 2]])
        interior = replace(photo.interior, film_from_pixel_matrix=laid)
        block = block.with_photos({**block.photos, name: replace(photo, interior=interior)})
        pixels = interior.pixel_from_film(film)
        moved = interior.pixel_from_film(film + outwards_mm)
        rays[name] = UsedRays(pixels, moved - pixels, np.zeros(len(film)), 0)
    mean, counts, test = mean_pattern(block, rays)
    assert counts.sum() == len(rays) * len(film)
    middles = (np.arange(6) - 2.5) * 30
    expected = np.stack(np.meshgrid(middles, -middles), axis=-1) * 0.1
    np.testing.assert_allclose(mean, expected, atol=0.35)  # points do not lie about the middles
    assert test.max() > 10


def test_a_shift_turn_and_scale_put_in_are_told__truth():
    flight = fly(FlightPlan(ties=10, camera_errors=False), np.random.default_rng(0))
    name, photo = next(iter(flight.truth.photos.items()))
    camera, true = (
        flight.truth.camera_of(name),
        ExteriorOrientation(photo.exterior.centre, 0.0, 0.0, photo.exterior.kappa),
    )
    above = true.centre[2] - photo.ground_height_m
    off = ExteriorOrientation(
        true.centre + np.array([120.0, -80.0, 0.05 * above]), 0.0, 0.0, true.kappa + 0.1
    )
    found = displacement(replace(photo, exterior=true, approximate=off), camera)
    np.testing.assert_allclose(found.shift_m, [-120.0, 80.0], atol=3.0)
    assert found.turn == pytest.approx(-0.1, abs=1e-3)
    assert found.scale == pytest.approx(1 / 1.05, abs=1e-3)
    assert found.rms_m > 144.0
    same = displacement(replace(photo, exterior=true, approximate=true), camera)
    assert (same.rms_m, same.turn, same.scale) == pytest.approx((0.0, 0.0, 1.0), abs=1e-6)
