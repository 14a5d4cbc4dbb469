"""What the making of orthos does to the state of the desk."""

from dataclasses import replace

from app.worker import RemakeEnded, RemakeStep
from ui.review.compare import with_made
from ui.review.state import DeskState, Notice, Remaking


def while_remaking(state: DeskState, step: RemakeStep) -> DeskState:
    """The state with how far it is."""
    cancelling = state.remaking is not None and state.remaking.cancelling
    remaking = Remaking(step.done, step.total, step.what, step.seconds_left, cancelling)
    return replace(state, remaking=remaking)


def after_remake(state: DeskState, ended: RemakeEnded) -> tuple[DeskState, Notice]:
    """The state once it ended, and what to tell everybody."""
    state = replace(state, remaking=None)
    if ended.failure:
        return state, Notice("notice.remake-failed", {"why": ended.failure}, grave=True)
    if ended.cancelled:
        return state, Notice("notice.remake-cancelled")
    made = replace(state, report=ended.made_with).oriented
    written = ended.made_with is state.report and not state.adjusting
    state = replace(with_made(state, ended.photo_ids, made), written=written)
    return state, Notice("notice.remade" if ended.photo_ids else "notice.written")
