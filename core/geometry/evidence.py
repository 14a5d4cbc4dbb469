"""Whether an agreement could be chance: the candidates weighed against the room they had.

Were all candidates chance, each would lie anywhere in the window that was searched for its point.
Were the model true, a share w of the points would have one where the model says, to its standard
deviation. The ratio of the two likelihoods, averaged over the prior of the model and over w, is the
Bayes factor, an e-value: in pure chance its mean is one, so that it reaches 1000 in at most one of
1000 photos, whatever the number of hypotheses that were tried (Ville 1939; Gruenwald et al. 2024,
"Safe testing"). It is no number of false alarms: that one is counted from binomial chances, as for
relative orientation in `core.geometry.relative`. The prior volume counts as what it is:
a photo that is known to tens of metres has less room for chance than one that may lie anywhere.

The average over the prior is taken by Laplace's approximation about the best step: the volume of
what the candidates allow, divided by that of the prior.
"""

import numpy as np
from jaxtyping import Bool, Float64, Int
from scipy.special import logsumexp

from core.arrays import Flags, Matrix, PixelPoints, Scalars

Design = Float64[np.ndarray, "candidates 2 unknowns"]
"""Derivatives of the place of each candidate by the unknowns."""
Step = Float64[np.ndarray, "unknowns"]
"""One value of the unknowns."""
Starts = Int[np.ndarray, "points"]
"""Index of the first candidate of each point."""
OfPoints = Bool[np.ndarray, "points"]
"""True or false for each point."""
# design: doubled each time, from one right point in twenty to nearly all.
SHARES = (0.05, 0.1, 0.2, 0.4, 0.8)
"""w: shares of points found in their right place, one as likely as the other beforehand."""
# design: from a refined start one step is enough.
STEPS = 3
"""Steps towards the best place under each share, from one that is nearly there."""


class Evidence:
    """Candidates of many points beside what chance and truth would make of them."""

    def __init__(
        self,
        first: Starts,
        weight: Scalars,
        sigma_px: Scalars,
        chance: Scalars,
        telling: OfPoints,
        limit: float,
    ) -> None:
        """Take the candidates in, sorted by point.

        Args:
            first: Index of the first candidate of each point.
            weight: Relative likelihood of each candidate to be the right one of its point.
            sigma_px: Standard deviation per axis of each candidate.
            chance: 1 / the area that was searched for its point, per square pixel.
            telling: For each point, whether it could fail to agree at all.
            limit: A candidate counts up to this normalised squared distance.
        """
        self.first, self.telling, self.limit = first, telling, limit
        self.count = np.diff(np.append(first, len(sigma_px)))
        share = weight / np.repeat(np.add.reduceat(weight, first), self.count)
        density = share / (2 * np.pi * sigma_px**2 * chance)
        self.density = np.where(np.repeat(telling, self.count), density, 0.0)
        self.precision = 1 / sigma_px**2

    def log10_e_value(
        self, residual: PixelPoints, design: Design, at: Step, prior_information: Matrix
    ) -> float:
        """Bayes factor of the model against chance, log10.

        Args:
            residual: Measured minus computed of every candidate, pixels.
            design: Derivatives where that was computed.
            at: Unknowns there, relative to the mean of the prior.
            prior_information: Inverse covariance of the unknowns beforehand.
        """
        usable = np.isfinite(residual).all(axis=1) & np.isfinite(design).all(axis=(1, 2))
        near = usable & (np.sum(residual**2, axis=1) * self.precision < 4 * self.limit)
        if not near.any():
            return self.of_nothing()
        parts = [
            self.of_share(share, near, residual, design, at, prior_information) for share in SHARES
        ]
        return float(logsumexp(parts) - np.log(len(SHARES))) / float(np.log(10))

    def of_nothing(self) -> float:
        """The factor where no candidate is near."""
        parts = [float(self.telling.sum()) * np.log1p(-share) for share in SHARES]
        return float(logsumexp(parts) - np.log(len(SHARES))) / float(np.log(10))

    def of_share(
        self,
        share: float,
        near: Flags,
        residual: PixelPoints,
        design: Design,
        at: Step,
        prior: Matrix,
    ) -> float:
        """Natural logarithm of the factor under one share w."""
        point = np.repeat(np.arange(len(self.first)), self.count)[near]
        precision, density = self.precision[near], self.density[near]
        residual, design = residual[near], design[near]
        step, best = np.zeros(len(at)), -np.inf
        for _ in range(STEPS):
            off = residual - design @ step
            squared = np.sum(off**2, axis=1) * precision
            right = share * density * np.exp(-0.5 * squared) * (squared < self.limit)
            total = np.bincount(point, weights=right, minlength=len(self.first))
            ratio = np.where(self.telling, 1.0 - share + total, 1.0)
            voice = right / ratio[point] * precision
            normal = np.einsum("nai,n,naj->ij", design, voice, design) + prior
            now = at + step
            volume = np.linalg.slogdet(normal)[1] - np.linalg.slogdet(prior)[1]
            found = float(np.sum(np.log(ratio)) - 0.5 * now @ prior @ now - 0.5 * volume)
            best = max(best, found)
            right_side = np.einsum("nai,n,na->i", design, voice, off) - prior @ now
            step = step + np.linalg.solve(normal, right_side)
        return best
