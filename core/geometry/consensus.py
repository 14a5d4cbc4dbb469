"""Consensus: a linear model that the most candidates agree with, though most of them are wrong.

Candidates are many per place and mostly wrong. Hypotheses come from few of them and a Gaussian
prior together, are scored by MSAC with one candidate a place, and an agreement is believed only
when its e-value is large: chance seldom brings such a one about.

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

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float64, Int
from scipy.special import logsumexp

from core.arrays import Flags, Indices, Matrix, PixelPoints, Scalars

Steps = Float64[np.ndarray, "hypotheses unknowns"]
"""Many values of the unknowns."""
Samples = Int[np.ndarray, "hypotheses sample"]
"""Indices of the candidates that each hypothesis comes from."""
Costs = Float64[np.ndarray, "hypotheses"]
"""One cost a hypothesis."""
Chosen = Int[np.ndarray, "chosen"]
"""Indices of candidates, at most one a point."""
# source: three points fix six unknowns.
SAMPLE = 3
# design: by definition of idle, see the words below.
IDLE = 0.5
"""A point whose gate covers this share of its search window agrees by chance as often as not:
whether it does says nothing."""
# design: larger than any scan.
NOWHERE_PX = 1e9
"""Offset of a candidate whose point has no predicted place: it never agrees."""
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


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """Places in a photo where known points may lie; sorted by point."""

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
    """For each candidate, 1 / the area in which a peak of its point may lie, per square pixel."""


@dataclass(frozen=True, slots=True)
class ConsensusOptions:
    """How the hypotheses are made and judged."""

    # design: a quarter of right ones gives 90 samples of three right ones.
    hypotheses: int = 6000
    """Samples of three points."""
    # design: one good candidate in 8,000 lies beyond.
    gate: float = 3.0
    """A candidate agrees within this many standard deviations per axis."""
    # design: one photo in a thousand by chance.
    least_log10_e_value: float = 3.0
    """Least e-value, log10: chance alone reaches it at most once in 10 to this power."""
    # design: the best of many are neighbours; a dozen hold several places.
    refined: int = 12
    """Best hypotheses that are refined."""


class Consensus:
    """One linear model and its candidates: what hypotheses there are and what they cost."""

    def __init__(
        self,
        candidates: Candidates,
        offset: PixelPoints,
        design: Design,
        prior_covariance: Matrix,
        *,
        options: ConsensusOptions,
    ) -> None:
        """Take the model in.

        Args:
            candidates: Where the points may lie.
            offset: Measured minus predicted place of each candidate, pixels.
            design: Derivatives of each candidate's predicted place by the unknowns.
            prior_covariance: Covariance of the unknowns beforehand, about nought.
            options: Limits.
        """
        self.candidates, self.options = candidates, options
        seen = np.isfinite(offset).all(axis=1) & np.isfinite(design).all(axis=(1, 2))
        placed = np.asarray(seen)
        self.offset = np.where(placed[:, None], offset, NOWHERE_PX)
        self.design = np.where(placed[:, None, None], design, 0.0)
        self.prior_information: Any = np.linalg.inv(prior_covariance)
        self.first = np.unique(candidates.point, return_index=True)[1]
        self.limit = 2 * options.gate**2

    def hypotheses(self, rng: np.random.Generator) -> Steps:
        """The best of many samples, best first, with the prior itself among them."""
        steps = np.vstack([np.zeros((1, self.design.shape[2])), self.sampled(rng)])
        parts = np.array_split(steps, len(steps) * len(self.offset) // 100_000 + 1)
        costs = np.concatenate([self.cost(part) for part in parts])
        return steps[np.argsort(costs, kind="stable")[: self.options.refined]]

    def sampled(self, rng: np.random.Generator) -> Steps:
        """Unknowns (hypotheses, unknowns), each from three candidates and the prior."""
        weight = self.candidates.weight / self.candidates.weight.sum()
        drawn = rng.choice(len(weight), size=(self.options.hypotheses, SAMPLE), p=weight)
        point = self.candidates.point[drawn]
        distinct: Flags = np.asarray(
            (point[:, 0] != point[:, 1])
            & (point[:, 0] != point[:, 2])
            & (point[:, 1] != point[:, 2])
        )
        return self.from_samples(drawn[distinct])

    def from_samples(self, drawn: Samples) -> Steps:
        """Unknowns (hypotheses, unknowns) from the candidates of each sample and the prior."""
        weight_px = 1 / self.candidates.sigma_px**2
        normals = np.einsum("cai,c,caj->cij", self.design, weight_px, self.design)
        rights = np.einsum("cai,c,ca->ci", self.design, weight_px, self.offset)
        normal, right = normals[drawn].sum(axis=1), rights[drawn].sum(axis=1)
        return np.linalg.solve(normal + self.prior_information, right[:, :, None])[:, :, 0]

    def cost(self, steps: Steps) -> Costs:
        """MSAC cost of each hypothesis: one candidate a point, truncated, plus the prior."""
        missed = self.missed(self.squared(steps))
        per_point = np.minimum.reduceat(missed, self.first, axis=1)
        prior = np.einsum("hi,ij,hj->h", steps, self.prior_information, steps)
        return per_point.sum(axis=1) + prior

    def squared(self, steps: Steps) -> Float64[np.ndarray, "hypotheses candidates"]:
        """Normalised squared distance of every candidate from every hypothesis."""
        unknowns = self.design.shape[2]
        residual = self.offset.reshape(-1) - steps @ self.design.reshape(-1, unknowns).T
        residual *= residual
        return (residual[:, ::2] + residual[:, 1::2]) / self.candidates.sigma_px**2

    def missed(self, squared: Any) -> Any:
        """What a candidate at a normalised squared distance costs."""
        return self.limit - self.candidates.trust * np.maximum(self.limit - squared, 0)

    def agreeing(self, residual: PixelPoints) -> tuple[Chosen, float]:
        """Best candidate of each point where it lies within the gate, and the cost of them all."""
        squared = np.sum(residual**2, axis=1) / self.candidates.sigma_px**2
        squared = np.where(np.isfinite(squared), squared, np.inf)
        missed = self.missed(squared)
        order = np.lexsort((missed, self.candidates.point))
        best = order[np.unique(self.candidates.point[order], return_index=True)[1]]
        return best[squared[best] < self.limit], float(missed[best].sum())

    def solved(
        self, chosen: Indices, residual: PixelPoints, design: Design, at: Step
    ) -> tuple[Step, Matrix]:
        """Step and covariance by least squares over the chosen candidates and the prior.

        Args:
            chosen: Indices of candidates.
            residual: Measured minus computed of the chosen, pixels.
            design: Derivatives of the chosen.
            at: Unknowns the residuals were computed with, relative to the prior's mean.
        """
        weight = self.candidates.trust[chosen] / self.candidates.sigma_px[chosen] ** 2
        normal = np.einsum("nai,n,naj->ij", design, weight, design) + self.prior_information
        right = np.einsum("nai,n,na->i", design, weight, residual) - self.prior_information @ at
        return np.linalg.solve(normal, right), np.linalg.inv(normal)

    def refined(self, step: Step) -> tuple[float, Step, Chosen]:
        """Local optimisation of the linear model: choose, solve, choose again."""
        chosen, cost = self.agreeing(self.offset - self.design @ step)
        for _ in range(8):
            if len(chosen) < SAMPLE:
                break
            residual = self.offset[chosen] - self.design[chosen] @ step
            step = step + self.solved(chosen, residual, self.design[chosen], step)[0]
            chosen, cost = self.agreeing(self.offset - self.design @ step)
        return cost + float(step @ self.prior_information @ step), step, chosen

    def log10_e_value(self, residual: PixelPoints, design: Design, at: Step) -> float:
        """E-value of an agreement, log10: the Bayes factor of `core.geometry.consensus`.

        A point whose gate fills its search window agrees wherever it lies, and is left out.

        Args:
            residual: Measured minus computed of every candidate, pixels.
            design: Derivatives where that was computed.
            at: Unknowns there, relative to the prior's mean.
        """
        known = self.candidates
        gate = np.pi * self.limit * known.sigma_px**2
        telling = np.add.reduceat(gate * known.chance, self.first) < IDLE
        evidence = Evidence(
            self.first,
            known.weight,
            known.sigma_px,
            known.chance,
            telling=telling,
            limit=self.limit,
        )
        return evidence.log10_e_value(residual, design, at, self.prior_information)


class Evidence:
    """Candidates of many points beside what chance and truth would make of them."""

    def __init__(
        self,
        first: Starts,
        weight: Scalars,
        sigma_px: Scalars,
        chance: Scalars,
        *,
        telling: OfPoints,
        limit: float,
    ) -> None:
        """Take the candidates in, sorted by point.

        Args:
            first: Index of the first candidate of each point.
            weight: Relative likelihood of each candidate to be the right one of its point.
            sigma_px: Standard deviation per axis of each candidate.
            chance: 1 / the area in which a peak of its point may lie, per square pixel.
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
            self.of_share(share, near, residual, design, at=at, prior=prior_information)
            for share in SHARES
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
        *,
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
