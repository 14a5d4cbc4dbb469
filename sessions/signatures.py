"""Who has vouched for a block, and whether what was judged still stands as it was judged."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from core.adjustment.adjusted import AdjustmentReport
from core.quality.readings import RULES
from sessions.checks import DIGEST_SIGNS
from sessions.decisions import (
    PlanChecks,
    ReadCheck,
    Recorded,
    SignBlock,
    Withdraw,
    changing,
    standing,
)
from sessions.products import digest_of

PARTS = ("decisions", "adjustment", "mosaic", "readings", "rules")
"""What a signature is about."""
PLACE_DIGITS, ANGLE_DIGITS, SIGMA_DIGITS = 4, 9, 6
"""An adjustment that is the same to a tenth of a millimetre is the same."""


@dataclass(frozen=True, slots=True)
class StandingSignature:
    """A signature that stands, and what has changed since."""

    recorded: Recorded
    """When and by whom."""
    said: SignBlock
    """The verdict."""
    changed: tuple[str, ...]
    """Parts that are no longer as they were judged; none: it holds."""

    @property
    def holds(self) -> bool:
        """Whether everything is as it was judged."""
        return not self.changed

    @property
    def digest(self) -> str:
        """One digest of all that was judged, to print beside the name."""
        return digest_of("judged", sorted(self.said.judged.items()))[:DIGEST_SIGNS]


def judged_parts(
    decisions: Sequence[Recorded], report: AdjustmentReport, mosaic: str
) -> Mapping[str, str]:
    """Digest of each part that a signature is about, as it is now.

    Args:
        decisions: Everything recorded.
        report: The adjustment.
        mosaic: Version of the mosaic; empty where there is none.
    """
    made = standing(changing(decisions))
    block = [item.decision_id for item in made if not isinstance(item.decision, Withdraw)]
    readings = [
        item.decision_id
        for item in standing(decisions)
        if isinstance(item.decision, PlanChecks | ReadCheck)
    ]
    values = block, _orientation_of(report), mosaic, readings, RULES
    return {
        name: digest_of(name, value)[:DIGEST_SIGNS]
        for name, value in zip(PARTS, values, strict=True)
    }


def standing_signatures(
    decisions: Sequence[Recorded], now: Mapping[str, str]
) -> tuple[StandingSignature, ...]:
    """The newest signature of every reviewer, the newest first.

    Args:
        decisions: Everything recorded.
        now: `judged_parts` as they are now.
    """
    newest = {
        item.who: (item, item.decision)
        for item in standing(decisions)
        if isinstance(item.decision, SignBlock)
    }
    found = [
        StandingSignature(item, said, tuple(p for p in PARTS if said.judged.get(p) != now.get(p)))
        for item, said in newest.values()
    ]
    return tuple(sorted(found, key=lambda one: -one.recorded.decision_id))


def _orientation_of(report: AdjustmentReport) -> list[object]:
    """What of an adjustment its orthos follow from."""
    photos = [
        (
            name,
            photo.oriented,
            np.round(photo.exterior.centre, PLACE_DIGITS),
            [
                round(angle, ANGLE_DIGITS)
                for angle in (photo.exterior.omega, photo.exterior.phi, photo.exterior.kappa)
            ],
        )
        for name, photo in sorted(report.block.photos.items())
    ]
    sigma = report.sigma_nought
    return [photos, round(sigma, SIGMA_DIGITS) if np.isfinite(sigma) else None]
