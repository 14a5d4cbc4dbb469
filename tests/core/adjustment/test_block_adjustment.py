"""Bundle adjustment of synthetic blocks whose truth is known."""

from dataclasses import replace

import numpy as np
import pytest

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block
from core.block import TiePoints
from core.errors import Cancelled
from core.geometry.exterior import ExteriorOrientation
from tests.flights import FlightPlan, fly

PLAN = FlightPlan(ties=700)
PLAIN = AdjustmentOptions(robust=False)
SEEDS = range(30)


@pytest.fixture(scope="module")
def flights():
    return [fly(PLAN, np.random.default_rng(seed)) for seed in SEEDS]


@pytest.fixture(scope="module")
def reports(flights):
    return [adjust_block(flight.block) for flight in flights]


def exterior_differences(report, truth):
    """Errors of centres and angles in their standard deviations, (photos, 6)."""
    rows = []
    for name, sigmas in report.exterior_sigmas.items():
        ours, true = report.block.photos[name].exterior, truth.photos[name].exterior
        angles = np.array([ours.omega, ours.phi, ours.kappa]) - [true.omega, true.phi, true.kappa]
        angles = np.remainder(angles + np.pi, 2 * np.pi) - np.pi
        centre = (ours.centre - true.centre) / sigmas.centre_m
        rows.append(np.concatenate([centre, angles / sigmas.angles]))
    return np.array(rows)


def centres(report):
    return np.array([photo.exterior.centre for photo in report.block.photos.values()])


# ------------------------------------------------------------------ what was put in comes out


def test_sigma_nought_is_one__truth(reports):
    # Redundancy is near 900: sigma nought scatters by 0.024, 0.1 is four of these.
    sigmas = np.array([report.sigma_nought for report in reports])
    assert all(report.converged for report in reports)
    assert ((sigmas > 0.9) & (sigmas < 1.1)).all()
    assert np.mean(sigmas) == pytest.approx(1.0, abs=3 * 0.024 / np.sqrt(len(sigmas)))


def test_exterior_errors_are_as_large_as_their_sigmas__truth(flights, reports):
    errors = np.array(
        [
            exterior_differences(report, flight.truth)
            for flight, report in zip(flights, reports, strict=True)
        ]
    )
    # 1080 values, of which those of one block hang together: worth about 30 x 8 (datum, tilt).
    assert np.mean(errors**2) == pytest.approx(1.0, abs=3 * np.sqrt(2 / 240))
    assert np.mean(np.abs(errors) < 1.96) == pytest.approx(0.95, abs=0.03)


def test_tie_points_are_covered_by_their_sigmas__truth(flights, reports):
    errors = []
    for flight, report in zip(flights, reports, strict=True):
        seen = np.isfinite(report.tie_positions[:, 0])
        truth = flight.ties[: len(seen)][seen]
        errors.append((report.tie_positions[seen] - truth) / report.tie_sigmas_m[seen])
    errors = np.concatenate(errors)
    assert np.mean(errors**2) == pytest.approx(1.0, abs=0.15)
    assert np.mean(np.abs(errors) < 1.96) == pytest.approx(0.95, abs=0.02)


def test_cameras_come_back__truth(flights, reports):
    errors = []
    for flight, report in zip(flights, reports, strict=True):
        ours, true = report.block.cameras["wide"], flight.truth.cameras["wide"]
        start = flight.block.cameras["wide"]
        corner = 90 * np.sqrt(2)
        errors.append(
            [
                distortion_um(camera, corner) - distortion_um(true, corner)
                for camera in (start, ours)
            ]
        )
    before, after = np.sqrt(np.mean(np.square(errors), axis=0))
    # Put in: 50 micrometres a term.
    assert after < 0.5 * before


def distortion_um(camera, radius):
    k1, k2, k3 = camera.radial_distortion
    return 1000 * radius**3 * (k1 + radius**2 * (k2 + radius**2 * k3))


