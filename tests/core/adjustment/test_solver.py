"""Reduced normal equations against the full ones, written down row by row."""

from dataclasses import replace

import numpy as np
import pytest

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.gauss_newton import Fit, initial_state
from core.adjustment.linearised import linearise
from core.adjustment.network import network_of
from core.adjustment.reliability import precision_of
from core.adjustment.solver import normals_of, pattern_of, solve
from core.adjustment.weights import classes_of
from core.block import ExteriorPrior, ShiftedReference
from tests.flights import FlightPlan, fly

PLAN = FlightPlan(strips=2, photos_per_strip=3, ties=40, control=8, check=0)


class Full:
    """All observation equations of a network as one dense matrix."""

    def __init__(self, options, seed=0):
        block = fly(PLAN, np.random.default_rng(seed)).block
        if options is SHIFTED:
            block = with_older_points(block)
        prior = ExteriorPrior(np.full(3, 0.5), np.full(3, 0.01))
        photos = {name: replace(photo, prior=prior) for name, photo in block.photos.items()}
        self.network = network_of(replace(block, photos=photos), options)
        state, placed = initial_state(self.network)
        assert placed.all()
        turned = np.random.default_rng(3).normal(size=self.network.positioning.count) * 0.01
        shifts = np.linspace(-0.3, 0.2, self.network.points.shifts.count)
        state = replace(state, positioning=turned, shifts=shifts)
        self.lin = linearise(self.network, state)
        self.weights = np.random.default_rng(1).uniform(0.2, 1.0, len(placed))
        self.pattern = pattern_of(self.network)
        self.photos, self.shared = 6 * len(self.network.photos), self.network.shared
        self.rows, self.side = self._equations()

    def _equations(self):
        network, lin, rays = self.network, self.lin, self.network.rays
        points = network.points.count
        size = self.photos + self.shared + 3 * points
        rows, side = [], []
        for ray in range(len(rays.photo)):
            for axis in range(2):
                row = np.zeros(size)
                photo, point = 6 * rays.photo[ray], self.photos + self.shared + 3 * rays.point[ray]
                row[photo : photo + 6] = lin.by_photo[axis, :, ray]
                lensed = network.lensed
                row[self.photos : self.photos + lensed] = lin.by_camera[axis, :, ray]
                row[point : point + 3] = -lin.by_photo[axis, :3, ray]
                root = np.sqrt(self.weights[ray])
                rows.append(row * root)
                side.append(lin.residuals[axis, ray] * root)
        for point, axis in zip(*np.nonzero(network.points.known_weight), strict=True):
            row = np.zeros(size)
            column = self.photos + self.shared + 3 * point + axis
            row[column] = network.points.known_weight[point, axis]
            shifts = network.points.shifts
            for own in np.flatnonzero(shifts.rows == point):
                part = slice(self.photos + network.lensed, self.photos + network.pointed)
                row[part] = row[column] * shifts.design[own, axis]
            rows.append(row)
            side.append(lin.ground[point, axis])
        for photo in range(len(network.photos)):
            for axis in range(3):
                row, turn = np.zeros((2, size))
                row[6 * photo + axis] = network.priors.centre_weights[photo, axis]
                turn[6 * photo + 3 : 6 * photo + 6] = lin.angles_by_rotation[photo, axis]
                part = slice(self.photos + network.pointed, self.photos + self.shared)
                row[part] = lin.centres_by_positioning[photo, axis]
                turn[part] = lin.angles_by_positioning[photo, axis]
                rows += [row, turn]
                side += [lin.centres[photo, axis], lin.angles[photo, axis]]
        weights = [network.priors.constant_weights[0, : network.lensed]]
        weights += [network.points.shifts.weights, network.positioning.weights]
        weights = np.concatenate(weights)
        known = [lin.constants[0, : network.lensed], lin.shifts, lin.positioning]
        known = np.concatenate(known)
        for axis in range(self.shared):
            row = np.zeros(size)
            row[self.photos + axis] = weights[axis]
            rows.append(row)
            side.append(known[axis])
        return np.array(rows), np.array(side)


WITH_ALL = AdjustmentOptions(
    self_calibration=("affinity", "ebner12"),
    gnss_shift="strip",
    gnss_drift=True,
    misalignment=True,
)
SHIFTED = AdjustmentOptions(gnss_shift="block")
CHOICES = [AdjustmentOptions(), AdjustmentOptions(estimate_cameras=False), WITH_ALL, SHIFTED]


def with_older_points(block):
    """Half the control points of two references with shifts, one of them without any in height."""
    older = [ShiftedReference("1984", (0.3, 0.3, 0.0)), ShiftedReference("1953", (0.5, 0.5, 0.8))]
    names = sorted(block.surveyed)
    moved = {
        name: replace(block.surveyed[name], shifted=one)
        for number, one in enumerate(older)
        for name in names[number::4]
    }
    return replace(block, surveyed={**block.surveyed, **moved})


