"""Two blocks of one flight: sound ones differ as predicted, and a displaced photo is told."""

from dataclasses import replace

import numpy as np
import pytest

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block
from core.adjustment.influence import influence_of
from core.quality.neighbours import (
    FEWEST_VECTORS,
    LEVEL,
    Comparison,
    Difference,
    MisfitParts,
    NeighbourBlock,
    compare_misfits,
    compare_photos,
    compare_points,
    disagreements,
)
from tests.flights import ORIGIN, FlightPlan, fly
from tests.neighbouring import in_utm, part_of

PLAIN = AdjustmentOptions(robust=False)
PLAN = FlightPlan(photos_per_strip=5, ties=500, control=60, check=20)
PAIRS = 16
LIMIT_M = 1.0
"""Of the position of either block."""


def adjusted(block):
    report = adjust_block(block, PLAIN)
    return NeighbourBlock(report, influence_of(report, PLAIN))


def halves(block):
    """Names of the photos of two blocks that share the middle photo of each strip."""
    names = sorted(block.photos)
    return [n for n in names if n[-1] <= "2"], [n for n in names if n[-1] >= "2"]


def neighbours(seed, *, alike=True):
    """Two blocks of one flight: on the same control, or each on its own half of it."""
    block = fly(PLAN, np.random.default_rng(seed)).block
    control = [name for name in sorted(block.surveyed) if name.startswith("control")]
    checks = set(block.surveyed) - set(control)
    parts = {*control[::2], *checks}, {*control[1::2], *checks}
    points = (None, None) if alike else parts
    sides = [adjusted(part_of(block, *of)) for of in zip(halves(block), points, strict=True)]
    return (*sides, {name: name for name in halves(block)[0] if name in halves(block)[1]})


@pytest.fixture(scope="module")
def pair():
    return neighbours(3)


@pytest.mark.parametrize("alike", [True, False])
def test_sound_blocks_differ_as_predicted__truth(alike):
    """Observed over predicted is near one, whether both use the same control or none in common."""
    pairs = [compare_photos(*neighbours(seed, alike=alike)).photos for seed in range(PAIRS)]
    ratios = np.array([[photo.difference.ratio for photo in photos] for photos in pairs])
    assert 0.85 < np.sqrt(np.mean(ratios**2)) < 1.15
    chances = [photo.difference.chance for photos in pairs for photo in photos]
    # An even distribution of chances is what a calibrated test has.
    assert np.median(chances) == pytest.approx(0.5, abs=0.17)
    exterior = np.array(
        [
            [[*(one.shift_m / one.shift_sigma_m), *(one.turn / one.turn_sigma)] for one in photos]
            for photos in pairs
        ]
    )
    # Photos of a pair err alike: each pair is one sample, whose scatter says what chance allows.
    squares = np.mean(exterior**2, axis=1)
    standard_error = squares.std(axis=0, ddof=1) / np.sqrt(PAIRS)
    assert (np.abs(squares.mean(axis=0) - 1.0) < 3.0 * standard_error).all()
    assert np.sqrt(squares.mean()) == pytest.approx(1.0, abs=0.15)


def test_common_measurements_are_not_counted_twice__truth():
    """Were all errors taken for independent, sound blocks would seem too alike to be true."""
    one, other, names = neighbours(3)
    found = compare_photos(one, other, names)
    assert found.correlation == pytest.approx(1.0)
    assert found.measurements > 50
    noise = np.random.default_rng(0)
    measured = {
        key: replace(m, column=m.column + noise.normal(), row=m.row + noise.normal())
        for key, m in other.report.block.measurements.items()
    }
    ties = other.report.block.ties
    pixels = ties.pixels + noise.normal(size=ties.pixels.shape) * 0.5
    again = replace(other.report.block, measurements=measured, ties=replace(ties, pixels=pixels))
    apart = compare_photos(one, adjusted(again), names)
    # Each has its noise, and half of the difference's is common.
    assert apart.correlation == pytest.approx(0.5, abs=0.15)
    for before, after in zip(
        *(sorted(c.photos, key=lambda p: p.photo_id) for c in (found, apart)), strict=True
    ):
        assert after.difference.sigma_m > 1.05 * before.difference.sigma_m


