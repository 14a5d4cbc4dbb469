"""Faults seen in the mosaic, with what was answered, and free words about anything."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

from core.quality.rules import DOUBTFUL, SOUND, Finding
from sessions.decisions import Decision, Recorded, Remark, standing


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault that was marked, and every answer to it."""

    recorded: Recorded
    """When, by whom, and under which number."""
    said: Remark
    """What is wrong, and where."""
    answers: tuple[tuple[Recorded, Remark], ...]
    """What was said of it since, in order."""

    @property
    def turned(self) -> Recorded:
        """Who said last whether it is open: at first who marked it."""
        said = [item for item, one in self.answers if one.closes is not None]
        return said[-1] if said else self.recorded

    @property
    def is_open(self) -> bool:
        """False once the last answer that says so closed it."""
        return not (isinstance(self.turned.decision, Remark) and self.turned.decision.closes)

    @property
    def closing(self) -> Recorded | None:
        """The answer that closed it; None while it is open."""
        return None if self.is_open else self.turned

    @property
    def assigned(self) -> str:
        """Who is asked to mend it; empty where nobody is."""
        said = [one.assigned for one in (self.said, *(one for _, one in self.answers))]
        return next((who for who in reversed(said) if who), "")


def standing_remarks(decisions: Sequence[Recorded]) -> tuple[tuple[Recorded, Remark], ...]:
    """Everything that was said and not withdrawn, in order; of a withdrawn fault no answers.

    What is said of another decision stands though that one was withdrawn: it may say why.
    """
    kept: list[tuple[Recorded, Remark]] = []
    stands = standing(decisions)
    numbers = {item.decision_id for item in stands}
    gone = {
        str(item.decision_id)
        for item in decisions
        if isinstance(item.decision, Remark) and item.decision_id not in numbers
    }
    for item in stands:
        said = item.decision
        if isinstance(said, Remark) and (said.subject != "decision" or said.name not in gone):
            kept.append((item, said))
    return tuple(kept)


def standing_faults(decisions: Sequence[Recorded]) -> tuple[Fault, ...]:
    """Faults that were marked and not withdrawn: open ones first, then the newest first."""
    said = standing_remarks(decisions)
    answers: dict[str, list[tuple[Recorded, Remark]]] = defaultdict(list)
    for item, one in said:
        if one.subject == "decision":
            answers[one.name].append((item, one))
    faults = [
        Fault(item, one, tuple(answers[str(item.decision_id)])) for item, one in said if one.fault
    ]
    return tuple(sorted(faults, key=lambda one: (not one.is_open, -one.recorded.decision_id)))


def is_fault(decision: Decision) -> bool:
    """Whether a decision marks a fault."""
    return isinstance(decision, Remark) and bool(decision.fault)


def is_of_a_fault(decision: Decision) -> bool:
    """Whether a decision marks a fault, or says that one is mended or open again."""
    closes = isinstance(decision, Remark) and decision.closes is not None
    return closes or is_fault(decision)


def fault_findings(faults: Sequence[Fault]) -> tuple[Finding, ...]:
    """What faults say of a block; nothing where none was marked."""
    left = sum(one.is_open for one in faults)
    if not faults:
        return ()
    told = {"open": str(left), "count": str(len(faults))}
    return (Finding("faults-open", DOUBTFUL, told) if left else Finding("faults", SOUND, told),)