def test_check_points_are_near_their_truth__truth(flights, reports):
    differences = np.concatenate(
        [[check.difference_m for check in report.checks] for report in reports]
    )
    # METHODS 9.3: 0.2-0.35 m an axis in plan for 20-60 points of 1 m; here 30 of 0.4 m,
    # plus 1 px = 0.22 m of the check measurement itself.
    assert np.sqrt(np.mean(differences[:, :2] ** 2)) < 0.5
    assert len(reports[0].checks) > 5
    assert {check.point_id[:5] for check in reports[0].checks} == {"check"}


def test_control_sigmas_cover_control__truth(flights, reports):
    errors = []
    for flight, report in zip(flights, reports, strict=True):
        for name, position in report.surveyed_positions.items():
            off = position - flight.truth.surveyed[name].position
            errors.append(off / report.surveyed_sigmas_m[name])
    assert np.mean(np.square(errors)) == pytest.approx(1.0, abs=0.15)


def test_redundancy_numbers_are_shares__law(reports):
    numbers = np.array(list(reports[0].redundancy_numbers.values()))
    assert ((numbers > 0) & (numbers < 1)).all()


# ------------------------------------------------------------------ gross errors and check points


def with_shift(block, key, pixels, **changes):
    measurement = block.measurements[key]
    return block.with_measurement(
        replace(measurement, column=measurement.column + pixels, **changes)
    )


def test_gross_control_moves_nothing_but_its_own_residual__law(flights):
    block = flights[0].block
    key = next(key for key in block.measurements if key[0].startswith("control"))
    # A good ray that stands just at the limit would fall on either side of it: none does at 1e-5.
    calm = AdjustmentOptions(risk=1e-5)
    without = adjust_block(with_shift(block, key, 0.0, status="unused"), calm)
    wrong = adjust_block(with_shift(block, key, 60.0), calm)
    assert list(wrong.rejected) == [key]
    assert "px off" in wrong.rejected[key]
    np.testing.assert_allclose(centres(wrong), centres(without), rtol=0, atol=1e-4)
    moved = np.subtract(wrong.residuals_px[key], without.residuals_px[key])
    np.testing.assert_allclose(moved, [-60.0, 0.0], atol=0.01)
    others = [other for other in block.measurements if other != key]
    for other in others:
        np.testing.assert_allclose(
            wrong.residuals_px[other], without.residuals_px[other], atol=1e-3
        )


def test_accepted_measurements_stay_in__law(flights):
    block = flights[0].block
    key = next(key for key in block.measurements if key[0].startswith("control"))
    report = adjust_block(with_shift(block, key, 60.0, status="accepted"))
    assert key not in report.rejected
    assert key in report.redundancy_numbers


def test_misplaced_control_point_is_left_out_in_all_photos__law(flights):
    """All photos agree on a place that is 12 m from the point's coordinates."""
    block = flights[1].block
    counts = dict.fromkeys(block.surveyed, 0)
    for name, _ in block.measurements:
        counts[name] += name.startswith("control")
    name = max(counts, key=lambda name: counts[name])
    assert counts[name] >= 3
    point = block.surveyed[name]
    moved = replace(point, position=point.position + np.array([12.0, 0.0, 0.0]))
    report = adjust_block(replace(block, surveyed={**block.surveyed, name: moved}))
    keys = {key for key in block.measurements if key[0] == name}
    assert set(report.rejected) == keys
    without = {key: value for key, value in block.measurements.items() if key not in keys}
    expected = adjust_block(replace(block, measurements=without))
    np.testing.assert_allclose(centres(report), centres(expected), rtol=0, atol=1e-4)


