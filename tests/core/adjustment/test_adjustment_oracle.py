"""The adjustment against SciPy's least squares on the same equations, written down anew."""

from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block
from core.block import Block
from core.geometry.collinearity import film_from_object
from core.geometry.exterior import ExteriorOrientation
from tests.flights import FlightPlan, fly

SMALL = FlightPlan(strips=1, photos_per_strip=3, ties=25, control=6, check=0)


def test_scipy_finds_the_same_optimum__oracle():
    flight = fly(SMALL, np.random.default_rng(2))
    block = flight.block
    report = adjust_block(block, AdjustmentOptions(robust=False))
    problem = _Problem(block)
    start = problem.parameters(report)
    # From a place some sigmas away.
    away = start + np.random.default_rng(1).normal(size=len(start)) * problem.scale * 20
    found = least_squares(
        problem.residuals, away, x_scale=problem.scale, ftol=1e-15, xtol=1e-15, gtol=1e-15
    )
    ours = float(np.sum(problem.residuals(start) ** 2))
    assert ours <= 2 * found.cost * (1 + 1e-9)
    # 1/1000 of a metre-sized sigma.
    for index, photo in enumerate(block.photos):
        theirs = found.x[6 * index : 6 * index + 3]
        np.testing.assert_allclose(
            report.block.photos[photo].exterior.centre, theirs, rtol=0, atol=2e-3
        )


class _Problem:
    """The same least squares problem through `film_from_object` and omega, phi, kappa."""

    def __init__(self, block: Block) -> None:
        self.block, self.names = block, list(block.photos)
        counts = np.bincount(block.ties.point, minlength=block.ties.count)
        self.ties = np.flatnonzero(counts >= 2)
        self.control = sorted({key[0] for key in block.measurements})
        points = len(self.ties) + len(self.control)
        photos = np.tile([1.0, 1.0, 1.0, 1e-4, 1e-4, 1e-4], len(self.names))
        camera = [0.05, 0.1, 0.1, 3e-8, 2e-12]
        self.scale = np.concatenate([photos, camera, np.ones(3 * points)])

    def parameters(self, report):
        rows = []
        for name in self.names:
            exterior = report.block.photos[name].exterior
            rows += [*exterior.centre, exterior.omega, exterior.phi, exterior.kappa]
        camera = report.block.cameras["wide"]
        rows += [camera.principal_distance_mm, *camera.principal_point_mm]
        rows += camera.radial_distortion[:2]
        rows += report.tie_positions[self.ties].ravel().tolist()
        for name in self.control:
            rows += report.surveyed_positions[name].tolist()
        return np.array(rows)

    def residuals(self, values):
        block, photos = self.block, len(self.names)
        known = block.cameras["wide"]
        c, x0, y0, k1, k2 = (float(value) for value in values[6 * photos : 6 * photos + 5])
        camera = replace(
            known,
            principal_distance_mm=c,
            principal_point_mm=(x0, y0),
            radial_distortion=(k1, k2, 0.0),
        )
        points = values[6 * photos + 5 :].reshape(-1, 3)
        exteriors = {
            name: ExteriorOrientation(row[:3], *(float(angle) for angle in row[3:]))
            for name, row in zip(self.names, values[: 6 * photos].reshape(-1, 6), strict=True)
        }
        out = [self._priors(exteriors, camera, known)]
        for name, exterior in exteriors.items():
            photo = block.photos[name]
            pixels, sigma, which = self._measured(name)
            film = film_from_object(points[which], exterior, camera, photo.atmosphere)
            off = film - photo.interior.film_from_pixel(pixels)
            out.append((off / (sigma[:, None] * photo.interior.pixel_size_mm)).ravel())
        first = len(self.ties)
        for index, name in enumerate(self.control):
            survey = block.surveyed[name]
            out.append((points[first + index] - survey.position) / survey.sigma_m)
        return np.concatenate(out)

    def _priors(self, exteriors, camera, known):
        corner = 90 * np.sqrt(2)
        out = [
            (camera.principal_distance_mm - known.principal_distance_mm) / 0.05,
            *((np.array(camera.principal_point_mm) - known.principal_point_mm) / 0.1),
            (camera.radial_distortion[0] - known.radial_distortion[0]) * corner**3 / 0.05,
            (camera.radial_distortion[1] - known.radial_distortion[1]) * corner**5 / 0.05,
        ]
        for name, exterior in exteriors.items():
            photo = self.block.photos[name]
            first = photo.approximate
            out += list((exterior.centre - first.centre) / photo.prior.sigma_centre_m)
            for axis, angle in enumerate(("omega", "phi", "kappa")):
                turn = getattr(exterior, angle) - getattr(first, angle)
                turn = np.remainder(turn + np.pi, 2 * np.pi) - np.pi
                out.append(turn / photo.prior.sigma_angles[axis])
        return np.array(out)

    def _measured(self, name):
        ties, index = self.block.ties, self.names.index(name)
        rows = np.flatnonzero((ties.photo == index) & np.isin(ties.point, self.ties))
        control = [m for m in self.block.measurements.values() if m.photo_id == name]
        pixels = np.concatenate(
            [ties.pixels[rows], np.array([(m.column, m.row) for m in control]).reshape(-1, 2)]
        )
        sigma = np.append(ties.sigma_px[rows], [m.sigma_px for m in control])
        first = len(self.ties)
        which = np.append(
            np.searchsorted(self.ties, ties.point[rows]),
            [first + self.control.index(m.point_id) for m in control],
        )
        return pixels, sigma, which.astype(np.int64)
