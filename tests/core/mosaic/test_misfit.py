"""Misfit of a mosaic, with shifts that were put in."""

from dataclasses import replace

import numpy as np
import pytest

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.influence import influence_of
from core.control.prediction import covariances_of
from core.mosaic.comparison import ComparisonOptions, compare_orthos
from core.mosaic.misfit import BlockErrors, MisfitVectors, measure_misfit, photos_shown
from core.mosaic.misfit_places import NEIGHBOUR_SIZES, judge_misfit
from sessions.session import Session
from tests.core.mosaic.displaced import displaced

SIDE = 12
"""Places along either side of a made block."""


def made_vectors(rng, shift_of, right=0.9, predicted_m=0.3):
    """Vectors of two photos side by side: right ones by `shift_of`, wrong ones anywhere."""
    step = 60.0
    across, up = np.meshgrid(np.arange(SIDE) * step, np.arange(SIDE) * step)
    positions = np.column_stack([across.ravel(), up.ravel()])
    count = len(positions)
    photos = tuple("west" if east < SIDE * step / 2 else "east" for east in positions[:, 0])
    sound = rng.random(count) < right
    true = np.array([shift_of(*place) for place in positions])
    shifts = np.where(
        sound[:, None], true + rng.normal(0, 0.4, (count, 2)), rng.uniform(-10, 10, (count, 2))
    )
    return MisfitVectors(
        positions,
        shifts,
        np.tile(0.4**2 * np.eye(2), (count, 1, 1)),
        np.full(count, right),
        photos,
        np.tile(predicted_m**2 * np.eye(2), (count, 1, 1)),
        np.zeros((count, 2, 6)),
        0.5,
        step,
        count,
    )


@pytest.mark.parametrize("seed", [7001, 7002, 7003])
def test_a_bad_corner_is_the_worst_place__truth(seed):
    def corner(east, north):
        return (2.0, -2.0) if east > 450 and north > 450 else (0.1, 0.0)

    misfit = judge_misfit(made_vectors(np.random.default_rng(seed), corner))
    worst = misfit.places[0]
    assert worst.significant
    assert worst.photo_id == "east"
    assert min(worst.east, worst.north) > 400
    # A third of a metre: the steps in which shifts are weighed.
    assert worst.shift_m == pytest.approx((2.0, -2.0), abs=0.5)
    assert sum(place.significant for place in misfit.places) == 1


def test_a_sound_block_has_no_significant_place__truth():
    """Ten blocks with errors as predicted: at 5 % each, three would be one in ninety."""
    false = 0
    for seed in range(7100, 7110):
        rng = np.random.default_rng(seed)
        off = {name: rng.normal(0, 0.3, 2) for name in ("west", "east")}

        def shift_of(east, north, off=off):
            return off["west" if east < 360 else "east"]

        vectors = made_vectors(rng, shift_of)
        false += any(place.significant for place in judge_misfit(vectors).places)
    assert false <= 2


def test_what_the_block_predicts_is_not_significant__law():
    """The same shift is no surprise where the block knows little."""
    vectors = made_vectors(np.random.default_rng(7004), lambda east, north: (2.0, 0.0))
    unsure = replace(vectors, predicted=4.0 * np.tile(np.eye(2), (len(vectors.positions), 1, 1)))
    assert judge_misfit(vectors).places[0].significant
    found = judge_misfit(unsure).places
    assert found
    assert not any(place.significant for place in found)


@pytest.mark.parametrize("right", [0.7, 0.5])
def test_vectors_that_agree_by_chance_tell_no_place_metres_off__truth(right):
    for seed in range(6):
        rng = np.random.default_rng((17, seed))
        off = rng.normal(0, 0.4, 2)
        misfit = judge_misfit(made_vectors(rng, lambda east, north, off=off: off, right, 0.4))
        assert misfit.places
        for place in misfit.places:
            # Without what is predicted some are told 7 to 11 m off.
            assert np.hypot(*np.subtract(place.shift_m, off)) < 1.0


def test_roads_of_one_direction_tell_nothing_along_themselves__law():
    """Matches that slid three metres along their roads agree, and are no place."""
    rng = np.random.default_rng(7007)
    vectors = made_vectors(rng, lambda east, north: (0.0, 3.0 if north > 450 else 0.0))
    assert judge_misfit(vectors).places[0].significant
    sliding = np.tile(np.diag([0.4**2, 5.0**2]), (len(vectors.positions), 1, 1))
    places = judge_misfit(replace(vectors, covariances=sliding)).places
    assert not any(place.significant for place in places)