def test_gross_tie_rays_are_left_out__truth(flights):
    flight, rng = flights[2], np.random.default_rng(8)
    ties = flight.block.ties
    counts = np.bincount(ties.point, minlength=ties.count)
    free = np.flatnonzero(counts[ties.point] >= 3)
    bad = rng.choice(free, 15, replace=False)
    _, first = np.unique(ties.point[bad], return_index=True)
    bad = bad[first]
    pixels = ties.pixels.copy()
    pixels[bad] += rng.choice([-1, 1], (len(bad), 2)) * rng.uniform(8, 60, (len(bad), 2))
    wrong = TiePoints(ties.photo_ids, ties.point, ties.photo, pixels, ties.sigma_px)
    # At this risk no good ray is left out by chance.
    report = adjust_block(replace(flight.block, ties=wrong), AdjustmentOptions(risk=1e-5))
    dropped = np.isnan(report.tie_residuals_px[:, 0]) & (counts[ties.point] >= 2)
    assert dropped[bad].all()
    # A ray of three may take its point along; no other does.
    assert set(ties.point[dropped]) <= set(ties.point[bad])
    assert 0.9 < report.sigma_nought < 1.1


@pytest.mark.parametrize("share", [0.1, 0.3])
def test_many_wrong_control_measurements_are_found__truth(share):
    plan = replace(PLAN, control=60)
    flight, rng = fly(plan, np.random.default_rng(4)), np.random.default_rng(5)
    block = flight.block
    keys = [key for key in block.measurements if key[0].startswith("control")]
    wrong = {keys[row] for row in rng.choice(len(keys), int(share * len(keys)), replace=False)}
    for key in wrong:
        block = with_shift(block, key, float(rng.choice([-1, 1]) * rng.uniform(15, 80)))
    report = adjust_block(block)
    assert report.converged
    assert len(wrong - set(report.rejected)) <= 0.02 * len(wrong) + 0.5
    assert len(set(report.rejected) - wrong) <= 0.05 * len(keys)
    assert np.sqrt(np.mean(exterior_differences(report, flight.truth) ** 2)) < 1.6


def test_check_points_never_take_part__law(flights):
    block = flights[3].block
    report = adjust_block(block)
    control = {name: p for name, p in block.surveyed.items() if p.role == "control"}
    measured = {key: m for key, m in block.measurements.items() if key[0] in control}
    without = adjust_block(replace(block, surveyed=control, measurements=measured))
    assert without.checks == ()
    assert without.sigma_nought == report.sigma_nought
    np.testing.assert_array_equal(centres(without), centres(report))
    np.testing.assert_array_equal(without.tie_residuals_px, report.tie_residuals_px)


def test_same_block_same_figures__law(flights):
    first, second = adjust_block(flights[4].block), adjust_block(flights[4].block)
    np.testing.assert_array_equal(centres(first), centres(second))
    assert first.residuals_px == second.residuals_px
    np.testing.assert_array_equal(first.tie_sigmas_m, second.tie_sigmas_m)


def test_adjusting_again_changes_nothing__law(flights):
    """Priors stay where they were: approximate orientations and certificates, not last results."""
    first = adjust_block(flights[5].block)
    second = adjust_block(first.block)
    np.testing.assert_allclose(centres(second), centres(first), rtol=0, atol=1e-4)
    assert second.sigma_nought == pytest.approx(first.sigma_nought, abs=1e-7)
    assert second.block.cameras["wide"].certificate == flights[5].block.cameras["wide"]


# ------------------------------------------------------------------ the edges


def test_every_measurement_has_a_residual__law(flights):
    block = flights[6].block
    key = next(iter(block.measurements))
    block = block.with_measurement(replace(block.measurements[key], status="rejected"))
    report = adjust_block(block)
    assert set(report.residuals_px) == set(block.measurements)
    photo, point = block.photos[key[1]], block.surveyed[key[0]]
    adjusted = report.block.photos[photo.photo_id]
    predicted = adjusted.pixel_from_object(point.position[None], report.block.cameras["wide"])
    measured = block.measurements[key].pixel
    np.testing.assert_allclose(report.residuals_px[key], (predicted - measured)[0])