@pytest.mark.parametrize("options", CHOICES)
@pytest.mark.parametrize("damping", [0.0, 0.1])
def test_reduced_normal_equations_give_the_full_solution__law(options, damping):
    full = Full(options)
    normal = full.rows.T @ full.rows
    normal[np.diag_indices(len(normal))] *= 1 + damping
    expected = -np.linalg.solve(normal, full.rows.T @ full.side)
    normals = normals_of(full.network, full.pattern, full.lin, full.weights, damping=damping)
    step = solve(full.network, full.pattern, normals)
    scaled = (step.constants * full.network.scale).ravel()[: full.network.lensed]
    shared = [scaled, step.shifts, step.positioning]
    ours = np.concatenate([step.photos.ravel(), *shared, step.points.ravel()])
    sigmas = np.sqrt(np.diag(np.linalg.inv(normal)))
    # In units of each unknown's own standard deviation.
    np.testing.assert_allclose(ours / sigmas, expected / sigmas, atol=1e-6)
    assert step.decrement == pytest.approx(expected @ normal @ expected, rel=1e-9)


@pytest.mark.parametrize("options", CHOICES)
def test_cofactors_are_those_of_the_full_inverse__law(options):
    full = Full(options)
    inverse = np.linalg.inv(full.rows.T @ full.rows)
    normals = normals_of(full.network, full.pattern, full.lin, full.weights, damping=0.0)
    precision = precision_of(full.network, full.pattern, full.lin, normals)
    for photo in range(len(full.network.photos)):
        own = slice(6 * photo, 6 * photo + 6)
        sigmas = np.sqrt(np.diag(inverse[own, own]))
        ours = precision.photos[photo] / np.outer(sigmas, sigmas)
        np.testing.assert_allclose(ours, inverse[own, own] / np.outer(sigmas, sigmas), atol=1e-7)
    variances = np.diag(inverse)[full.photos + full.shared :].reshape(-1, 3)
    np.testing.assert_allclose(precision.points, variances, rtol=1e-7)
    rays = full.rows[: 2 * len(full.weights)] / np.repeat(np.sqrt(full.weights), 2)[:, None]
    computed = np.sum(rays * (rays @ inverse), axis=1).reshape(-1, 2).T
    np.testing.assert_allclose(precision.rays, computed, atol=1e-8)


@pytest.mark.parametrize("options", CHOICES)
def test_redundancies_of_the_classes_are_those_of_the_full_equations__law(options):
    full = Full(options)
    full.weights[:] = 1.0
    full.rows, full.side = full._equations()
    network, rays = full.network, full.network.rays
    normals = normals_of(network, full.pattern, full.lin, full.weights, damping=0.0)
    precision = precision_of(network, full.pattern, full.lin, normals)
    state, _ = initial_state(network)
    fit = Fit(state, full.lin, np.ones(len(rays.photo), dtype=bool), full.weights)
    checked = 1 - np.sum(
        full.rows * np.linalg.solve(full.rows.T @ full.rows, full.rows.T).T, axis=1
    )
    classes = classes_of(network, fit, precision)
    control = np.repeat(rays.measurement >= 0, 2)
    image = checked[: 2 * len(rays.photo)]
    assert classes["tie"].redundancy == pytest.approx(image[~control].sum())
    assert classes["control_image"].redundancy == pytest.approx(image[control].sum())
    ground = checked[len(image) : len(image) + 3 * len(network.points.control)].reshape(-1, 3)
    assert classes["control_plan"].redundancy == pytest.approx(ground[:, :2].sum())
    assert classes["control_height"].redundancy == pytest.approx(ground[:, 2].sum())
    photos = len(image) + ground.size
    flown = checked[photos : photos + 6 * len(network.photos)].reshape(-1, 2)
    assert classes["centre"].redundancy == pytest.approx(flown[:, 0].sum())
    assert classes["angles"].redundancy == pytest.approx(flown[:, 1].sum())
    # All redundancies together are observations less unknowns.
    assert checked.sum() == pytest.approx(len(full.rows) - full.rows.shape[1])


def test_two_cameras_share_one_border__law():
    """Photos of two cameras: the corner holds both, and the gradient vanishes at the solution."""
    block = fly(PLAN, np.random.default_rng(5)).block
    second = replace(block.cameras["wide"], name="second")
    photos = {
        name: replace(photo, camera="second" if name.startswith("01") else "wide")
        for name, photo in block.photos.items()
    }
    block = replace(block, photos=photos, cameras={"wide": block.cameras["wide"], "second": second})
    network = network_of(block, AdjustmentOptions())
    state, placed = initial_state(network)
    pattern, weights = pattern_of(network), placed.astype(np.float64)
    for _ in range(6):
        lin = linearise(network, state)
        step = solve(network, pattern, normals_of(network, pattern, lin, weights, damping=0.0))
        state = state.moved(step.photos, step.constants, step.positioning, step.shifts, step.points)
    assert step.decrement < 1e-9
    assert network.shared == 10
    assert not np.allclose(state.constants[0, :3], state.constants[1, :3], atol=1e-4)
