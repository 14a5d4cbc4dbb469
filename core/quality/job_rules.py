"""The limits by which a block is judged: those of the standards, or those that a job sets itself.

Limits judge what an adjustment came to; none of them steers it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

# source: the authority of each rule: ASPRS Positional Accuracy Standards, edition 2 (2023); Czech
# instruction for the renewal of cadastral maps; national specifications for aerial survey; the
# practice of the Czech orthophoto (check points, two observers); ISO 2859, to which ISO 19157
# refers for samples of geographic data; and what Gruber itself promises.
ASPRS, INSTRUCTION, SURVEY, ORTHOPHOTO, SAMPLING, GRUBER = (
    "asprs",
    "instruction",
    "survey",
    "orthophoto",
    "sampling",
    "gruber",
)
AUTHORITIES: Mapping[str, str] = {
    ASPRS: "ASPRS Positional Accuracy Standards, edition 2 (2023)",
    INSTRUCTION: "Czech instruction for the renewal of cadastral maps",
    SURVEY: "national specifications for aerial survey (Czech Republic, 2003 to 2011)",
    ORTHOPHOTO: "practice of the Czech orthophoto",
    SAMPLING: "ISO 2859 (sampling by attributes), to which ISO 19157 refers",
    GRUBER: "Gruber",
}
"""Who asks a limit, in words."""


@dataclass(frozen=True, slots=True)
class Limit:
    """What one limit is about and what it may be set to."""

    words: str
    """What it limits."""
    unit: str
    """Unit in words."""
    low: float
    """Smallest value that makes sense."""
    high: float
    """Largest value that makes sense."""
    source: str
    """Who asks for the default: a key of `AUTHORITIES`."""


def _limit(default: float, words: str, unit: str, span: tuple[float, float], source: str) -> Any:
    return field(default=default, metadata={"limit": Limit(words, unit, *span, source)})


PARTS, PERCENT = (1, 9), (0, 100)  # source: definition.
TURN_DEG, SIGMAS, COUNTS = (0, 90), (0.01, 100), (0, 10_000)  # design: what makes sense.
RISK = (0, 50)  # source: definition; beyond, a coin decides better.
MOST_BASES, MOST_PER_MODEL = 1000, 100  # design: no rule asks for more.


@dataclass(frozen=True, slots=True)
class JobRules:
    """Every limit that a job may set, with the default of the standards.

    Names end in their unit; a share is in per cent, a count without a unit. What each limits stands
    beside its default, for the file of the job says it, too.
    """

    # design: what the report promises; on coarse scans what a pixel allows.
    position_m: float = _limit(
        0.8, "position error on the ground up to which a block is released", "metres",
        (0.01, 1000), GRUBER,
    )  # fmt: skip
    # design: what the coarsest of our scans allow.
    position_px: float = _limit(
        1.3, "the same in pixels of the scans; the larger of both counts", "pixels", (0, 100),
        GRUBER,
    )  # fmt: skip
    # source: ASPRS Positional Accuracy Standards, edition 2 (2023): fewer allow no statement.
    readings: int = _limit(
        30, "places of the mosaic that are read at least", "places", (1, 120), ASPRS
    )
    # design: of 30 places nine, whose scatter is then known to a third.
    second_readings_percent: float = _limit(
        30.0, "places that a second observer reads at least, of those read", "per cent", PERCENT,
        ORTHOPHOTO,
    )  # fmt: skip
    # source: ASPRS Positional Accuracy Standards, edition 2 (2023): fewer allow no statement.
    check_points: int = _limit(30, "independent check points at least", "points", (1, 120), ASPRS)
    # source: report on the Czech orthophoto, 1.1.2: ten per cent of the control proved enough.
    check_share_percent: float = _limit(
        10.0, "independent check points at least, of control points", "per cent", PERCENT,
        ORTHOPHOTO,
    )  # fmt: skip
    # design: a fifth off is what weights of a sound block are.
    sigma_nought_low: float = _limit(
        0.8, "sigma nought of a sound block at least", "no unit", SIGMAS, GRUBER
    )
    # design: as far off as below one.
    sigma_nought_high: float = _limit(
        1.2, "sigma nought of a sound block at most", "no unit", SIGMAS, GRUBER
    )
    # design: a half off, nothing that is predicted with them can be believed.
    sigma_nought_least: float = _limit(
        0.5, "sigma nought below which a block is not good enough", "no unit", SIGMAS, GRUBER
    )
    # design: as far off as below one.
    sigma_nought_most: float = _limit(
        1.5, "sigma nought above which a block is not good enough", "no unit", SIGMAS, GRUBER
    )
    # source: Czech instruction for the renewal of cadastral maps, as the manuals of aerial
    # triangulation tell it: points of a block, and of a strip.
    control_points: int = _limit(
        4, "control points of a block at least", "points", (3, COUNTS[1]), INSTRUCTION
    )
    strip_points: int = _limit(
        3, "control points that the photos of a strip show at least", "points", COUNTS, INSTRUCTION
    )
    # source: the same. Bases between neighbours along the block's edge.
    edge_plan_bases: float = _limit(
        3.0, "gap of control in plan along the block's edge at most", "bases", (0, MOST_BASES),
        INSTRUCTION,
    )  # fmt: skip
    edge_heights_bases: float = _limit(
        2.0, "gap of known heights along the block's edge at most", "bases", (0, MOST_BASES),
        INSTRUCTION,
    )  # fmt: skip
    # source: the same. Points inside the block.
    inside_plan: float = _limit(
        0.4, "control points inside the block at least", "points for each stereo model",
        (0, MOST_PER_MODEL), INSTRUCTION,
    )  # fmt: skip
    # source: the same.
    inside_heights: float = _limit(
        0.8, "known heights inside the block at least", "points for each stereo model",
        (0, MOST_PER_MODEL), INSTRUCTION,
    )  # fmt: skip
    # design: two thirds of the nine parts.
    control_parts: int = _limit(
        6, "parts of the block's nine that have control at least", "parts", PARTS, GRUBER
    )
    # design: two thirds of the nine areas.
    photo_parts: int = _limit(
        6, "areas of a photo's nine that have ties or control at least", "areas", PARTS, GRUBER
    )
    # design: at 60 % overlap half of a photo is seen three times.
    rays_percent: float = _limit(
        40.0, "tie points seen in three photos or more at least", "per cent", PERCENT, GRUBER
    )
    # source: national specifications for aerial survey: as a rule, and at most.
    tilt_deg: float = _limit(3.0, "tilt of a photo as a rule", "degrees", TURN_DEG, SURVEY)
    # source: the same.
    tilt_most_deg: float = _limit(4.5, "tilt of a photo at most", "degrees", TURN_DEG, SURVEY)
    # source: the same.
    crab_deg: float = _limit(5.0, "crab of a photo as a rule", "degrees", TURN_DEG, SURVEY)
    # source: the same.
    crab_most_deg: float = _limit(7.0, "crab of a photo at most", "degrees", TURN_DEG, SURVEY)
    # source: the same. Least overlap along and across the strips.
    along_percent: float = _limit(
        56.0, "overlap along the strips at least", "per cent", PERCENT, SURVEY
    )
    # source: the same.
    across_percent: float = _limit(
        20.0, "overlap between strips at least", "per cent", PERCENT, SURVEY
    )
    # source: the same (report on the Czech orthophoto, 1.1.1): 30 degrees above the horizon.
    sun_deg: float = _limit(
        30.0, "height of the sun above the horizon at least", "degrees", TURN_DEG, SURVEY
    )
    # source: ISO 2859-1, preferred acceptance quality limit; of a hundred sheets four.
    sheets_good_percent: float = _limit(
        4.0, "bad sheets of a lot that is still to be accepted", "per cent", PERCENT, SAMPLING
    )
    # source: ISO 2859-2, preferred limiting quality: five times the former, so that a sample of
    # some thirty sheets keeps both risks of any lot.
    sheets_bad_percent: float = _limit(
        20.0, "bad sheets from which a lot is to be rejected", "per cent", PERCENT, SAMPLING
    )
    # source: ISO 2859-1: a lot as good as asked for is accepted about 95 times in 100.
    producer_risk_percent: float = _limit(
        5.0, "lots to be accepted that a sample may reject", "per cent", RISK, SAMPLING
    )
    # source: ISO 2859-2: the consumer's risk is ten per cent as a rule.
    consumer_risk_percent: float = _limit(
        10.0, "lots to be rejected that a sample may accept", "per cent", RISK, SAMPLING
    )


LIMITS: Mapping[str, Limit] = {one.name: one.metadata["limit"] for one in fields(JobRules)}
"""What each limit is about, by its name."""
USUAL_RULES = JobRules()
"""The limits of the standards, where a job sets none."""
IN_ORDER = (
    ("sigma_nought_least", "sigma_nought_low"),
    ("sigma_nought_low", "sigma_nought_high"),
    ("sigma_nought_high", "sigma_nought_most"),
    ("tilt_deg", "tilt_most_deg"),
    ("crab_deg", "crab_most_deg"),
    ("sheets_good_percent", "sheets_bad_percent"),
)
"""Limits of which the first may not be larger than the second."""


def set_by_job(rules: JobRules) -> tuple[str, ...]:
    """Names of the limits that differ from those of the standards."""
    return tuple(name for name in LIMITS if getattr(rules, name) != getattr(USUAL_RULES, name))


def out_of_order(rules: JobRules) -> tuple[str, str] | None:
    """The first two limits that contradict each other; None where none do."""
    for low, high in IN_ORDER:
        if getattr(rules, low) > getattr(rules, high):
            return low, high
    return None