def test_photos_without_orientation_stay_out__law(flights):
    block = flights[7].block
    name = "01_002"
    photos = {**block.photos, name: replace(block.photos[name], oriented=False)}
    report = adjust_block(block.with_photos(photos))
    assert name not in report.exterior_sigmas
    assert report.block.photos[name].exterior is block.photos[name].exterior
    rays = block.ties.photo == block.ties.photo_ids.index(name)
    assert np.isnan(report.tie_residuals_px[rays]).all()
    assert all(key[1] != name for key in report.redundancy_numbers)
    assert {key for key in block.measurements if key[1] == name} <= set(report.residuals_px)


def test_block_without_oriented_photos_comes_back__law(flights):
    block = flights[8].block
    photos = {name: replace(photo, oriented=False) for name, photo in block.photos.items()}
    report = adjust_block(block.with_photos(photos))
    assert not report.converged
    assert np.isnan(report.sigma_nought)
    assert set(report.residuals_px) == set(block.measurements)


def test_control_alone_and_ties_alone__law(flights):
    block = flights[9].block
    control = adjust_block(replace(block, ties=TiePoints.none()))
    assert control.converged
    assert control.tie_positions.shape == (0, 3)
    assert 0.8 < control.sigma_nought < 1.2
    ties = adjust_block(replace(block, measurements={}))
    assert ties.converged
    assert 0.9 < ties.sigma_nought < 1.1
    single = {name: photo for name, photo in block.photos.items() if name == "00_000"}
    mine = {key: m for key, m in block.measurements.items() if key[1] == "00_000"}
    alone = adjust_block(replace(block, photos=single, measurements=mine, ties=TiePoints.none()))
    assert alone.converged
    assert all(check.used_scans == 1 and check.difference_m[2] == 0 for check in alone.checks)


def test_too_few_steps_keep_the_last_sound_state__law(flights):
    block = flights[10].block
    report = adjust_block(block, replace(PLAIN, max_iterations=1))
    assert not report.converged
    assert report.iterations == 1
    full = adjust_block(block, PLAIN)
    assert full.converged
    assert full.iterations <= PLAIN.max_iterations
    # One step is better than none, and not the end.
    start = np.array([photo.exterior.centre for photo in block.photos.values()])
    left = np.abs(centres(report) - centres(full)).max()
    assert 0 < left < np.abs(start - centres(full)).max()


def test_photos_that_look_upwards_keep_their_orientation__law(flights):
    block = flights[10].block
    photos = {}
    for name, photo in block.photos.items():
        over = ExteriorOrientation(photo.exterior.centre, np.pi, 0.0, 0.0)
        prior = replace(photo.prior, sigma_angles=np.full(3, 1e-4))
        photos[name] = replace(photo, exterior=over, approximate=over, prior=prior)
    before = block.with_photos(photos)
    report = adjust_block(before)
    assert report.tie_positions.shape == (block.ties.count, 3)
    assert np.isnan(report.tie_residuals_px).all()
    for name, photo in before.photos.items():
        np.testing.assert_allclose(report.block.photos[name].exterior.centre, photo.exterior.centre)


def test_cancelling_stops_it__law(flights):
    class Stop:
        def report(self, done: float, total: float, what: str = "") -> None:
            raise Cancelled

    with pytest.raises(Cancelled):
        adjust_block(flights[0].block, progress=Stop())


def test_held_cameras_stay__law(flights):
    report = adjust_block(flights[0].block, AdjustmentOptions(estimate_cameras=False))
    assert report.block.cameras == flights[0].block.cameras


def test_bad_start_converges__truth():
    """300 m and 3 degrees off, as from an index map."""
    plan = replace(PLAN, start_m=300.0, start_rad=0.05)
    for seed in range(3):
        flight = fly(plan, np.random.default_rng(seed))
        report = adjust_block(flight.block)
        assert report.converged
        assert 0.9 < report.sigma_nought < 1.1
        # The way there leaves nothing behind: the block adjusted again is the same.
        again = adjust_block(report.block)
        assert again.rejected.keys() == report.rejected.keys()
        np.testing.assert_allclose(centres(again), centres(report), rtol=0, atol=1e-3)