def test_a_copy_of_a_block_is_no_news__law(pair):
    one, _, _ = pair
    found = compare_photos(one, one, {name: name for name in one.report.block.photos})
    assert len(found.photos) == 6
    for photo in found.photos:
        assert photo.difference.length_m == pytest.approx(0.0, abs=1e-9)
        assert photo.difference.verdict(found.compared, LIMIT_M) == "agree"
    assert not disagreements(found, LIMIT_M)


def displaced(side, name, shift_m):
    """The block with one photo elsewhere, as a wrong decision would leave it."""
    photo = side.report.block.photos[name]
    exterior = replace(photo.exterior, centre=photo.exterior.centre + np.array([shift_m, 0, 0]))
    photos = {**side.report.block.photos, name: replace(photo, exterior=exterior)}
    return replace(
        side, report=replace(side.report, block=replace(side.report.block, photos=photos))
    )


def test_a_photo_three_metres_off_is_told_and_no_other__truth(pair):
    one, other, names = pair
    found = compare_photos(one, displaced(other, "01_002", 3.0), names)
    assert [photo.photo_id for photo in disagreements(found, LIMIT_M)] == ["01_002"]
    worst = found.photos[0]
    assert worst.difference.length_m == pytest.approx(3.0, abs=1.0)
    assert worst.ground_m.mean(axis=0)[0] == pytest.approx(3.0, abs=1.0)
    assert worst.difference.chance < LEVEL / 2


def test_references_that_are_off_against_each_other_are_allowed_for__truth(pair):
    """Another reference adds its error to every place of a photo alike."""
    one, other, names = pair
    moved = displaced(other, "01_002", 3.0)
    same = compare_photos(one, moved, names).photos[0].difference
    apart = compare_photos(one, moved, names, reference_sigma_m=2.0)
    worst = next(photo for photo in apart.photos if photo.photo_id == "01_002")
    assert not disagreements(apart, LIMIT_M)
    assert worst.difference.sigma_m == pytest.approx(np.hypot(same.sigma_m, np.sqrt(8.0)), rel=1e-6)


def test_photos_without_orientation_are_named__truth(pair):
    one, other, names = pair
    photo = replace(other.report.block.photos["01_002"], oriented=False)
    block = replace(other.report.block, photos={**other.report.block.photos, "01_002": photo})
    found = compare_photos(one, replace(other, report=replace(other.report, block=block)), names)
    assert found.one_sided == ("01_002",)
    assert [photo.photo_id for photo in found.photos] == ["00_002"]


def test_a_block_in_another_crs_shows_the_same_ground__truth(pair):
    """The same block adjusted in UTM: its photos lie where they lay, and stand as they stood."""
    one, other, names = pair
    there, back = in_utm(other.report.block)
    before = {photo.photo_id: photo for photo in compare_photos(one, other, names).photos}
    found = compare_photos(one, adjusted(there), names, back)
    for photo in found.photos:
        known = before[photo.photo_id]
        # Within a photo the scale of either map changes by some millionths.
        np.testing.assert_allclose(photo.ground_m, known.ground_m, atol=0.1)
        np.testing.assert_allclose(photo.shift_m, known.shift_m, atol=0.3)
        np.testing.assert_allclose(photo.turn, known.turn, atol=1e-4)
        # Control in other coordinates is not known to be the same.
        assert known.difference.sigma_m < photo.difference.sigma_m < 2 * known.difference.sigma_m
    assert not disagreements(found, LIMIT_M)


def test_surveyed_points_differ_as_predicted__truth():
    """Check points of both blocks, each with control of its own."""
    squares = []
    for seed in range(PAIRS):
        one, other, _ = neighbours(seed, alike=False)
        for point in compare_points(one.report, other.report):
            assert point.roles == ("check", "check")
            squares.append(np.nanmean((point.shift_m / point.sigma_m) ** 2))
    assert len(squares) > PAIRS
    # Rays in shared photos are the same in both: an upper limit.
    assert 0.5 < np.sqrt(np.mean(squares)) < 1.1


