"""The published chains as presets: what they do on ground that did not change."""

from dataclasses import replace

import numpy as np

from core.adjustment.adjusted import AdjustmentOptions
from core.geometry.resection import moved
from core.literature.published_chains import (
    CHAINS,
    PublishedOptions,
    RansacOptions,
    agreeing_points,
    assemble_published,
    flatness,
    is_flat,
    joined_pixels,
    kept_of,
)
from core.localisation.initial_orientation import Site
from core.matching.patches import object_on_ground
from core.reference.stage import ReferencePoints
from tests.tiny import true_ties


def site_of(tiny, name, count=6):
    """Junctions on a lattice in one photo, on ground of the photo's own epoch."""
    photo = tiny.photos[name]
    share = np.stack(np.meshgrid(*[np.linspace(0.2, 0.8, count)] * 2), axis=-1).reshape(-1, 2)
    pixels = share * np.array(photo.size_px)
    ground = object_on_ground(photo, tiny.truth.camera, pixels, tiny.reference.dem)
    ids = tuple(f"J{i:02d}" for i in range(len(ground)))
    points = ReferencePoints(ids, ground, np.full(ground.shape, 0.3))
    return Site(tiny.archival(), tiny.scans, points, dict.fromkeys(ids, "junction")), pixels


def test_neighbouring_pixels_are_joined_to_their_weighted_mean__truth():
    surface = np.zeros((21, 21), np.float32)
    surface[4, 5], surface[4, 6], surface[15, 10], surface[0, 0] = 0.8, 0.4, 0.6, 0.3
    found = joined_pixels(surface, PublishedOptions(least_ncc=0.35))
    assert len(found) == 2
    np.testing.assert_allclose(found[0], ((0.8 * 5 + 0.4 * 6) / 1.2, 4.0, 0.6), rtol=1e-6)
    np.testing.assert_allclose(found[1], (10.0, 15.0, 0.6), rtol=1e-6)


def test_on_unchanged_ground_the_thesis_s_chain_finds_its_points__truth(tiny):
    name = tiny.names[0]
    site, pixels = site_of(tiny, name)
    aside = moved(tiny.photos[name].exterior, np.array([6.0, -4.0, 0.0, 0.0, 0.0, 0.0]))
    options = PublishedOptions(samples=4000)
    kept = kept_of(tiny.opened(name, aside), site, site.points, options, np.random.default_rng(0))
    away = [np.hypot(*(one.pixel[0] - pixels[int(one.point_id[1:])])) for one in kept]
    assert len(kept) >= 20
    assert np.median(away) < 1.5


def test_hoehle_takes_one_pixel_above_a_high_threshold__truth(tiny):
    name = tiny.names[0]
    site, _ = site_of(tiny, name, 4)
    kept = kept_of(
        tiny.opened(name), site, site.points, CHAINS["hoehle-2001"], np.random.default_rng(0)
    )
    assert all(one.score >= 0.7 for one in kept)
    assert len({one.point_id for one in kept}) == len(kept)


def test_a_chain_ends_in_the_same_adjustment__truth(tiny):
    name = tiny.names[0]
    site, _ = site_of(tiny, name)
    block = tiny.block
    block = replace(block, ties=true_ties(tiny))
    report, doubts = assemble_published(
        block, site, PublishedOptions(samples=2000), AdjustmentOptions(), np.random.default_rng(0)
    )
    assert report.converged
    assert report.block.photos[name].oriented
    assert all(doubt.kind == "control-flat" for doubt in doubts)


def test_level_ground_is_told_to_the_thesis_s_chain_alone__law(tiny):
    points = ReferencePoints(("J1", "J2"), np.array([[0.0, 0, 200], [9, 9, 205]]), np.ones((2, 3)))
    assert flatness(tiny.block, points, PublishedOptions())
    assert not flatness(tiny.block, points, CHAINS["hoehle-2001"])


def seen(rng, count, relief=300.0):
    """Points on the ground, and where a camera 3000 m above them shows them, pixels."""
    ground = np.column_stack([rng.uniform(-1500, 1500, (count, 2)), rng.uniform(0, relief, count)])
    depth = 3000.0 - ground[:, 2]
    turned = ground[:, :2] @ np.array([[0.8, 0.6], [-0.6, 0.8]])
    return ground + np.array([-577e3, -119e4, 0.0]), 5000.0 * turned / depth[:, None] + 2500.0


def test_most_right_candidates_are_found_among_wrong_ones__truth():
    rng = np.random.default_rng(0)
    ground, pixels = seen(rng, 40)
    right = np.arange(40) < 26
    pixels = pixels + rng.normal(0, 0.5, pixels.shape)
    pixels[~right] += rng.uniform(-60, 60, (14, 2))
    kept = agreeing_points(ground, pixels, np.arange(40), RansacOptions(6000, 4.0), rng)
    assert right[kept].mean() > 0.9
    assert len(kept) >= 18


def test_pure_noise_is_agreed_with_all_the_same__paper():
    """METHODS 1.4: among 80 candidates by chance the thesis's limits keep about eleven."""
    rng = np.random.default_rng(1)
    ground, pixels = seen(rng, 80, relief=40.0)
    pixels = pixels + rng.uniform(-29, 29, pixels.shape)
    kept = agreeing_points(ground, pixels, np.arange(80), RansacOptions(20_000, 4.0), rng)
    assert 7 <= len(kept) <= 16


def test_a_sample_has_six_different_points__law():
    rng = np.random.default_rng(2)
    ground, pixels = seen(rng, 12)
    owner = np.repeat(np.arange(5), 3)[:12]
    assert len(agreeing_points(ground, pixels, owner, RansacOptions(100), rng)) == 0


def test_the_same_seed_gives_the_same_points__law():
    ground, pixels = seen(np.random.default_rng(3), 30)
    pixels = pixels + np.random.default_rng(4).uniform(-9, 9, pixels.shape)
    found = [
        agreeing_points(
            ground, pixels, np.arange(30), RansacOptions(3000), np.random.default_rng(5)
        ).tolist()
        for _ in range(2)
    ]
    assert found[0] == found[1]


def test_level_ground_does_not_determine_eleven_parameters__law():
    assert is_flat(np.array([200.0, 215.0, 208.0]), 3000.0)
    assert not is_flat(np.array([200.0, 315.0]), 3000.0)
    assert is_flat(np.zeros(0), 3000.0)
