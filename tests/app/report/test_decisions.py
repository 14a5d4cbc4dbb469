"""The list of decisions: about what, from which state to which, and who took it back."""

from dataclasses import replace

import pytest

from app.report.decisions import KINDS, decision_figures, decisions_told, states_before
from sessions.decisions import (
    DECISIONS,
    Accept,
    JudgePhoto,
    JudgeTie,
    MarkNotVisible,
    Place,
    ReadCheck,
    Recorded,
    Reject,
    Remark,
    SetRole,
    SignBlock,
    Withdraw,
)
from ui.words.catalogue import LANGUAGES, Teller, words


def said(*decisions, who="ada"):
    return [
        Recorded(number, f"2026-01-02T10:{number:02d}:30.5+00:00", who, decision)
        for number, decision in enumerate(decisions, start=1)
    ]


def row_of(recorded, number, proposed=None):
    log = decision_figures(recorded, proposed)["log"]
    return next(one for one in log if one["number"] == number)


def test_the_state_before_is_that_of_the_last_decision_that_stood_then__truth(report):
    block = report.block
    key = next(key for key, item in block.measurements.items() if item.status == "auto")
    recorded = said(
        Reject(*key, "changed"), Accept(*key), Withdraw(2), Place(*key, 3.0, 4.0),
        Withdraw(3), MarkNotVisible(*key),
    )  # fmt: skip
    states = states_before(recorded, block)
    # The fourth: the acceptance had been withdrawn. The sixth: it counts again, and was later.
    assert [states[n] for n in (1, 2, 4, 6)] == ["auto", "rejected", "rejected", "accepted"]
    assert states_before(recorded, None)[1] == ""
    point = key[0]
    roles = said(SetRole(point, "check"), SetRole(point, "control"))
    assert [states_before(roles, block)[n] for n in (1, 2)] == ["control", "check"]
    photo = next(name for name, one in block.photos.items() if one.oriented)
    away = replace(block, photos={**block.photos, photo: replace(block.photos[photo])})
    assert row_of(said(JudgePhoto(photo, use=False)), 1, away)["before"] == "in use"


def test_a_row_names_place_change_words_and_who_withdrew_it__truth():
    recorded = [
        *said(
            Place("J1", "S1", 10.0, 20.5), ReadCheck("1-07", (5.0, 6.0), (4.0, 6.5), "m"),
            Reject("J1", "S1", "hidden"), Remark("decision", "3", "a tree grew there"),
            SignBlock("reject", "north is off", {}),
            Remark("place", "", "church", (1.0, 2.0), "cut"),
        ),
        Recorded(7, "2026-01-03T08:15:00", "eva", Withdraw(5)),
        Recorded(8, "2026-01-03T08:16:00", "eva", Remark("decision", "6", "", closes=True)),
    ]  # fmt: skip
    rows = {one["number"]: one for one in decision_figures(recorded)["log"]}
    assert list(rows) == [8, 6, 5, 4, 3, 2, 1]
    assert (rows[1]["pixel"], rows[1]["about"]) == ([10.0, 20.5], "J1 S1")
    assert (rows[2]["place"], rows[2]["about"]) == ([4.0, 6.5], "1-07")
    assert (rows[3]["before"], rows[3]["after"], rows[3]["reason"]) == (
        "accepted", "rejected", "hidden",
    )  # fmt: skip
    assert rows[3]["words"] == ["a tree grew there (ada)"]
    signed = rows[5]
    assert (signed["after"], signed["words"], signed["stands"]) == (
        "reject", ["north is off"], False,
    )  # fmt: skip
    assert (signed["withdrawn_by"], signed["withdrawn_when"]) == ("eva", "2026-01-03 08:15")
    assert (rows[8]["before"], rows[8]["after"]) == ("open", "closed")
    told = {one["number"]: one for one in decisions_told(list(rows.values()), Teller())}
    assert told[3]["change"] == "accepted → rejected: hidden"
    assert told[5]["back"] == "withdrawn by eva, 2026-01-03 08:15"
    assert told[8]["about"] == "no. 6"
    assert told[2]["about"] == "1-07, E\u00a04.0 N\u00a06.5"
    assert told[2]["change"] == "dX +1.000, dY −0.500\u00a0m"
    assert told[6]["about"] == "E\u00a01.0 N\u00a02.0"


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_decision_has_its_texts__law(language):
    for kind in (one for one in DECISIONS if one is not Withdraw):
        assert kind.__name__ in KINDS
        assert f"did.{kind.__name__}" in words(language)
    recorded = said(
        ReadCheck("1-01", None, None, "m", "blurred"), JudgeTie("S1", 1.0, 2.0, use=False),
        MarkNotVisible("J1", "S1"), Reject("J1", "S2", "other"), SetRole("J1", "new"),
        SignBlock("accept", "", {}), Remark("photo", "S1", "dirt", None, "smear"),
    )  # fmt: skip
    told = decisions_told(decision_figures(recorded)["log"], Teller(language))
    assert all(one["change"] for one in told)
