"""Figures of a mosaic from readings: one detail marked in it and in the reference.

All differences are product minus reference, easting and northing, metres. Names are those of the
report on the Czech orthophoto (tables 5 to 8): c the mean, m the root mean square about nought, m_p
both axes together.
"""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64
from scipy.special import chdtri, stdtr

from core.geometry.robust import robust_sigma
from core.quality.check_points import SPREAD_LEAST, TAILS
from core.quality.job_rules import USUAL_RULES, JobRules
from core.quality.rules import DOUBTFUL, POOR, SOUND, Finding

PlaneShifts = Float64[np.ndarray, "n 2"]
"""Product minus reference (easting, northing), metres."""
Pair = tuple[float, float]
"""A figure of the easting and one of the northing."""
# source: convention, one wrong alarm in twenty.
SIGNIFICANT = 0.05
"""A mean is not nought when chance brings it about less often than this."""
NOT_KNOWN = float("nan")


@dataclass(frozen=True, slots=True)
class Reading:
    """One observer's reading of one place."""

    place_id: str
    """The place."""
    observer: str
    """Who read it."""
    difference_m: Pair
    """Product minus reference, easting and northing, metres."""
    sigma_m: float = 0.0
    """Standard deviation per axis of a surveyed point, metres; 0 where the reference was read."""


@dataclass(frozen=True, slots=True)
class PlanFigures:
    """Differences in plan together; figures that so few cannot give are NaN."""

    count: int
    """Number of differences."""
    mean_m: Pair
    """c: mean difference, metres."""
    deviation_m: Pair
    """s: standard deviation about the mean, metres."""
    rms_m: Pair
    """m: root mean square about nought, metres."""
    rms_interval_m: tuple[Pair, Pair]
    """95 % interval of m of the easting and of the northing, metres."""
    chance: Pair
    """How often chance brings such a mean about where there is none (t-test)."""
    extreme_m: Pair
    """The largest difference of each axis with its sign, metres."""
    nmad_m: Pair
    """Normalised median absolute deviation about the median, metres."""
    m_p: float
    """Position error: both axes together, metres."""
    m_p_interval: Pair
    """Its 95 % interval, metres."""
    survey_m: float
    """RMS error of the survey in plan, both axes together, metres; 0 where the reference was read.
    """

    @property
    def circular_error_90(self) -> float:
        """CE90, metres."""
        return circular_error_90(self.m_p)

    @property
    def product_m(self) -> float:
        """RMSE_H of the product as ASPRS wants it: with the error of the survey, metres."""
        return float(np.hypot(self.m_p, self.survey_m))

    @property
    def thesis_mean_m(self) -> float:
        """Mean of both axes' m, which the thesis's table 7 prints instead of m_p, metres."""
        return thesis_mean_m(*self.rms_m)

    @property
    def shifted(self) -> tuple[bool, bool]:
        """Whether the mean of each axis is more than chance."""
        return self.chance[0] < SIGNIFICANT, self.chance[1] < SIGNIFICANT


@dataclass(frozen=True, slots=True)
class ObserverPair:
    """Two observers who read the same places: the differences of their readings."""

    first: str
    """One observer."""
    second: str
    """The other."""
    figures: PlanFigures
    """First minus second."""

    @property
    def observer_m(self) -> float:
        """RMS error of one reading in plan, both observers being alike, metres."""
        return self.figures.m_p / float(np.sqrt(2))


@dataclass(frozen=True, slots=True)
class ReadingFigures:
    """All that readings of one plan say."""

    planned: int
    """Places of the plan."""
    read: int
    """Places that somebody read."""
    unreadable: int
    """Places at which nobody could identify a detail."""
    doubled: int
    """Places read by two observers or more."""
    observer_part: float
    """Part of the observer's variance that the places keep, each being the mean of its readings."""
    together: PlanFigures
    """Every place once: the mean of its observers."""
    by_observer: Mapping[str, PlanFigures]
    """Every observer alone."""
    pairs: tuple[ObserverPair, ...]
    """Observers who read the same places."""

    @property
    def observer_m(self) -> float:
        """RMS error of one reading in plan, metres; NaN where nobody read a second time."""
        counts = np.array([pair.figures.count for pair in self.pairs])
        squares = np.array([pair.observer_m**2 for pair in self.pairs])
        known = counts.sum() > 0
        return float(np.sqrt((counts * squares).sum() / counts.sum())) if known else NOT_KNOWN

    @property
    def observer_share(self) -> float:
        """Share of the mean square difference that is the observer's; NaN where not known."""
        return min(1.0, self.observer_part * (self.observer_m / self.together.m_p) ** 2)

    def enough(self, rules: JobRules = USUAL_RULES) -> bool:
        """Whether they allow a statement."""
        return self.read >= rules.readings