def test_control_that_both_take_over_is_common__truth(pair):
    """Given coordinates draw both blocks to the same place."""
    one, other, _ = pair
    sides = [
        replace(
            side.report,
            block=replace(
                side.report.block,
                surveyed={
                    name: replace(point, source="surveyed")
                    for name, point in side.report.block.surveyed.items()
                },
            ),
        )
        for side in (one, other)
    ]
    shared = compare_points(*sides)
    both = [point for point in shared if point.roles == ("control", "control")]
    assert len(both) > 5
    for point in both:
        alone = np.hypot(*point.sigmas_m)
        assert (point.sigma_m < alone).all()
        assert point.difference.verdict(len(both), LIMIT_M) == "agree"
    name = both[0].point_id
    positions = {
        **sides[1].surveyed_positions,
        name: sides[1].surveyed_positions[name] + np.array([3.0, 0, 0]),
    }
    off = compare_points(sides[0], replace(sides[1], surveyed_positions=positions))
    assert off[0].point_id == name
    assert off[0].difference.verdict(len(off), LIMIT_M) == "disagree"
    assert off[0].residuals_m[1][0] == pytest.approx(both[0].residuals_m[1][0] + 3)
    far = {**positions, name: positions[name] + 100.0}
    left = compare_points(sides[0], replace(sides[1], surveyed_positions=far))
    assert name not in {point.point_id for point in left}


def mosaic(rng, shift, count=40, sigma=0.3):
    grid = ORIGIN[:2] + rng.uniform(0, 2000, size=(count, 2))
    noise = rng.normal(size=(count, 2)) * 0.4
    return MisfitParts(grid, np.array(shift) + noise, np.full((count, 2), sigma**2))


def test_mosaics_are_compared_by_their_misfits__truth():
    """What both misfit a common reference by is not between them."""
    rng, ratios = np.random.default_rng(1), []
    for _ in range(200):
        common = rng.normal(size=2) * 2.0
        one = mosaic(rng, common + rng.normal(size=2) * 0.3)
        other = replace(mosaic(rng, common + rng.normal(size=2) * 0.3), positions=one.positions + 5)
        found = compare_misfits(one, other, 50.0)
        assert found.places == 40
        ratios.append(found.difference.ratio)
    assert np.sqrt(np.mean(np.square(ratios))) == pytest.approx(1.0, abs=0.1)
    one = mosaic(rng, (0.0, 0.0))
    off = replace(mosaic(rng, (3.0, 0.0)), positions=one.positions)
    found = compare_misfits(one, off, 50.0)
    assert found.shift_m[0] == pytest.approx(3.0, abs=0.4)
    assert found.difference.verdict(1, LIMIT_M) == "disagree"
    assert compare_misfits(one, off, 50.0, 2.0).difference.verdict(1, LIMIT_M) == "agree"
    few = mosaic(rng, (0.0, 0.0), FEWEST_VECTORS - 1)
    assert compare_misfits(one, few, 50.0) is None
    assert compare_misfits(one, replace(off, positions=off.positions + 1e5), 50.0) is None


def test_what_is_not_predicted_is_not_judged__law():
    unknown = Difference(3.0, float("nan"), float("nan"))
    assert unknown.verdict(1, LIMIT_M) == "unknown"
    assert np.isnan(unknown.ratio)
    assert Comparison().compared == 0
    assert Difference(0.8, 0.1, LEVEL / 2).verdict(1, LIMIT_M) == "differ"
    # The more is compared, the less likely one of it must be.
    assert Difference(1.1, 0.3, LEVEL / 2).verdict(1, LIMIT_M) == "disagree"
    assert Difference(1.1, 0.3, LEVEL / 2).verdict(3, LIMIT_M) == "agree"
