"""Summary of the decision log: who decided how many measurements, when, and how."""

from collections import Counter
from collections.abc import Sequence
from typing import Any

from sessions.decisions import Recorded, Withdraw, standing

KINDS = {
    "Accept": "accepted",
    "ChoosePeak": "accepted",
    "Place": "placed",
    "Reject": "rejected",
    "MarkNotVisible": "rejected",
    "MarkDubious": "unsure",
    "AddPoint": "points added",
    "BringPoints": "points brought",
    "SetRole": "roles set",
    "JudgeTie": "ties judged",
    "JudgePhoto": "photos judged",
    "JudgeFiducial": "fiducials",
    "PlaceFiducial": "fiducials",
    "DrawMask": "masks drawn",
    "PlacePhoto": "photos placed",
    "FillMarks": "fiducials",
    "SeamLine": "seams drawn",
    "SeamArea": "seams drawn",
    "PlanChecks": "checks planned",
    "ReadCheck": "checks read",
    "SignBlock": "signatures",
}
"""What each kind of decision is counted as."""


def decision_figures(recorded: Sequence[Recorded]) -> dict[str, Any]:
    """Decisions that stand, by operator and kind; how many were taken back.

    Args:
        recorded: Every decision of the session, withdrawals included.
    """
    plain = [one for one in recorded if not isinstance(one.decision, Withdraw)]
    kept = [one for one in standing(recorded) if not isinstance(one.decision, Withdraw)]
    operators = sorted({one.who for one in kept})
    counts = {
        who: Counter(KINDS[type(one.decision).__name__] for one in kept if one.who == who)
        for who in operators
    }
    used = {kind for counter in counts.values() for kind in counter}
    return {
        "count": len(kept),
        "taken_back": len(plain) - len(kept),
        "kinds": [kind for kind in dict.fromkeys(KINDS.values()) if kind in used],
        "operators": [
            {
                "who": who,
                "first": min(one.when for one in kept if one.who == who),
                "last": max(one.when for one in kept if one.who == who),
                "count": sum(counts[who].values()),
                "by_kind": dict(counts[who]),
            }
            for who in operators
        ],
    }