@dataclass(frozen=True, slots=True)
class Foretold:
    """What was predicted of the differences, and whether the readings bear it out."""

    predicted_m: float
    """RMS in plan of orientation, observer and survey together, metres."""
    ratio: float
    """Observed m_p over it."""
    interval: Pair
    """Between these the ratio lies by chance in 95 of 100 mosaics as good as predicted."""

    @property
    def said(self) -> str:
        """`as-predicted`, `worse`, `better`, or `unknown`."""
        low, high = self.interval
        if not np.isfinite([self.ratio, low, high]).all():
            return "unknown"
        return "worse" if self.ratio > high else "better" if self.ratio < low else "as-predicted"


def reading_figures(
    readings: Sequence[Reading], planned: int, unreadable: int = 0
) -> ReadingFigures:
    """All figures of the readings of one plan.

    Args:
        readings: One for each place and observer.
        planned: Places of the plan.
        unreadable: Places at which nobody could identify a detail.
    """
    by_place: dict[str, list[Reading]] = defaultdict(list)
    by_observer: dict[str, list[Reading]] = defaultdict(list)
    for reading in readings:
        by_place[reading.place_id].append(reading)
        by_observer[reading.observer].append(reading)
    places = by_place.values()
    means = [np.mean([one.difference_m for one in several], axis=0) for several in places]
    sigmas = [several[0].sigma_m for several in places]
    return ReadingFigures(
        planned,
        len(by_place),
        unreadable,
        sum(len(several) > 1 for several in places),
        float(np.mean([1 / len(several) for several in places])) if places else NOT_KNOWN,
        plan_figures(np.array(means).reshape(-1, 2), sigmas),
        {who: _alone(by_observer[who]) for who in sorted(by_observer)},
        tuple(_pairs(by_observer)),
    )


def plan_figures(differences: PlaneShifts, sigmas_m: Sequence[float] = ()) -> PlanFigures:
    """Figures of differences in plan.

    Args:
        differences: Product minus reference, metres.
        sigmas_m: Standard deviation per axis of each surveyed point, metres; none where there are
            none.
    """
    count = len(differences)
    if not count:
        none = NOT_KNOWN, NOT_KNOWN
        return PlanFigures(
            0, none, none, none, (none, none), none, none, none, NOT_KNOWN, none, NOT_KNOWN
        )
    squares = np.mean(differences**2, axis=0)
    rms = np.sqrt(squares)
    mean = differences.mean(axis=0)
    deviation = differences.std(axis=0, ddof=1) if count > 1 else np.full(2, np.nan)
    extreme = differences[np.argmax(np.abs(differences), axis=0), [0, 1]]
    spread = differences - np.median(differences, axis=0)
    m_p = position_error_m(*rms.tolist())
    # source: Satterthwaite 1946: axes of unequal error are worth fewer than 2 n independent ones.
    freedom = count * float(squares.sum() ** 2 / max((squares**2).sum(), np.finfo(float).tiny))
    survey = np.array(sigmas_m) if len(sigmas_m) else np.zeros(1)
    return PlanFigures(
        count,
        _pair(mean),
        _pair(deviation),
        _pair(rms),
        (rms_interval(float(rms[0]), count), rms_interval(float(rms[1]), count)),
        _pair(np.array([_chance(axis) for axis in differences.T])),
        _pair(extreme),
        _pair(np.array([robust_sigma(axis) for axis in spread.T])),
        m_p,
        rms_interval(m_p, freedom) if m_p > 0 else (0.0, 0.0),
        float(np.sqrt(2 * np.mean(survey**2))),
    )


