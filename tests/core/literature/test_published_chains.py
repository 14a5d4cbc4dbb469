"""The published chains as presets: what they do on ground that did not change."""

from dataclasses import replace

import numpy as np

from core.adjustment.adjusted import AdjustmentOptions
from core.geometry.resection import moved
from core.literature.published_chains import (
    CHAINS,
    PublishedOptions,
    assemble_published,
    flatness,
    joined_pixels,
    kept_of,
)
from core.localisation.initial_orientation import Site
from core.matching.patches import object_on_ground
from core.reference.points import ReferencePoints
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
