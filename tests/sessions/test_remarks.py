"""Faults are open until the last word closes them; what is withdrawn takes its answers along."""

from sessions.checks import judged_parts
from sessions.decisions import Decision, Recorded, Reject, Remark, Withdraw
from sessions.remarks import fault_findings, standing_faults, standing_remarks
from tests.sessions.test_checks import REPORT

TONE = Remark("place", "", "too dark", (1.0, 2.0), "tone", "ada")
CUT = Remark("place", "", "barn in two", (5.0, 6.0), "cut")


def recorded(*said: Decision) -> tuple[Recorded, ...]:
    return tuple(
        Recorded(number, "2026-01-01T10:00", "bob", one) for number, one in enumerate(said, 1)
    )


def answer(number: int, words: str = "", closes: bool | None = None, to: str = "") -> Remark:
    return Remark("decision", str(number), words, assigned=to, closes=closes)


def test_the_last_word_that_says_so_closes_a_fault_or_opens_it_again__law() -> None:
    said = recorded(TONE, CUT, answer(1, "balanced", True), answer(1, "and now?"))
    cut, tone = standing_faults(said)
    assert (cut.said, cut.is_open, cut.answers) == (CUT, True, ())
    assert (tone.said, tone.is_open) == (TONE, False)
    assert [one.words for _, one in tone.answers] == ["balanced", "and now?"]
    said = recorded(TONE, answer(1, closes=True), answer(1, "still dark", False, "eve"))
    (tone,) = standing_faults(said)
    assert (tone.is_open, tone.assigned) == (True, "eve")


def test_a_withdrawn_fault_takes_its_answers_along__law() -> None:
    said = recorded(TONE, answer(1, "balanced", True), Withdraw(1))
    assert standing_faults(said) == ()
    assert standing_remarks(said) == ()
    again = Recorded(4, "2026-01-01T10:01", "bob", Withdraw(3))
    assert [one.is_open for one in standing_faults((*said, again))] == [False]


def test_what_is_said_of_a_withdrawn_decision_stands__law() -> None:
    """The desk and the table of decisions showed it, and the list of remarks did not."""
    said = recorded(Reject("C1", "A", "blurred"), Withdraw(1), answer(1, "it is sharp in A"))
    assert [one.words for _, one in standing_remarks(said)] == ["it is sharp in A"]


def test_words_about_a_photo_are_no_fault__law() -> None:
    said = recorded(Remark("photo", "00513", "scratched"), TONE)
    assert [one.said for one in standing_faults(said)] == [TONE]
    assert len(standing_remarks(said)) == 2


def test_an_open_fault_is_told_and_a_closed_one_is_sound__law() -> None:
    assert fault_findings(()) == ()
    (left,) = fault_findings(standing_faults(recorded(TONE, CUT, answer(1, closes=True))))
    assert (left.kind, left.grave) == ("faults-open", 1)
    assert "2" in left.sentence
    (done,) = fault_findings(standing_faults(recorded(TONE, answer(1, closes=True))))
    assert (done.kind, done.grave) == ("faults", 0)


def test_a_fault_outdates_a_signature_and_plain_words_do_not__law() -> None:
    before = judged_parts((), REPORT, "m1")
    assert judged_parts(recorded(Remark("photo", "A", "nice")), REPORT, "m1") == before
    now = judged_parts(recorded(TONE), REPORT, "m1")
    assert {name for name in before if before[name] != now[name]} == {"readings"}
