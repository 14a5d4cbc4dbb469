"""Surfaces of all photos of a point laid together: what they share stands out."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from core.control.multi_photo import (
    APART_PX,
    Sight,
    joint_searches,
    judge_jointly,
    keeping_surfaces,
    moves_of,
    resample_surface,
)
from core.control.search import Chance, Search, decoys_outside
from core.control.stage import ControlStageOptions, search_photos
from core.localisation.initial_orientation import Site
from core.localisation.photo_orientation import OrientationOptions
from core.matching.patches import object_on_ground
from core.progress import Work
from core.reference.stage import ReferencePoints
from tests.tiny import ground_over

HALF = 40
PIXEL_M = 0.5
INNER = 12


def sight(photo_id, degrees=0.0, reduction=1, seen_from=(0.0, 0.0)):
    """A point at the scan's place (500, 400), of a photo turned so far, searched from beside it."""
    turn = np.radians(degrees)
    moves = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    predicted = 500.0 + seen_from[0], 400.0 + seen_from[1]
    empty, chance = np.zeros(0), Chance((), 1.0, 0.0, 1.0)
    search = Search("A", photo_id, True, predicted, (), empty, empty, chance, PIXEL_M / reduction)
    return Sight(
        search, (500.0, 400.0), moves * reduction / PIXEL_M, reduction, INNER, 0.5, "fused"
    )


def ground_of(one):
    """Metres east and north of the point at every place of its surface."""
    rows, columns = np.mgrid[: 2 * HALF + 1, : 2 * HALF + 1] - HALF
    pixels = np.stack([columns, rows], axis=-1) * one.reduction + np.array(one.search.predicted)
    return (pixels - np.array(one.pixel)) @ np.linalg.inv(one.moves).T


def bump(one, east, north, height=6.0):
    """A peak at a place of the ground as a photo's surface shows it."""
    away = ground_of(one) - np.array([east, north])
    return (height * np.exp(-0.5 * (away**2).sum(axis=-1) / 0.8**2)).astype(np.float32)


def noise(seed):
    """Heights of chance, of deviation one, as smooth as surfaces are."""
    values = np.random.default_rng(seed).normal(size=(2 * HALF + 5, 2 * HALF + 5))
    size = 2 * HALF + 1
    smooth = sum(values[i : i + size, j : j + size] for i in range(5) for j in range(5))
    return (smooth / 5.0).astype(np.float32)


def judged_together(surfaces):
    """The searches of one point in photos that have these surfaces."""
    with keeping_surfaces() as kept:
        for one, surface in surfaces:
            kept.keep("A", one.search.photo_id, surface)
        return judge_jointly([one for one, _ in surfaces], kept)


def place_on_ground(one, peak):
    """Metres east and north of the point."""
    return np.linalg.inv(one.moves) @ (np.array([peak.column, peak.row]) - np.array(one.pixel))


def test_a_surface_is_resampled_through_the_ground__truth():
    """Two photos turned by 130 degrees, of other pixels, searched from beside where it is now."""
    own, other = sight("1", 20.0, 1, (2.4, -1.3)), sight("2", 150.0, 2, (-3.0, 5.0))
    shape = (2 * HALF + 1, 2 * HALF + 1)
    surface, known = resample_surface(other, bump(other, 3.1, -2.2), own, shape)
    assert known[HALF - 20 : HALF + 20, HALF - 20 : HALF + 20].all()
    assert not known.all()
    assert np.abs(surface - bump(own, 3.1, -2.2))[known].max() < 0.6
    row, column = np.unravel_index(np.argmax(np.where(known, surface, -9)), shape)
    assert np.hypot(*(ground_of(own)[row, column] - [3.1, -2.2])) < 0.75 * PIXEL_M


def test_what_all_photos_share_is_preferred_to_higher_peaks_of_each__truth():
    """In every photo another wrong peak is higher than the right one."""
    photos = [sight(str(i), 50.0 * i, 1 + i % 2, (float(i), -1.0)) for i in range(4)]
    wrong = [(-4.0, -3.0), (4.0, 2.0), (-1.0, 4.5), (3.0, -4.0)]
    surfaces = [
        (one, noise(i) + bump(one, 1.0, 0.5) + bump(one, *wrong[i], 7.5))
        for i, one in enumerate(photos)
    ]
    for (one, surface), found in zip(surfaces, judged_together(surfaces), strict=True):
        row, column = np.unravel_index(np.argmax(surface), surface.shape)
        assert np.hypot(*(ground_of(one)[row, column] - [1.0, 0.5])) > 3.0
        best = found.peaks[0]
        assert np.hypot(*(place_on_ground(one, best) - [1.0, 0.5])) < PIXEL_M
        assert best.score > 1.5 * found.peaks[1].score
        assert found.distance_m[0] == pytest.approx(np.hypot(1.0, 0.5), abs=PIXEL_M)


def test_every_photo_measures_where_its_own_surface_has_the_peak__truth():
    """Three photos have it a pixel apart from each other: none takes over the others' place."""
    photos = [sight(str(i), 90.0 * i) for i in range(3)]
    places = [(0.0, 0.0), (0.5, 0.0), (0.0, -0.5)]
    surfaces = [(one, bump(one, *place)) for one, place in zip(photos, places, strict=True)]
    for one, place, found in zip(photos, places, judged_together(surfaces), strict=True):
        assert np.hypot(*(place_on_ground(one, found.peaks[0]) - place)) < 0.1 * PIXEL_M


