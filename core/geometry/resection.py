"""Resection: the exterior orientation of one photo from known points, most of them perhaps wrong.

The hypotheses and their judgement are those of `core.geometry.consensus`; the best of them are
refined with the full model of collinearity.
"""

from dataclasses import dataclass

import numpy as np

from core.arrays import Indices, Matrix, ObjectPoints, PixelPoints
from core.doubts import Failure
from core.geometry.camera import Camera
from core.geometry.collinearity import (
    Atmosphere,
    film_from_object,
    film_partials,
    increments_by_angles,
)
from core.geometry.consensus import SAMPLE, Candidates, Consensus, ConsensusOptions, Step
from core.geometry.exterior import ExteriorOrientation
from core.geometry.interior import InteriorOrientation
from core.said import say

# design: the linear model ranks the best nearly right; three leave room for a change of order.
FULL = 3
"""So many of the best refined by the linear model are refined by the full one, which is slow."""


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
        film = film_partials(points, exterior, self.camera, self.atmosphere)
        pixels = self.interior.pixel_from_film(film.film.T)
        by_angles = increments_by_angles(exterior.object_from_image[None])[0]
        by_rotation = np.einsum("fwn,wa->fan", film.by_rotation, by_angles)
        design = np.moveaxis(np.concatenate([film.by_centre, by_rotation], axis=1), 2, 0)
        return pixels, np.linalg.solve(self.interior.film_by_pixel(pixels), design)


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
    log10_e_value: float
    """How many times likelier than chance the agreement is (e-value), log10."""


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
    *,
    candidates: Candidates,
    options: ConsensusOptions,
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
    known = np.unique(candidates.point[candidates.weight > 0])
    if len(known) < SAMPLE + 2:
        return Failure(
            say("only {count} known points have a candidate in this photo", count=len(known))
        )
    search = Search(model, start, prior_covariance, points, candidates, options)
    steps = search.consensus.hypotheses(rng)
    linear = sorted((search.consensus.refined(step) for step in steps), key=lambda found: found[0])
    best = min((search.refined(found[1]) for found in linear[:FULL]), key=lambda found: found[0])
    return search.judged(best[1])


class Search:
    """One run of the search: the photo, its candidates, and the prior."""

    def __init__(
        self,
        model: PhotoModel,
        start: ExteriorOrientation,
        prior_covariance: Matrix,
        points: ObjectPoints,
        candidates: Candidates,
        options: ConsensusOptions,
    ) -> None:
        self.model, self.start, self.points = model, start, points
        self.candidates, self.options = candidates, options
        pixels, derivatives = model.linearised(points, start)
        self.consensus = Consensus(
            candidates,
            candidates.pixels - pixels[candidates.point],
            derivatives[candidates.point],
            prior_covariance,
            options=options,
        )

    def refined(self, step: Step) -> tuple[float, ExteriorOrientation]:
        """Local optimisation by the full model: choose, solve, choose again."""
        exterior = moved(self.start, step)
        cost = np.inf
        for _ in range(8):
            chosen, residual, cost = self.agreeing(exterior)
            if len(chosen) < SAMPLE:
                break
            exterior = self.solved(exterior, chosen, residual)[0]
        return cost, exterior

    def agreeing(self, exterior: ExteriorOrientation) -> tuple[Indices, PixelPoints, float]:
        """Candidates that agree, their residuals (computed minus measured), and the cost."""
        pixels = self.model.pixels(self.points, exterior)
        residual = pixels[self.candidates.point] - self.candidates.pixels
        chosen, cost = self.consensus.agreeing(residual)
        change = difference(exterior, self.start)
        return (
            chosen,
            residual[chosen],
            cost + float(change @ self.consensus.prior_information @ change),
        )

    def solved(
        self, exterior: ExteriorOrientation, chosen: Indices, residual: PixelPoints
    ) -> tuple[ExteriorOrientation, Matrix]:
        """One Gauss-Newton step with the chosen candidates, and the covariance."""
        seen = self.points[self.candidates.point[chosen]]
        derivatives = self.model.linearised(seen, exterior)[1]
        change = difference(exterior, self.start)
        step, covariance = self.consensus.solved(chosen, -residual, derivatives, change)
        return moved(exterior, step), covariance

    def judged(self, exterior: ExteriorOrientation) -> Resection | Failure:
        """Accept the orientation only when its agreement could not be chance."""
        chosen, residual, _ = self.agreeing(exterior)
        count = len(self.consensus.first)
        if len(chosen) <= SAMPLE:
            return Failure(
                say("no orientation agrees with more than {count} points", count=len(chosen))
            )
        e_value = self.log10_e_value(exterior)
        evidence = {
            "points": count,
            "agreeing": len(chosen),
            "log10_e_value": round(e_value, 2),
        }
        if e_value < self.options.least_log10_e_value:
            return Failure(
                say(
                    "{count} of {all} points agree, which chance alone could bring about",
                    count=len(chosen),
                    all=count,
                ),
                evidence,
            )
        covariance = self.solved(exterior, chosen, residual)[1]
        return Resection(exterior, covariance, chosen, residual, e_value)

    def log10_e_value(self, exterior: ExteriorOrientation) -> float:
        """E-value of an orientation, log10."""
        pixels, derivatives = self.model.linearised(self.points, exterior)
        point = self.candidates.point
        residual = self.candidates.pixels - pixels[point]
        change = difference(exterior, self.start)
        return self.consensus.log10_e_value(residual, derivatives[point], change)


def difference(exterior: ExteriorOrientation, start: ExteriorOrientation) -> Step:
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
