"""Resection: the exterior orientation of one photo from known points, most of them perhaps wrong.

Candidates are many per point and mostly wrong; hypotheses come from three points and the prior
together, are scored by MSAC with one candidate a point, refined, and accepted only when so many
agreeing candidates could not be chance (a-contrario, METHODS 5).
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaln

from core.arrays import Indices, Matrix, ObjectPoints, PixelPoints, Scalars
from core.doubts import Failure
from core.geometry.atmosphere import Atmosphere
from core.geometry.camera import Camera
from core.geometry.collinearity import film_from_object
from core.geometry.exterior import ExteriorOrientation
from core.geometry.interior import InteriorOrientation

SAMPLE = 3
STEPS = np.array([0.1, 0.1, 0.1, 1e-5, 1e-5, 1e-5])
"""Steps of the numerical derivative: metres and radians."""


@dataclass(frozen=True, slots=True, eq=False)
class PhotoModel:
    """All of a photo that stays fixed while its exterior orientation is sought."""

    interior: InteriorOrientation
    """Pixel <-> film."""
    camera: Camera
    """Camera constants."""
    atmosphere: Atmosphere
    """Refraction and curvature."""

    def pixels(self, points: ObjectPoints, exterior: ExteriorOrientation) -> PixelPoints:
        """Scan pixels of object points."""
        film = film_from_object(points, exterior, self.camera, self.atmosphere)
        return self.interior.pixel_from_film(film)

    def linearised(
        self, points: ObjectPoints, exterior: ExteriorOrientation
    ) -> tuple[PixelPoints, np.ndarray]:
        """Pixels and their derivatives (n, 2, 6) by X, Y, Z, omega, phi, kappa."""
        derivatives = np.empty((len(points), 2, 6))
        for column in range(6):
            step = np.zeros(6)
            step[column] = STEPS[column]
            ahead = self.pixels(points, moved(exterior, step))
            behind = self.pixels(points, moved(exterior, -step))
            derivatives[:, :, column] = (ahead - behind) / (2 * STEPS[column])
        return self.pixels(points, exterior), derivatives


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """Places in one photo where known points may lie; sorted by point."""

    point: Indices
    """Index of the known point of each candidate, ascending."""
    pixels: PixelPoints
    """Where it may lie."""
    sigma_px: Scalars
    """Standard deviation per axis, its point's ground uncertainty included, pixels."""
    weight: Scalars
    """Relative chance to be drawn into a sample."""
    trust: Scalars
    """Share of a full vote that its agreement counts for, 0 to 1."""
    chance: Scalars
    """For each candidate, 1 / the area that was searched for its point, per square pixel."""


@dataclass(frozen=True, slots=True)
class ResectionOptions:
    """How the hypotheses are made and judged."""

    hypotheses: int = 3000
    """Samples of three points."""
    gate: float = 3.0
    """A candidate agrees within this many standard deviations per axis."""
    log10_nfa_limit: float = -3.0
    """Accepted when fewer false alarms than 10 to this power are expected from chance."""
    refined: int = 12
    """Best hypotheses that are refined."""


@dataclass(frozen=True, slots=True, eq=False)
class Resection:
    """An exterior orientation that stands."""

    exterior: ExteriorOrientation
    """The orientation."""
    covariance: Matrix
    """6 x 6 of X, Y, Z (m), omega, phi, kappa (rad)."""
    chosen: Indices
    """Indices of the candidates that agree, at most one a point."""
    residuals_px: PixelPoints
    """Computed minus measured of the chosen, pixels."""
    log10_nfa: float
    """Expected number of false alarms, as a power of ten."""


def moved(exterior: ExteriorOrientation, step: np.ndarray) -> ExteriorOrientation:
    """An orientation changed by dX, dY, dZ, domega, dphi, dkappa."""
    return ExteriorOrientation(
        exterior.centre + step[:3],
        exterior.omega + float(step[3]),
        exterior.phi + float(step[4]),
        exterior.kappa + float(step[5]),
    )