def test_a_place_that_only_others_tell_weighs_less__law():
    """A photo without a peak there tells what all tell together: n times the same is one."""
    photos = [sight(str(i), 90.0 * i) for i in range(3)]
    # On a slope there is no maximum.
    slope = (0.01 * np.mgrid[: 2 * HALF + 1, : 2 * HALF + 1][1]).astype(np.float32)
    surfaces = [
        (photos[0], slope),
        (photos[1], noise(1) + bump(photos[1], 1.0, 0.5, 12.0)),
        (photos[2], noise(2) + bump(photos[2], 1.0, 0.5, 12.0)),
    ]
    found = judged_together(surfaces)
    assert np.hypot(*(place_on_ground(photos[0], found[0].peaks[0]) - [1.0, 0.5])) < PIXEL_M
    assert found[0].peaks[0].sigma_px > 1.5 * found[1].peaks[0].sigma_px


def test_one_photo_alone_says_what_its_surface_says__law():
    one = sight("1")
    surface = noise(3) + bump(one, 1.0, 0.5)
    (found,) = judged_together([(one, surface)])
    half = surface.astype(np.float16).astype(np.float32)
    middle = np.s_[HALF - INNER : HALF + INNER + 1, HALF - INNER : HALF + INNER + 1]
    outside = np.ones(half.shape, bool)
    outside[middle] = False
    assert found.chance.heights == pytest.approx(decoys_outside(half, outside, APART_PX)[0])
    best = half[middle].max()
    height = (best - found.chance.middle) / found.chance.spread
    assert found.peaks[0].score == pytest.approx(height, rel=1e-3)


def test_chance_together_is_as_high_as_chance_alone__law():
    """Each mean is counted in its own deviations, so that decoys of few and many photos agree."""
    counts = {}
    for photos in (1, 4):
        decoys = []
        for seed in range(12):
            surfaces = [(sight(str(i)), noise(100 * seed + i)) for i in range(photos)]
            decoys += judged_together(surfaces)[0].chance.heights
        counts[photos] = np.quantile(decoys, [0.5, 0.9, 0.99])
    assert counts[4] == pytest.approx(counts[1], rel=0.12)


def test_a_right_peak_close_beside_a_higher_one_is_a_candidate__truth():
    """A row of trees three pixels beside the road."""
    one = sight("1")
    rows, columns = np.mgrid[: 2 * HALF + 1, : 2 * HALF + 1] - HALF
    surface = np.zeros(rows.shape, np.float32)
    for column, height in ((0, 5.0), (3, 6.0)):
        surface += height * np.exp(-((columns - column) ** 2 + rows**2) / 1.5).astype(np.float32)
    (found,) = judged_together([(one, surface + 0.01 * noise(6))])
    assert found.distance_m[:2] == pytest.approx([3 * PIXEL_M, 0.0], abs=0.4 * PIXEL_M)


def test_the_latest_surface_is_kept__law():
    first, second = noise(4), noise(5)
    with keeping_surfaces() as kept:
        kept.keep("A", "1", first)
        kept.keep("A", "2", second)
        kept.keep("A", "1", first[:9])
        assert np.allclose(kept.surface("A", "1"), first[:9], rtol=1e-3)
        assert np.allclose(kept.surface("A", "2"), second, rtol=1e-3)


def test_a_metre_of_ground_moves_a_point_as_the_photo_sees_it__truth(tiny):
    opened = tiny.opened(tiny.names[0])
    ground = object_on_ground(
        opened.photo, opened.camera, np.array([[400.0, 500.0]]), tiny.reference.dem
    )
    away = np.array([[1.5, -2.0, 0.0]])
    moved = opened.photo.pixel_from_object(ground + away, opened.camera)
    told = np.array([[400.0, 500.0]]) + away[:, :2] @ moves_of(opened, ground)[0].T
    assert np.abs(moved - told).max() < 0.02


def test_all_photos_find_unchanged_ground_and_two_workers_the_same__truth(tiny):
    """At their true orientations; to the last digit, whichever photo is done first."""
    ground = ground_over(tiny, 4)
    ids = tuple(f"P{i:02d}" for i in range(len(ground)))
    points = ReferencePoints(ids, ground, np.full(ground.shape, 0.4))
    site = Site(tiny.archival(), tiny.scans, points, dict.fromkeys(ids, "salient"))
    block = tiny.block.with_photos({n: replace(p, oriented=True) for n, p in tiny.photos.items()})
    options = ControlStageOptions(orientation=OrientationOptions(template_half_px=30))

    def run(mapper):
        with keeping_surfaces() as kept:
            alone = search_photos(block, site, options, (), kept, Work(mapper=mapper))
            return alone, joint_searches(block, site, options.orientation, alone, kept, mapper)

    alone, together = run(map)
    with ThreadPoolExecutor(2) as pool:
        assert repr(run(pool.map)[1]) == repr(together)
    assert [(one.point_id, one.photo_id) for one in together] == [
        (one.point_id, one.photo_id) for one in alone
    ]
    metres = np.array([one.distance_m[0] for one in together])
    assert np.mean(metres < 1.0) > 0.9
    assert np.mean([one.peaks[0].score for one in together]) > np.mean(
        [one.peaks[0].score for one in alone]
    )
