"""Which edits of the seams stand, one laid anew in the place of what it replaces; which not."""

from collections.abc import Sequence

from core.mosaic.seam_edits import SeamArea, SeamEdit, SeamLine
from sessions.decisions import Recorded, standing, withdrawals


def standing_seams(decisions: Sequence[Recorded]) -> tuple[tuple[Recorded, SeamEdit], ...]:
    """What stands of all that was drawn on the mosaic, in the order in which it is laid.

    An edit whose corners were moved keeps its turn: what was laid after it still lies over it.
    One that replaces what no longer stands comes last, as a new one does.
    """
    laid: list[tuple[Recorded, SeamEdit]] = []
    turns: dict[int, int] = {}
    for item in standing(decisions):
        edit = item.decision
        if not isinstance(edit, SeamLine | SeamArea):
            continue
        turn = turns.get(edit.replaces, len(laid))
        laid[turn : turn + 1] = [(item, edit)]
        turns[item.decision_id] = turn
    return tuple(laid)


def standing_seam_edits(decisions: Sequence[Recorded]) -> tuple[SeamEdit, ...]:
    """The edits alone, in the same order."""
    return tuple(edit for _, edit in standing_seams(decisions))


def withdrawn_seams(decisions: Sequence[Recorded]) -> tuple[tuple[Recorded, SeamEdit, str], ...]:
    """What was drawn on the mosaic and no longer stands, as recorded, and who withdrew it."""
    back = withdrawals(decisions)
    return tuple(
        (item, item.decision, back[item.decision_id].who)
        for item in decisions
        if isinstance(item.decision, SeamLine | SeamArea) and item.decision_id in back
    )