def test_a_photo_that_may_tilt_is_told_by_its_worst_end__truth():
    """The further a neighbour lies, the less it says of a spot; else the end is taken for less."""

    def tilted(east, north):
        return 0.0, max(0.0, (east - 360) / 80)

    vectors = made_vectors(np.random.default_rng(7008), tilted, predicted_m=2.0)
    tilt = np.zeros((len(vectors.positions), 2, 6))
    tilt[:, 1, 0] = [tilted(*place)[1] for place in vectors.positions]
    stiff = judge_misfit(vectors).places[0]
    known = judge_misfit(replace(vectors, photo_errors_m=tilt)).places[0]
    assert known.photo_id == "east"
    true = tilted(known.east, known.north)[1]
    # Half a step in which shifts are weighed, and two of its standard deviations.
    assert known.length_m == pytest.approx(true, abs=0.17 + 2 * known.sigma_m)
    assert stiff.length_m < true - 0.5


def test_the_systematic_part_is_the_affinity_put_in__truth():
    middle, rng = (SIDE - 1) * 30.0, np.random.default_rng(7005)

    def turned(east, north):
        return 0.5 - 1e-3 * (north - middle), -0.25 + 1e-3 * (east - middle)

    trend = judge_misfit(made_vectors(rng, turned)).systematic
    sigma = 5 * 0.4 / np.sqrt(SIDE**2)
    assert trend.shift_m == pytest.approx((0.5, -0.25), abs=sigma)
    assert trend.rotation == pytest.approx(1e-3, abs=sigma / 200)
    assert trend.scale == pytest.approx(0, abs=sigma / 200)
    assert 0.3 < trend.remainder_m < 0.5


def test_few_vectors_tell_nothing__law():
    vectors = made_vectors(np.random.default_rng(7006), lambda east, north: (3.0, 0.0))
    few = replace(
        vectors,
        **{
            name: getattr(vectors, name)[: min(NEIGHBOUR_SIZES) - 1]
            for name in (
                "positions", "shifts_m", "covariances", "probabilities", "photo_ids", "predicted",
                "photo_errors_m",
            )
        },
    )  # fmt: skip
    misfit = judge_misfit(few)
    assert (misfit.systematic, misfit.places, misfit.judged) == (None, (), 0)


@pytest.fixture(scope="module")
def run(tiny_run):
    """Mosaic, seams and errors of the tiny block as it was run."""
    with Session.open(tiny_run.folder, "test") as session:
        report = session.products.latest_value("adjustment")
        seams = session.products.latest_value("mosaic").seams
    covariances = covariances_of(influence_of(report, AdjustmentOptions()))
    errors = BlockErrors(report, covariances, tiny_run.reference.dem, 0.25, 0.5)
    return tiny_run, seams, errors


@pytest.fixture(scope="module")
def measured(run):
    """Its vectors, measured in this process."""
    tiny, seams, errors = run
    sheets = sorted((tiny.folder / "ortho").glob("*.tif"))
    return measure_misfit(tiny.folder / "results/mosaic.tif", sheets, seams, errors)


@pytest.mark.slow
def test_vectors_are_as_right_as_they_say__truth(run, measured):
    """Where the mosaic truly lies is told by the archival ortho, which a present one is not."""
    tiny, vectors = run[0], measured
    mosaic = tiny.folder / "results/mosaic.tif"
    true = compare_orthos(mosaic, tiny.truth.archival_ortho, ComparisonOptions(places=400))
    away = np.hypot(*(vectors.shifts_m - true.median_shift).T)
    likely = vectors.probabilities > 0.8
    assert likely.sum() > 30
    # Local errors of the mosaic and three standard deviations of a match.
    right = away[likely] < 1.5
    expected = float(vectors.probabilities[likely].mean())
    # Three standard deviations of a share.
    spread = np.sqrt(expected * (1 - expected) / likely.sum())
    assert right.mean() > expected - 3 * spread - 0.05


@pytest.mark.slow
def test_vectors_are_those_of_the_run_that_measured_them_side_by_side__law(run, measured):
    with Session.open(run[0].folder, "test") as session:
        _, misfit = session.products.latest_value("misfit")
    assert len(measured.shifts_m) > 30
    assert np.array_equal(misfit.vectors.shifts_m, measured.shifts_m)
    assert np.array_equal(misfit.vectors.probabilities, measured.probabilities)


@pytest.mark.slow
def test_a_photo_three_metres_off_is_the_worst_place__truth(run, measured, tmp_path):
    tiny, seams, errors = run
    sheets = sorted((tiny.folder / "ortho").glob("*.tif"))
    mosaic = tiny.folder / "results/mosaic.tif"
    sound = judge_misfit(measured)
    assert not any(place.significant for place in sound.places)
    seam = next(one for one in seams if one.photo_id.endswith("543"))
    spoilt = displaced(mosaic, tmp_path / "spoilt.tif", seam, (3, 0))
    worst = judge_misfit(measure_misfit(spoilt, sheets, seams, errors)).places[0]
    assert worst.significant
    assert worst.photo_id == seam.photo_id
    assert worst.shift_m == pytest.approx((3, 0), abs=0.7)


def test_places_beside_all_seams_have_no_photo__law(run):
    _, seams, _ = run
    inside = seams[0].area.representative_point()
    names = photos_shown(np.array([[inside.x, inside.y], [0.0, 0.0]]), seams)
    assert names == (seams[0].photo_id, "")
