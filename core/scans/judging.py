"""When a measured mark stands: like the drawn one, like the others, and alike in both ways."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from core.doubts import Failure
from core.scans.measured_marks import FiducialMeasurement
from core.scans.measuring import TwoWays
from core.scans.set_chance import ConstellationOptions


@dataclass(frozen=True, slots=True)
class FiducialOptions:
    """When a measured mark stands."""

    max_disagreement_px: float = 0.5
    """Greatest distance between the matched and the second middle, pixels."""
    min_correlation: float = 0.55
    """Correlation with the drawn mark below which a place is no mark."""
    surely_mark: float = 0.9
    """Correlation from which a place where nothing was seen from afar is a mark."""
    max_drop: float = 0.25
    """How much less like the mark than the others a place may be before it is no mark."""
    max_spoilt: float = 4.0
    """How much more than the usual mark may differ from the drawn one before it is covered."""
    dirt_from: float = 1.2
    """How much more than the usual mark one differs from the drawn one by noise alone."""
    dirt_px: float = 0.1
    """What dirt that doubles the difference from the drawn mark does to its middle, pixels."""
    max_sigma_px: float = 0.5
    """Standard deviation beyond which a mark is not used, pixels."""
    unsure_px: float = 0.048
    """Standard deviation, in the direction in which a mark is least sure, from which one that
    stands is pointed out, pixels: 0.15 pixels are then not sure to 99.2 per cent, or to 99.8 where
    the other direction is surer."""
    sigma_floor_px: float = 0.006
    """No mark is believed better than this, pixels."""
    agree_mm: float = 1.5
    """How far corner marks and marks of the sides may disagree about each other's places."""
    search: ConstellationOptions = field(default_factory=ConstellationOptions)
    """How the marks are looked for."""


def spoilt_by(results: Mapping[str, TwoWays | Failure]) -> dict[str, float]:
    """How much more than in the clean ones is there besides the mark: dirt makes unsure."""
    left = {n: 1 - r.correlation**2 for n, r in results.items() if isinstance(r, TwoWays)}
    least = max(float(np.percentile(list(left.values()), 25)) if left else 1.0, 0.01)
    return {name: max(1.0, float(np.sqrt(max(value, 0.0) / least))) for name, value in left.items()}


def judged_marks(
    results: Mapping[str, TwoWays | Failure], options: FiducialOptions
) -> dict[str, TwoWays | Failure]:
    """Marks that are like the drawn mark, like the others, and alike in both ways."""
    likeness = [r.correlation for r in results.values() if isinstance(r, TwoWays)]
    usual = float(np.median(likeness)) if likeness else 0.0
    least = max(options.min_correlation, usual - options.max_drop)
    spoilt, most_apart = spoilt_by(results), options.max_disagreement_px
    judged: dict[str, TwoWays | Failure] = {}
    for name, result in results.items():
        judged[name] = result
        if isinstance(result, Failure):
            continue
        if result.correlation < least:
            judged[name] = Failure(
                f"What is there is not like the mark (correlation {result.correlation:.2f}).",
                {"correlation": result.correlation},
            )
        elif spoilt[name] > options.max_spoilt:
            judged[name] = Failure(
                "Something covers it: it is much less like the drawn mark than the others are "
                f"(correlation {result.correlation:.2f}).",
                {"correlation": result.correlation},
            )
        elif result.sigma_px > options.max_sigma_px:
            judged[name] = Failure(
                f"Its middle is only known to {result.sigma_px:.1f} pixels.",
                {"sigma_px": result.sigma_px},
            )
        elif (apart := max(result.disagreement_px, result.outline_px)) > most_apart:
            judged[name] = Failure(
                f"The ways to centre it differ by {apart:.2f} pixels.", {"disagreement_px": apart}
            )
    return judged


def measurement_of(
    name: str, result: TwoWays, spoilt: float, kind: str, options: FiducialOptions
) -> FiducialMeasurement:
    """The fiducial as it stands, what dirt does to it reckoned with.

    Args:
        name: Its name.
        result: Its middle by both ways.
        spoilt: How much more than the clean ones it differs from the drawn mark.
        kind: Shape of the mark.
        options: What dirt does.
    """
    floor = max(result.sigma_px, options.sigma_floor_px)
    dirt = max(spoilt - options.dirt_from, 0.0)
    sigma = float(np.hypot(floor, options.dirt_px * dirt))
    return FiducialMeasurement(
        name, result.column, result.row, sigma, result.correlation, result.disagreement_px, kind
    )


def unsure(mark: FiducialMeasurement, result: TwoWays, options: FiducialOptions) -> bool:
    """True for a mark that is pointed out though it stands.

    Args:
        mark: The mark.
        result: What it was measured by.
        options: From when on it is unsure.
    """
    return max(mark.sigma_px, result.worst_px) > options.unsure_px