def compare_with_prediction(
    figures: ReadingFigures, orientation_m: float, reference_m: float, freedom: float
) -> Foretold:
    """Whether readings are as large as predicted.

    Where the reference was read, the mosaic follows it with its errors: only the orientation and
    the observer are in the differences. A surveyed point knows nothing of the reference: then the
    error of the reference and of the survey are in them. Readings share what the orientation is
    off, so that together they are worth fewer than 2 n independent errors (Satterthwaite 1946).

    Args:
        figures: The readings.
        orientation_m: RMS in plan of the block relative to the reference, metres.
        reference_m: RMS error of the reference in plan, metres.
        freedom: So many independent errors the orientation is worth at the places together.
    """
    together = figures.together
    parts = [together.survey_m, reference_m] if together.survey_m > 0 else []
    twice = bool(np.isfinite(figures.observer_m))
    if twice:
        parts.append(figures.observer_m * figures.observer_part**0.5)
    shared, own = orientation_m**2, float(np.sum(np.square(parts)))
    predicted = float(np.sqrt(shared + own))
    # Without a second reading the observer's share may be anything.
    if not together.count or not predicted > 0 or not twice:
        return Foretold(predicted, NOT_KNOWN, (NOT_KNOWN, NOT_KNOWN))
    # tr(C)^2 / tr(C^2) of the covariance of the orientation and of what each axis has of its own.
    squares = shared**2 / freedom + (shared + own / 2) * own / together.count
    freedom = (shared + own) ** 2 / squares
    low, high = np.sqrt(chdtri(freedom, TAILS) / freedom)
    return Foretold(predicted, together.m_p / predicted, (float(low), float(high)))


def position_error_m(m_x: float, m_y: float) -> float:
    """m_p of the root mean squares of both axes, metres."""
    return float(np.hypot(m_x, m_y))


def thesis_mean_m(m_x: float, m_y: float) -> float:
    """The mean of both axes that the thesis's table 7 calls "mean XY", metres."""
    return (m_x + m_y) / 2


def circular_error_90(m_p: float) -> float:
    """CE90: the radius that holds 90 % of normal errors alike in both coordinates.

    The length of such errors has the Rayleigh distribution 1 - exp(-r^2 / m_p^2), so the factor is
    the root of ln 10 = 1.5174. FGDC-STD-007.3-1998 rounds it to 1.5175 in its appendix 3-D.

    Args:
        m_p: Root of the mean squared length of the errors, of both coordinates together.
    """
    return float(m_p * np.sqrt(np.log(10)))


def rms_interval(rms: float, degrees_of_freedom: float) -> Pair:
    """95 % interval of a root mean square of so many independent normal errors."""
    low, high = chdtri(degrees_of_freedom, TAILS)
    return (
        float(rms * np.sqrt(degrees_of_freedom / high)),
        float(rms * np.sqrt(degrees_of_freedom / low)),
    )


def _alone(readings: Sequence[Reading]) -> PlanFigures:
    """Figures of one observer."""
    differences = np.array([one.difference_m for one in readings]).reshape(-1, 2)
    return plan_figures(differences, [one.sigma_m for one in readings])


def _pairs(by_observer: Mapping[str, Sequence[Reading]]) -> list[ObserverPair]:
    """Every two observers with places in common."""
    observers = sorted(by_observer)
    found: list[ObserverPair] = []
    for number, first in enumerate(observers):
        own = {one.place_id: one.difference_m for one in by_observer[first]}
        for second in observers[number + 1 :]:
            other = {one.place_id: one.difference_m for one in by_observer[second]}
            common = sorted(own.keys() & other.keys())
            if common:
                off = np.array([np.subtract(own[place], other[place]) for place in common])
                found.append(ObserverPair(first, second, plan_figures(off.reshape(-1, 2))))
    return found


def _chance(values: Float64[np.ndarray, "n"]) -> float:
    """How often chance brings about so large a mean (two-sided t-test); NaN of too few."""
    count = len(values)
    spread = float(values.std(ddof=1)) if count >= SPREAD_LEAST else 0.0
    if spread == 0:
        return NOT_KNOWN
    t = abs(float(values.mean())) / (spread / np.sqrt(count))
    return float(2 * stdtr(count - 1, -t))


def _pair(values: Float64[np.ndarray, "2"]) -> Pair:
    return float(values[0]), float(values[1])


