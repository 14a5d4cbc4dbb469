"""Which decisions stand, and what undo and redo take hold of."""

from hypothesis import given
from hypothesis import strategies as st

from sessions.decisions import (
    Accept,
    Decision,
    Recorded,
    Reject,
    SetRole,
    Withdraw,
    last_to_redo,
    last_to_undo,
    standing,
)


def recorded(*decisions: Decision, who: str = "ada") -> list[Recorded]:
    return [Recorded(n + 1, "2026-01-01", who, item) for n, item in enumerate(decisions)]


def ids(items: tuple[Recorded, ...]) -> list[int]:
    return [item.decision_id for item in items if not isinstance(item.decision, Withdraw)]


def test_withdrawn_decision_no_longer_stands__truth() -> None:
    log = recorded(Accept("P", "A"), Reject("P", "A", "hidden"), Withdraw(1))
    assert ids(standing(log)) == [2]


def test_withdrawing_a_withdrawal_brings_the_decision_back__truth() -> None:
    log = recorded(Accept("P", "A"), Withdraw(1), Withdraw(2))
    assert ids(standing(log)) == [1]


def test_withdrawing_what_comes_later_or_never_came_changes_nothing__truth() -> None:
    log = recorded(Withdraw(2), Accept("P", "A"), Withdraw(77))
    assert ids(standing(log)) == [2]


def test_undo_takes_own_decisions_only_last_first__truth() -> None:
    log = [
        *recorded(Accept("P", "A"), Accept("Q", "A")),
        Recorded(3, "", "bob", Accept("R", "A")),
    ]
    assert last_to_undo(log, "ada") == log[1]
    log.append(Recorded(4, "", "ada", Withdraw(2)))
    assert last_to_undo(log, "ada") == log[0]
    assert last_to_undo(log, "eve") is None


def test_undo_and_redo_keep_to_the_kinds_asked_for__truth() -> None:
    log = recorded(SetRole("P", "check"), Accept("P", "A"))
    assert last_to_undo(log, "ada", (SetRole,)) == log[0]
    assert last_to_undo(log, "ada", (Reject,)) is None
    log.append(Recorded(3, "", "ada", Withdraw(1)))
    assert last_to_redo(log, "ada", (SetRole,)) == log[2]
    # Of another kind something was decided since: that is no reason not to restore this one.
    log.append(Recorded(4, "", "ada", Accept("Q", "A")))
    assert last_to_redo(log, "ada", (SetRole,)) == log[2]
    assert last_to_redo(log, "ada", (Accept,)) is None
    assert last_to_redo(log, "ada") is None


def test_redo_after_a_new_decision_is_nothing__truth() -> None:
    log = recorded(Accept("P", "A"), Withdraw(1), Accept("Q", "A"), Withdraw(3))
    assert last_to_redo(log, "ada") == log[3]
    log.append(Recorded(5, "", "ada", Withdraw(4)))
    assert last_to_redo(log, "ada") is None


@given(st.integers(1, 6), st.integers(0, 8), st.integers(0, 8))
def test_undo_and_redo_walk_the_row_of_decisions_like_a_cursor__law(
    count: int, undos: int, redos: int
) -> None:
    log = recorded(*(Accept(f"P{n}", "A") for n in range(count)))
    for take, times in ((last_to_undo, undos), (last_to_redo, redos)):
        for _ in range(times):
            found = take(log, "ada")
            if found is not None:
                log.append(Recorded(len(log) + 1, "", "ada", Withdraw(found.decision_id)))
    cursor = count - min(undos, count)
    cursor = min(count, cursor + redos)
    assert ids(standing(log)) == list(range(1, cursor + 1))
