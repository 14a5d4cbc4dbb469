"""Reduced normal equations against the full ones, written down row by row."""

from dataclasses import replace

import numpy as np
import pytest

from core.block.adjusted import AdjustmentOptions
from core.block.linearised import linearise
from core.block.network import network_of
from core.block.reliability import precision_of
from core.block.solver import normals_of, pattern_of, solve
from core.block.start import initial_state
from tests.flights import FlightPlan, fly

PLAN = FlightPlan(strips=2, photos_per_strip=3, ties=40, control=8, check=0)


class Full:
    """All observation equations of a network as one dense matrix."""

    def __init__(self, estimate_cameras, seed=0):
        block = fly(PLAN, np.random.default_rng(seed)).block
        self.network = network_of(block, AdjustmentOptions(estimate_cameras=estimate_cameras))
        state, placed = initial_state(self.network)
        assert placed.all()
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
                if self.shared:
                    row[self.photos : self.photos + 5] = lin.by_camera[axis, :, ray]
                row[point : point + 3] = -lin.by_photo[axis, :3, ray]
                root = np.sqrt(self.weights[ray])
                rows.append(row * root)
                side.append(lin.residuals[axis, ray] * root)
        for point, axis in zip(*np.nonzero(network.points.known_weight), strict=True):
            row = np.zeros(size)
            column = self.photos + self.shared + 3 * point + axis
            row[column] = network.points.known_weight[point, axis]
            rows.append(row)
            side.append(lin.ground[point, axis])
        for photo in range(len(network.photos)):
            for axis in range(3):
                row, turn = np.zeros((2, size))
                row[6 * photo + axis] = network.priors.centre_weights[photo, axis]
                turn[6 * photo + 3 : 6 * photo + 6] = lin.angles_by_rotation[photo, axis]
                rows += [row, turn]
                side += [lin.centres[photo, axis], lin.angles[photo, axis]]
        for axis in range(self.shared):
            row = np.zeros(size)
            row[self.photos + axis] = network.priors.constant_weights[0, axis]
            rows.append(row)
            side.append(lin.constants[0, axis])
        return np.array(rows), np.array(side)


@pytest.mark.parametrize("estimate_cameras", [True, False])
@pytest.mark.parametrize("damping", [0.0, 0.1])
def test_reduced_normal_equations_give_the_full_solution__law(estimate_cameras, damping):
    full = Full(estimate_cameras)
    normal = full.rows.T @ full.rows
    normal[np.diag_indices(len(normal))] *= 1 + damping
    expected = -np.linalg.solve(normal, full.rows.T @ full.side)
    normals = normals_of(full.network, full.pattern, full.lin, full.weights, damping)
    step = solve(full.network, full.pattern, normals)
    scaled = (step.constants * full.network.scale).ravel()[: full.shared]
    ours = np.concatenate([step.photos.ravel(), scaled, step.points.ravel()])
    sigmas = np.sqrt(np.diag(np.linalg.inv(normal)))
    # In units of each unknown's own standard deviation.
    np.testing.assert_allclose(ours / sigmas, expected / sigmas, atol=1e-6)
    assert step.decrement == pytest.approx(expected @ normal @ expected, rel=1e-9)


@pytest.mark.parametrize("estimate_cameras", [True, False])
def test_cofactors_are_those_of_the_full_inverse__law(estimate_cameras):
    full = Full(estimate_cameras)
    inverse = np.linalg.inv(full.rows.T @ full.rows)
    normals = normals_of(full.network, full.pattern, full.lin, full.weights, 0.0)
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
        step = solve(network, pattern, normals_of(network, pattern, lin, weights, 0.0))
        state = state.moved(step.photos, step.constants, step.points)
    assert step.decrement < 1e-9
    assert network.shared == 10
    assert not np.allclose(state.constants[0, :3], state.constants[1, :3], atol=1e-4)
