"""One photo oriented on the reference by itself."""

from dataclasses import replace

import numpy as np
import pytest

from core.doubts import Failure
from core.localisation.block_placement import NARROW
from core.localisation.photo_orientation import (
    OrientationOptions,
    OrientedPhoto,
    finest_gsd_m,
    finest_reduction,
    ground_sigma_px,
    orient_photo,
    widened,
)
from core.reference.stage import ReferencePoints
from tests.core.localisation.test_block_placement import astray_m, displaced

QUICK = OrientationOptions(placements=(NARROW,))


@pytest.fixture(scope="module")
def oriented(tiny, features):
    """A photo as a good world file would place it, oriented on today's reference."""
    opened = displaced(tiny, tiny.names[0], np.array([7.0, -5.0]), 0.004, 1.002, (10.0, 8.0, 0.006))
    return orient_photo(opened, tiny.reference, features.points, QUICK, np.random.default_rng(1))


def test_a_photo_stands_where_it_was__truth(tiny, oriented):
    """Of what persists since 1938, and of nothing else."""
    assert isinstance(oriented, OrientedPhoto)
    assert oriented.log10_e_value > 3
    # Two pixels: a single photo of the tiny block has some ten points that agree.
    assert astray_m(tiny, tiny.names[0], oriented.exterior) < 2.4
    assert len(oriented.agreeing) >= 5


def test_what_agrees_is_mostly_right__truth(tiny, features, oriented):
    name = tiny.names[0]
    by_point = {match.point: match for match in oriented.found}
    assert set(oriented.agreeing.tolist()) <= set(by_point)
    truly = tiny.photos[name].pixel_from_object(
        features.points.positions[oriented.agreeing], tiny.truth.camera
    )
    away = [
        min(np.hypot(p.column - at[0], p.row - at[1]) for p in by_point[int(point)].peaks)
        for point, at in zip(oriented.agreeing, truly, strict=True)
    ]
    assert np.mean(np.array(away) < 2.5) > 0.8


@pytest.mark.slow
def test_points_that_lie_elsewhere_give_no_orientation__truth(tiny, features):
    """Another ground below, and points moved at random: starts 700 m off that claim 8 m.

    Evidence that passes for sure comes by chance once in a thousand times. Start 14 stood 700 m off
    while the rim of a search, where no peak can be, counted as searched (`prove_alone`).
    """
    points, standing = features.points, 0
    for seed in (0, 5, 6, 14):
        rng = np.random.default_rng(seed)
        astray = points.positions.copy()
        astray[:, :2] += rng.uniform(-40, 40, (len(astray), 2))
        way = rng.uniform(0, 2 * np.pi)
        shift = 700.0 * np.array([np.cos(way), np.sin(way)])
        opened = displaced(tiny, tiny.names[seed % 6], shift, 0.0, 1.0, (8.0, 5.0, 0.003))
        found = orient_photo(
            opened,
            tiny.reference,
            ReferencePoints(points.ids, astray, points.sigma_m),
            QUICK,
            np.random.default_rng(0),
        )
        standing += isinstance(found, OrientedPhoto)
    assert standing == 0


def test_without_reference_points_there_is_no_orientation__law(tiny):
    nobody = ReferencePoints((), np.zeros((0, 3)), np.zeros((0, 3)))
    options = OrientationOptions(placements=(replace(NARROW, photo_px=80, most_turn=0.05),))
    opened = displaced(tiny, tiny.names[0], np.zeros(2), 0.0, 1.0, (5.0, 1.0, 0.003))
    found = orient_photo(opened, tiny.reference, nobody, options, np.random.default_rng(0))
    assert isinstance(found, Failure)
    assert "reference point" in found.reason


def test_detail_finer_than_ortho_or_scan_is_not_sought__law(tiny):
    opened = tiny.opened(tiny.names[0])
    gsd = finest_gsd_m(opened, tiny.reference, OrientationOptions())
    assert gsd == pytest.approx(max(0.8, opened.ground_pixel_m))
    assert finest_gsd_m(opened, tiny.reference, OrientationOptions(finest_gsd_m=3.0)) == 3.0
    coarse = OrientationOptions(finest_gsd_m=3.6)
    assert finest_reduction(opened, tiny.reference, coarse) in (2, 3)


def test_accuracies_on_the_ground_are_seen_in_pixels__law(tiny):
    opened = tiny.opened(tiny.names[0])
    sigma = ground_sigma_px(opened, np.array([[1.2, 1.2, 9.0], [0.3, 0.4, 9.0]]))
    expected = np.array([1.2, np.hypot(0.3, 0.4) / np.sqrt(2)]) / opened.ground_pixel_m
    np.testing.assert_allclose(sigma, expected)


def test_a_widened_covariance_has_room_for_the_shift__law(tiny):
    opened = tiny.opened(tiny.names[0])
    wide = widened(np.eye(6) * 1e-12, opened, 6.0)
    above = opened.photo.exterior.centre[2] - opened.photo.ground_height_m
    np.testing.assert_allclose(
        np.sqrt(np.diag(wide)), [6.0, 6.0, 6.0, *(3.0 / above,) * 3], rtol=1e-3
    )