def resect_photo(
    model: PhotoModel,
    start: ExteriorOrientation,
    prior_covariance: Matrix,
    points: ObjectPoints,
    candidates: Candidates,
    options: ResectionOptions,
    rng: np.random.Generator,
) -> Resection | Failure:
    """Exterior orientation from candidate measurements of known points and a Gaussian prior.

    Args:
        model: Interior orientation, camera, atmosphere.
        start: Mean of the prior; the model is linearised about it for the hypotheses.
        prior_covariance: 6 x 6 of X, Y, Z (m), omega, phi, kappa (rad).
        points: Known points, metres.
        candidates: Where they may lie.
        options: Limits.
        rng: Source of the samples.

    Returns:
        The orientation with its agreeing candidates, or why none stands.
    """
    known = np.unique(candidates.point)
    if len(known) < SAMPLE + 2:
        return Failure(f"only {len(known)} known points have a candidate in this photo")
    search = Search(model, start, prior_covariance, points, candidates, options)
    steps = search.best_of(search.sampled(rng))
    best = min((search.refined(step) for step in steps), key=lambda found: found[0])
    return search.judged(best[1])


class Search:
    """One run of the search: the linearised photo, its candidates, and the prior."""

    def __init__(
        self,
        model: PhotoModel,
        start: ExteriorOrientation,
        prior_covariance: Matrix,
        points: ObjectPoints,
        candidates: Candidates,
        options: ResectionOptions,
    ) -> None:
        self.model, self.start, self.points = model, start, points
        self.candidates, self.options = candidates, options
        self.prior_information = np.linalg.inv(prior_covariance)
        self.first = np.unique(candidates.point, return_index=True)[1]
        pixels, derivatives = model.linearised(points, start)
        self.offset = candidates.pixels - pixels[candidates.point]
        self.design = derivatives[candidates.point]

    def sampled(self, rng: np.random.Generator) -> Matrix:
        """Orientation steps (hypotheses, 6), each from three candidates and the prior."""
        weight = self.candidates.weight / self.candidates.weight.sum()
        drawn = rng.choice(len(weight), size=(self.options.hypotheses, SAMPLE), p=weight)
        point = self.candidates.point[drawn]
        distinct = (
            (point[:, 0] != point[:, 1])
            & (point[:, 0] != point[:, 2])
            & (point[:, 1] != point[:, 2])
        )
        drawn = drawn[distinct]
        weight_px = 1 / self.candidates.sigma_px[drawn] ** 2
        design = self.design[drawn]
        normal = np.einsum("hsai,hs,hsaj->hij", design, weight_px, design)
        right = np.einsum("hsai,hs,hsa->hi", design, weight_px, self.offset[drawn])
        return np.linalg.solve(normal + self.prior_information, right[:, :, None])[:, :, 0]

    def best_of(self, steps: Matrix) -> Matrix:
        """The hypotheses of least MSAC cost, best first, with the prior itself among them."""
        steps = np.vstack([np.zeros((1, 6)), steps])
        costs = np.concatenate(
            [self.cost(part) for part in np.array_split(steps, len(steps) // 250 + 1)]
        )
        return steps[np.argsort(costs, kind="stable")[: self.options.refined]]

    def cost(self, steps: Matrix) -> Scalars:
        """MSAC cost of each hypothesis: one candidate a point, truncated, plus the prior."""
        residual = self.offset - np.einsum("cai,hi->hca", self.design, steps)
        squared = np.sum(residual**2, axis=2) / self.candidates.sigma_px**2
        limit = 2 * self.options.gate**2
        missed = limit - self.candidates.trust * np.maximum(limit - squared, 0)
        per_point = np.minimum.reduceat(missed, self.first, axis=1)
        prior = np.einsum("hi,ij,hj->h", steps, self.prior_information, steps)
        return per_point.sum(axis=1) + prior

    def refined(self, step: np.ndarray) -> tuple[float, ExteriorOrientation]:
        """Local optimisation: choose, solve by the full model, choose again."""
        exterior = moved(self.start, step)
        cost = np.inf
        for _ in range(8):
            chosen, residual, cost = self.agreeing(exterior)
            if len(chosen) < SAMPLE:
                break
            exterior = self.solved(exterior, chosen, residual)[0]
        return cost, exterior

    def agreeing(self, exterior: ExteriorOrientation) -> tuple[Indices, PixelPoints, float]:
        """Best candidate of each point where it lies within the gate, residuals, MSAC cost."""
        pixels = self.model.pixels(self.points, exterior)
        residual = pixels[self.candidates.point] - self.candidates.pixels
        squared = np.sum(residual**2, axis=1) / self.candidates.sigma_px**2
        squared = np.where(np.isfinite(squared), squared, np.inf)
        limit = 2 * self.options.gate**2
        missed = limit - self.candidates.trust * np.maximum(limit - squared, 0)
        best = best_per_point(missed, self.candidates.point)
        chosen = best[squared[best] < limit]
        change = difference(exterior, self.start)
        cost = missed[best].sum() + change @ self.prior_information @ change
        return chosen, residual[chosen], float(cost)

    def solved(
        self, exterior: ExteriorOrientation, chosen: Indices, residual: PixelPoints
    ) -> tuple[ExteriorOrientation, Matrix]:
        """One Gauss-Newton step with the chosen candidates, and the covariance."""
        _, derivatives = self.model.linearised(self.points[self.candidates.point[chosen]], exterior)
        weight = self.candidates.trust[chosen] / self.candidates.sigma_px[chosen] ** 2
        normal = np.einsum("nai,n,naj->ij", derivatives, weight, derivatives)
        right = -np.einsum("nai,n,na->i", derivatives, weight, residual)
        right -= self.prior_information @ difference(exterior, self.start)
        normal = normal + self.prior_information
        return moved(exterior, np.linalg.solve(normal, right)), np.linalg.inv(normal)

    def judged(self, exterior: ExteriorOrientation) -> Resection | Failure:
        """Accept the orientation only when its agreement could not be chance."""
        chosen, residual, _ = self.agreeing(exterior)
        count = len(self.first)
        if len(chosen) <= SAMPLE:
            return Failure(f"no orientation agrees with more than {len(chosen)} points")
        area = np.pi * 2 * (self.options.gate * self.candidates.sigma_px) ** 2
        share = np.minimum(np.add.reduceat(area * self.candidates.chance, self.first), 1.0)
        nfa = log10_false_alarms(count, len(chosen), float(np.exp(np.mean(np.log(share)))))
        evidence = {"points": count, "agreeing": len(chosen), "log10_nfa": round(nfa, 2)}
        if nfa > self.options.log10_nfa_limit:
            return Failure(
                f"{len(chosen)} of {count} points agree, which chance alone could bring about",
                evidence,
            )
        covariance = self.solved(exterior, chosen, residual)[1]
        return Resection(exterior, covariance, chosen, residual, nfa)


def best_per_point(cost: Scalars, point: Indices) -> Indices:
    """Index of the candidate of least cost of each point; candidates are sorted by point."""
    order = np.lexsort((cost, point))
    first = np.unique(point[order], return_index=True)[1]
    return order[first]


def difference(exterior: ExteriorOrientation, start: ExteriorOrientation) -> np.ndarray:
    """X, Y, Z, omega, phi, kappa of one orientation less another; kappa within half a turn."""
    turn = exterior.kappa - start.kappa
    turn = float(np.arctan2(np.sin(turn), np.cos(turn)))
    return np.array(
        [
            *(exterior.centre - start.centre),
            exterior.omega - start.omega,
            exterior.phi - start.phi,
            turn,
        ]
    )


def log10_false_alarms(count: int, agreeing: int, chance: float) -> float:
    """Expected orientations that this many of `count` points support by chance, log10.

    log NFA = log(N - m) + log C(N, k) + log C(k, m) + (k - m) log alpha, m = 3 points a sample
    (the a-contrario model of openMVG's robust estimator).
    """

    def log_choose(n: int, k: int) -> float:
        return float(gammaln(n + 1) - gammaln(k + 1) - gammaln(n - k + 1))

    natural = (
        np.log(max(count - SAMPLE, 1))
        + log_choose(count, agreeing)
        + log_choose(agreeing, SAMPLE)
        + (agreeing - SAMPLE) * np.log(max(chance, 1e-300))
    )
    return float(natural / np.log(10))
