"""How far a measurement of a known point is checked by all others."""

from collections import Counter

import numpy as np

from core.adjustment.adjusted import AdjustmentReport

# design: only an error of 13 standard deviations would be found (4.13 / sqrt 0.1, Baarda 1968).
UNCHECKED = 0.1
LEAST_SIGMA = 1e-6  # design: numerical safety.


def controllability(report: AdjustmentReport) -> dict[tuple[str, str], float]:
    """Share of an error in a measurement that would show up in its misfit, 0 to 1.

    The redundancy number of the measurement, and its share of that of the point's coordinates,
    which are observations too: of a point in one photo the coordinates take most of an error up.
    """
    scans = Counter(point_id for point_id, _ in report.redundancy_numbers)
    unit = max(report.unit, LEAST_SIGMA)
    found: dict[tuple[str, str], float] = {}
    for key, own in report.redundancy_numbers.items():
        after = report.surveyed_sigmas_m.get(key[0])
        point = report.block.surveyed.get(key[0])
        shared = 0.0
        if after is not None and point is not None:
            share = 1 - float(np.mean((after[:2] / unit / point.sigma_m[:2]) ** 2))
            shared = min(max(share, 0.0), 1.0) / scans[key[0]]
        found[key] = min(own + shared, 1.0)
    return found


def unchecked_control(report: AdjustmentReport) -> list[tuple[str, str]]:
    """Measurements of which too little of an error would show, the least checked first."""
    found = controllability(report)
    return sorted((key for key in found if is_unchecked(found[key])), key=found.__getitem__)


def is_unchecked(share: float | None) -> bool:
    """True where too little of an error would show; not where nothing is known of it."""
    return share is not None and share < UNCHECKED