def reading_findings(
    found: ReadingFigures,
    limit_m: float,
    foretold: Foretold | None = None,
    replaced: Sequence[ReadingFigures] = (),
    *,
    outdated: int = 0,
    late: bool = False,
    rules: JobRules = USUAL_RULES,
) -> Iterator[Finding]:
    """Whether enough was read, how good the mosaic is, and whether that was predicted.

    Args:
        found: The readings of the plan that is read now.
        limit_m: Position error on the ground up to which a block is released, metres.
        foretold: What was predicted; None where that is not known.
        replaced: What was read for earlier plans: whoever dislikes it may not plan anew.
        outdated: Readings of the plan in an earlier mosaic.
        late: Whether places were drawn after control had been searched.
        rules: Limits of the job.
    """
    told = {
        "read": str(found.read),
        "planned": str(found.planned),
        "least": str(rules.readings),
        "unreadable": str(found.unreadable),
    }
    if replaced:
        count = str(sum(figures.read for figures in replaced))
        yield Finding("read-replaced", DOUBTFUL, {**told, "count": count})
    for figures in replaced:
        if figures.together.m_p_interval[0] > limit_m:
            yield Finding("read-over-before", POOR, _accuracy(figures, limit_m))
    if late:
        yield Finding("read-late", DOUBTFUL, told)
    enough = found.enough(rules)
    if outdated:
        yield Finding("read-outdated", int(not enough), {**told, "count": str(outdated)})
    yield Finding("read" if enough else "read-few", int(not enough), told)
    if not found.read:
        return
    together = found.together
    low, high = together.m_p_interval
    kind, grave = ("read-within", SOUND) if high <= limit_m else ("read-unsure", DOUBTFUL)
    kind, grave = ("read-over", POOR) if low > limit_m else (kind, grave)
    yield Finding(kind, grave, _accuracy(found, limit_m))
    if np.isfinite(together.chance).any():
        shift = {"east": f"{together.mean_m[0]:+.2f}", "north": f"{together.mean_m[1]:+.2f}"}
        shifted = any(together.shifted)
        yield Finding("read-shifted" if shifted else "read-unshifted", int(shifted), shift)
    yield _by_a_second(found, rules)
    if foretold is not None and foretold.said != "unknown":
        yield _against_prediction(foretold)


def unplanned_findings(rules: JobRules = USUAL_RULES) -> tuple[Finding, ...]:
    """That no place of a mosaic was planned, where the job asks for readings."""
    asked = {"least": str(rules.readings)}
    return (Finding("read-unplanned", DOUBTFUL, asked),) if rules.readings else ()


def _accuracy(found: ReadingFigures, limit_m: float) -> dict[str, str]:
    """What is told of m_p."""
    low, high = found.together.m_p_interval
    return {
        "value": f"{found.together.m_p:.2f}",
        "low": f"{low:.2f}",
        "high": f"{high:.2f}",
        "limit": f"{limit_m:.2f}",
    }


def _by_a_second(found: ReadingFigures, rules: JobRules) -> Finding:
    """How much was read twice, and what it tells of the observers."""
    least = doubled_least(found.read, rules)
    second = {"doubled": str(found.doubled), "read": str(found.read), "least": str(least)}
    if found.doubled:
        second |= {
            "value": f"{found.observer_m:.2f}",
            "share": f"{100 * found.observer_share:.0f}",
        }
    kind = "second" if found.doubled >= least else "second-few"
    kind = kind if found.doubled or not least else "second-none"
    return Finding(kind, int(kind != "second"), second)


def doubled_least(read: int, rules: JobRules = USUAL_RULES) -> int:
    """How many of so many places a second observer should read at least."""
    return int(np.ceil(rules.second_readings_percent * read / 100))


def _against_prediction(foretold: Foretold) -> Finding:
    """Predicted against observed, in words."""
    told = {
        "predicted": f"{foretold.predicted_m:.2f}",
        "ratio": f"{foretold.ratio:.2f}",
        "low": f"{foretold.interval[0]:.2f}",
        "high": f"{foretold.interval[1]:.2f}",
    }
    grave = DOUBTFUL if foretold.said == "worse" else SOUND
    return Finding(f"read-{foretold.said}", grave, told)
