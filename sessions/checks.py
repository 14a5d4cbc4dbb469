"""Plans of checks and their readings, as they stand in the session."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from core.quality.check_plan import CheckPlace
from sessions.decisions import PlanChecks, ReadCheck, Recorded, standing
from sessions.products import digest_of

DIGEST_SIGNS = 16
"""So much of a digest tells plans apart."""


@dataclass(frozen=True, slots=True)
class StandingPlan:
    """A plan that stands."""

    recorded: Recorded
    """When, by whom, and what it was recorded as."""
    plan: PlanChecks
    """The plan."""

    @property
    def unchanged(self) -> bool:
        """Whether the places are those that the digest was made of."""
        return digest_of_plan(self.plan) == self.plan.digest


def new_plan(
    places: Sequence[CheckPlace],
    cells: tuple[int, int],
    seed: int,
    source: str,
    *,
    beforehand: bool,
    decisions: Sequence[Recorded],
) -> PlanChecks:
    """A plan whose places bear its number, which no earlier plan of the session has.

    Args:
        places: What was drawn or listed.
        cells: Columns and rows of the grid; (0, 0) for a list.
        seed: What they were drawn with.
        source: Name of the list; empty without one.
        beforehand: Whether no control had been searched.
        decisions: Everything recorded, withdrawn plans included.
    """
    number = 1 + sum(isinstance(item.decision, PlanChecks) for item in decisions)
    named = tuple(replace(place, place_id=f"{number}-{place.place_id}") for place in places)
    plan = PlanChecks(named, cells, seed, source, beforehand, "")
    return replace(plan, digest=digest_of_plan(plan))


def digest_of_plan(plan: PlanChecks) -> str:
    """Digest of all that a plan says."""
    said = plan.places, plan.cells, plan.seed, plan.source, plan.beforehand
    return digest_of("check plan", *said)[:DIGEST_SIGNS]


def standing_plans(decisions: Sequence[Recorded]) -> tuple[StandingPlan, ...]:
    """Every plan that stands, in the order they were made; the last one is read now."""
    return tuple(
        StandingPlan(item, item.decision)
        for item in standing(decisions)
        if isinstance(item.decision, PlanChecks)
    )


def readings_of(
    decisions: Sequence[Recorded],
) -> Mapping[tuple[str, str], tuple[Recorded, ReadCheck]]:
    """The newest reading of every place by every observer, by (place, observer)."""
    return {
        (item.decision.place_id, item.who): (item, item.decision)
        for item in standing(decisions)
        if isinstance(item.decision, ReadCheck)
    }
