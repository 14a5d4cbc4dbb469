"""Places read in the browser by two observers, and a block signed there."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from app.desk import planning
from sessions.checks import checked_figures, standing_plans, version_on_disk
from sessions.decisions import Place, PlanChecks, ReadCheck, Recorded, SignBlock
from sessions.remarks import standing_faults
from tests.browser.conftest import PATIENCE_MS, RealDesk
from tests.browser.hands import (
    at_once,
    caught_up,
    mark_place,
    open_checks,
    read_place,
    settled,
    sit_down_as,
    unfold,
    until,
    wire_cut,
)

Sit = Callable[..., Any]
BIAS_M = np.array([1.2, -0.8])
PLACES = 4


def draw_for_ever(*given: Any) -> None:
    for _ in range(3000):
        given[-1].report(1, 2)
        time.sleep(0.01)


def test_places_are_planned_at_the_desk__law(
    real_desk: Any, sit_at: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = sit_at(real_desk.desk.url, scene=False)
    page.keyboard.press("Shift+B")
    with monkeypatch.context() as slow:
        slow.setattr(planning, "draw_plan", draw_for_ever)
        page.click("#checks-plan", timeout=PATIENCE_MS)
        page.wait_for_selector("#checks [role=progressbar][aria-valuenow='50']")
        page.click("#checks-cancel")
        page.wait_for_selector("#checks-said:has-text('no plan was recorded')")
    page.click("#checks-plan", timeout=PATIENCE_MS)
    page.wait_for_selector("#checks[open] .check-room >> nth=1", timeout=PATIENCE_MS)
    (plan,) = [item for item in real_desk.session.decisions() if is_plan(item)]
    assert plan.decision.count == page.evaluate("gruber.checksState().found.places.length")
    assert len(plan.decision.places) >= 20
    page.keyboard.press("Escape")
    page.wait_for_selector("#checks:not([open])", state="attached")
    page.keyboard.press("u")
    page.wait_for_selector("#asked.against #keep:has-text('check plan 1 of')")
    caught_up(page)
    page.keyboard.press("u")
    page.wait_for_function("gruber.parts.status")
    page.keyboard.press("Shift+B")
    page.wait_for_selector("#checks-plan", timeout=PATIENCE_MS)


def test_the_question_about_a_plan_is_in_sight_of_the_sheet_as_long_as_it_is_asked__law(
    planned: None, real_desk: RealDesk, sit_at: Sit
) -> None:
    page = sit_down_as(sit_at(real_desk.desk.url, scene=False), "ada")
    open_checks(page)
    known = len(real_desk.session.decisions())
    for no in ("Escape", "j", "k", "pointer"):
        at_once(page, "u", "u")  # the second before it is asked, and so no answer
        page.wait_for_selector("#checks #turning:has-text('Withdraw check plan 1 of')")
        caught_up(page)
        if no == "pointer":
            page.click("#checks .check-room >> nth=0")
        else:
            page.keyboard.press(no)
        page.wait_for_selector("#turning", state="detached")
        caught_up(page)
        assert page.evaluate("gruber.parts.queue.turning") is None
        assert page.locator("#checks[open]").count() == 1
    page.keyboard.press("u")
    page.wait_for_selector("#checks #turning")
    page.click("#checks-close")
    caught_up(page)
    assert page.evaluate("gruber.parts.queue.turning") is None
    assert len(real_desk.session.decisions()) == known


def test_marks_wait_for_whoever_looks_at_another_place_and_no_question_moves_the_pictures__law(
    planned: None, real_desk: RealDesk, sit_at: Sit
) -> None:
    page = sit_down_as(sit_at(real_desk.desk.url, scene=False), "ada")
    page.set_viewport_size({"width": 1366, "height": 768})
    open_checks(page)
    mark_place(page, np.array([1.0, 0.0]))
    marks = page.evaluate("gruber.checksState().marks")
    page.keyboard.press("j")
    assert page.evaluate("gruber.checksState().marks") == [None, None]
    page.keyboard.press("k")
    assert page.evaluate("gruber.checksState().marks") == marks
    assert page.inner_text("#checks-state") == "marked, not kept"
    before = boxes(page)
    page.keyboard.press("n")
    page.wait_for_selector("#checks [data-reason=blurred]")
    assert boxes(page) == before
    page.keyboard.press("Escape")
    page.keyboard.press("y")
    page.keyboard.press("k")
    page.wait_for_selector("#checks [data-check=back]:not([disabled])")
    assert boxes(page) == before


def boxes(page: Any) -> list[Any]:
    """Where the pictures, Close and the button that withdraws lie."""
    names = "#checks .check-room", "#checks-close", "#checks [data-check=back]"
    return [page.locator(name).first.bounding_box() for name in names]


def test_a_spare_follows_its_place_and_its_reading_stays_when_the_place_is_opened_again__law(
    planned: None, real_desk: RealDesk, sit_at: Sit
) -> None:
    page = sit_down_as(sit_at(real_desk.desk.url, scene=False), "ada")
    open_checks(page)
    current = "gruber.checksState().current"
    plan = standing_plans(real_desk.session.decisions())[-1].plan
    followed = {one.after for one in plan.places}
    while (place := page.evaluate(current)) not in followed:
        page.keyboard.press("j")
        page.wait_for_function(f"{current} !== {place!r}")
    page.keyboard.press("n")
    page.keyboard.press("1")
    page.wait_for_function(f"{current} !== {place!r}")
    assert page.evaluate(current) == f"{place}a"
    assert f"spare of {place}" in page.inner_text("#checks-state")
    # Taken back while the spare is shown: one is at its place again.
    page.keyboard.press("u")
    page.wait_for_function(f"{current} === {place!r}")
    page.keyboard.press("n")
    page.keyboard.press("1")
    page.wait_for_function(f"{current} === '{place}a'")
    read_place(page, np.array([1.0, 0.0]))
    page.keyboard.press("k")
    page.keyboard.press("k")
    page.click("#checks [data-check=back]")
    page.wait_for_selector("#checks-state:has-text('not read')")
    page.keyboard.press("j")
    page.wait_for_selector(f"#checks-state:has-text('read as a spare of {place}')")
    assert "done by you: 1," in page.inner_text("#checks-done")


def is_plan(item: Recorded) -> bool:
    return isinstance(item.decision, PlanChecks)


def readings(desk: RealDesk) -> set[tuple[str, str]]:
    """Places that were read, and by whom."""
    said = desk.session.decisions()
    return {(one.decision.place_id, one.who) for one in said if isinstance(one.decision, ReadCheck)}


def test_two_observers_read_blind_and_the_bias_is_recovered__truth(
    planned: None, real_desk: RealDesk, sit_at: Sit
) -> None:
    read: list[str] = []
    for who in ("ada", "bob"):
        page = sit_down_as(sit_at(real_desk.desk.url, scene=False), who)
        open_checks(page)
        shown = page.evaluate("JSON.stringify(gruber.checksState().found.places)")
        # Nothing of the other's marks: a place that only others read is as good as new.
        assert '"marks"' not in shown
        wanted = set(read)
        while len(read) < PLACES or wanted:
            current = page.evaluate("gruber.checksState().current")
            if who == "bob" and current not in wanted:
                page.keyboard.press("j")
                page.wait_for_function("name => gruber.checksState().current !== name", arg=current)
                continue
            name = read_place(page, BIAS_M)
            wanted.discard(name)
            if who == "ada":
                read.append(name)
        # The page goes on before the session has written what was kept.
        until(page, lambda who=who: {n for n, by in readings(real_desk) if by == who} >= set(read))
        page.close()
    session = real_desk.session
    said = session.decisions()
    assert readings(real_desk) == {(name, who) for name in read for who in ("ada", "bob")}
    plan = standing_plans(said)[-1]
    found = checked_figures(said, plan, version_on_disk(session.products))
    assert found.doubled == PLACES
    # A click is good to a pixel of the screen: a fifth of a metre in so small a block.
    assert np.allclose(found.together.mean_m, BIAS_M, atol=0.3)
    # Where one signs, what the report says of predicted against observed is told as well.
    page = sit_at(real_desk.desk.url, scene=False)
    caught_up(page)
    page.keyboard.press("b")
    page.wait_for_selector("#quality[open] :text('times the predicted')")


def test_a_reading_far_off_is_asked_about_before_it_is_kept__law(
    planned: None, real_desk: RealDesk, sit_at: Sit
) -> None:
    page = sit_at(real_desk.desk.url, scene=False)
    settled(page)
    open_checks(page)
    name = mark_place(page, np.array([9.0, 9.0]))
    page.keyboard.press("y")
    page.wait_for_selector("#checks-state:has-text('further apart')")
    page.keyboard.press("Escape")
    page.wait_for_selector("#checks-state:not(:has-text('apart'))")
    caught_up(page)
    assert page.evaluate("gruber.checksState().current") == name
    assert not readings(real_desk)
    at_once(page, "y", "y")  # which nobody presses for an answer: the question is not read yet
    page.wait_for_selector(".notice:has-text('only just appeared')")
    page.wait_for_selector("#checks-state:has-text('further apart')")
    caught_up(page)
    page.keyboard.press("y")
    page.wait_for_function("name => gruber.checksState().current !== name", arg=name)
    until(page, lambda: {place for place, _ in readings(real_desk)} == {name})


def test_a_signature_is_outdated_by_a_decision_and_holds_again_once_undone__law(
    real_desk: RealDesk, sit_at: Sit
) -> None:
    page = sit_at(real_desk.desk.url, scene=False)
    settled(page)
    page.keyboard.press("b")
    page.wait_for_selector("#sign", timeout=PATIENCE_MS)
    page.select_option("#sign-verdict", "reject")
    page.fill("#sign-remark", "shifted in the north")
    caught_up(page)
    page.dblclick("#sign")
    page.wait_for_selector(".signature")
    caught_up(page)
    made = [one.decision for one in real_desk.session.decisions()]
    assert sum(isinstance(one, SignBlock) for one in made) == 1
    assert "“shifted in the north”" in page.inner_text(".signature")
    assert not page.query_selector(".signature .outdated")
    page.click("#quality-close")
    before = len([one for one in real_desk.session.decisions() if isinstance(one.decision, Place)])
    caught_up(page)
    page.keyboard.press("y")
    settled(page)
    page.keyboard.press("b")
    page.wait_for_selector(".signature .outdated", timeout=PATIENCE_MS)
    page.click("#quality-close")
    page.keyboard.press("u")
    settled(page)
    page.keyboard.press("b")
    page.wait_for_function(
        "document.querySelector('.signature') && !document.querySelector('.signature .outdated')",
        timeout=PATIENCE_MS,
    )
    places = [one for one in real_desk.session.decisions() if isinstance(one.decision, Place)]
    assert len(places) == before
    page.click("#quality-close")
    known = len(real_desk.session.decisions())
    page.dblclick('[data-act="undo"]')
    page.wait_for_selector("#asked.against #keep:has-text('signature')")
    caught_up(page)
    assert len(real_desk.session.decisions()) == known


def test_the_button_beside_an_own_signature_asks_as_undo_does__law(
    real_desk: RealDesk, sit_at: Sit
) -> None:
    page = sit_at(real_desk.desk.url, scene=False)
    settled(page)
    page.keyboard.press("b")
    page.select_option("#sign-verdict", "reject", timeout=PATIENCE_MS)
    page.fill("#sign-remark", "a shifted corner. " * 40)
    caught_up(page)
    page.click("#sign")
    page.wait_for_selector(".signature")
    # So long a remark pushes nothing away.
    said = page.locator(".signature .clamped")
    low = said.bounding_box()["height"]
    page.click(".signature [data-more]")
    assert page.locator(".signature [data-more] >> text=Show less").count() == 1
    assert page.locator(".signature").bounding_box()["height"] > low + 20
    known = len(real_desk.session.decisions())
    for key in ("j", "u"):
        page.click(".signature > button")
        page.wait_for_selector("#quality #turning:has-text('Withdraw your signature')")
        caught_up(page)
        page.keyboard.press(key)
        page.wait_for_selector("#turning", state="detached")
        caught_up(page)
        assert len(real_desk.session.decisions()) == known + (key == "u")
    page.wait_for_selector(".signature", state="detached")


def at_the_mosaic(real_desk: RealDesk, sit_at: Sit) -> Any:
    """A desk with the mosaic open and a place of it chosen by key."""
    page = sit_at(real_desk.desk.url, scene=False)
    settled(page)
    page.keyboard.press("Shift+O")
    page.wait_for_function("gruber.mosaicState().found?.version > 0", timeout=PATIENCE_MS)
    page.keyboard.press("Enter")
    return page


def test_a_fault_is_marked_answered_and_closed_in_the_mosaic__truth(
    real_desk: RealDesk, sit_at: Sit
) -> None:
    page = at_the_mosaic(real_desk, sit_at)
    page.wait_for_selector("#fault-mark", timeout=PATIENCE_MS)
    # What is wrong is said by who marks it, and by nobody else.
    assert page.is_disabled("#fault-mark")
    page.select_option("#fault-kind", "double")
    page.fill("#fault-words", "church seen twice")
    page.fill("#fault-assigned", "eve")
    page.click("#fault-mark")
    page.click("[data-fault]")
    page.fill("#fault-answer", "seam moved")
    caught_up(page)
    page.click("#fault-turn")
    page.wait_for_function("!gruber.mosaicState().found.faults[0].open")
    assert page.input_value("#fault-kind") == ""
    at = page.evaluate("gruber.mosaicState().picked.place")[:2]
    (fault,) = standing_faults(real_desk.session.decisions())
    assert (fault.said.fault, fault.said.words, fault.assigned) == (
        "double", "church seen twice", "eve",
    )  # fmt: skip
    assert fault.said.place == pytest.approx(at)
    assert [one.words for _, one in fault.answers] == ["seam moved"]
    assert not fault.is_open


FAULT_AT = """id => { const { found, toScreen } = gruber.mosaicState();
  return toScreen(found.faults.find(one => one.id === id).place); }"""


def test_faults_at_one_place_are_one_mark_that_leads_to_each__law(
    real_desk: RealDesk, sit_at: Sit
) -> None:
    page = at_the_mosaic(real_desk, sit_at)
    for kind in ("double", "tone"):
        page.select_option("#fault-kind", kind, timeout=PATIENCE_MS)
        page.click("#fault-mark")
        page.wait_for_selector(f"[data-fault] >> nth={int(kind == 'tone')}")
    first, second = page.evaluate("gruber.mosaicState().found.faults.map(one => one.id)")
    box = page.locator('#mosaic .pane[data-pane="right"]').bounding_box()
    x, y = page.evaluate(FAULT_AT, first)
    for wanted in (first, second, first):
        page.mouse.click(box["x"] + x, box["y"] + y)
        page.wait_for_selector(f'[data-fault="{wanted}"][aria-expanded=true]')
        assert page.locator("[data-fault][aria-expanded=true]").count() == 1


def test_marks_that_are_not_kept_outlive_the_page_and_are_their_observers_alone__law(
    planned: None, real_desk: RealDesk, sit_at: Sit
) -> None:
    page = sit_down_as(sit_at(real_desk.desk.url, scene=False), "ada")
    open_checks(page)
    page.keyboard.press("j")
    name = mark_place(page, np.array([1.0, 0.0]))
    marks = page.evaluate("gruber.checksState().marks")
    page.reload()
    page.wait_for_selector(".row.current")
    page.wait_for_function("document.getElementById('who').dataset.name === 'ada'")
    open_checks(page)
    assert page.evaluate("gruber.checksState().current") == name
    assert page.evaluate("gruber.checksState().marks") == marks
    assert page.inner_text("#checks-state") == "marked, not kept"
    page.keyboard.press("Escape")
    sit_down_as(page, "bob")
    open_checks(page)
    while page.evaluate("gruber.checksState().current") != name:
        page.keyboard.press("j")
    assert page.evaluate("gruber.checksState().marks") == [None, None]
    page.keyboard.press("Escape")
    sit_down_as(page, "ada")
    open_checks(page)
    page.keyboard.press("y")
    page.wait_for_function("name => gruber.checksState().current !== name", arg=name)
    until(page, lambda: readings(real_desk) == {(name, "ada")})
    page.reload()
    page.wait_for_selector(".row.current")
    page.wait_for_function("document.getElementById('who').dataset.name === 'ada'")
    open_checks(page)
    assert page.evaluate("gruber.checksState().marks") == [None, None]


def test_marks_are_of_the_mosaic_they_were_set_in__law(
    planned: None, real_desk: RealDesk, sit_at: Sit
) -> None:
    page = sit_at(real_desk.desk.url, scene=False)
    settled(page)
    open_checks(page)
    mark_place(page, np.array([1.0, 0.0]))
    page.evaluate("""async () => {
      const { showChecks } = await import("/pages/checks.js");
      const { found } = gruber.checksState();
      showChecks({ ...found, mosaic: { ...found.mosaic, version: found.mosaic.version + 1 } });
    }""")
    assert page.evaluate("gruber.checksState().marks") == [None, None]
    assert "made anew" in page.inner_text("#checks-state")
    # Marked again before the desk has told more of its mosaic: it refuses what it does not show.
    mark_place(page, np.array([1.0, 0.0]))
    page.keyboard.press("y")
    page.wait_for_selector(".notice:has-text('made anew')")
    assert not readings(real_desk)


def test_what_cannot_be_sent_stays_where_it_was_made__law(
    planned: None, real_desk: RealDesk, sit_at: Sit
) -> None:
    page = sit_at(real_desk.desk.url, scene=False)
    settled(page)
    unfold(page)
    page.fill("#remark-words", "wet")
    with wire_cut(page):
        page.click("#remark-say")
        page.wait_for_selector(".notice:has-text('No connection')")
        assert page.input_value("#remark-words") == "wet"
    page.evaluate("document.activeElement.blur()")
    open_checks(page)
    name = mark_place(page, np.array([1.0, 0.0]))
    with wire_cut(page):
        page.keyboard.press("y")
        assert page.evaluate("gruber.checksState().current") == name
        assert all(page.evaluate("gruber.checksState().marks"))
    page.keyboard.press("Escape")
    page.keyboard.press("Shift+I")
    page.wait_for_function("gruber.maskState().found && gruber.maskState().view.scale > 0")
    for key in (" ", "ArrowRight", " ", "ArrowDown", " "):
        page.keyboard.press(key)
    with wire_cut(page):
        page.keyboard.press("Enter")
        assert len(page.evaluate("gruber.maskState().outline")) == 3


def test_what_is_said_of_the_mosaic_stays_where_it_cannot_be_sent__law(
    real_desk: RealDesk, sit_at: Sit
) -> None:
    page = at_the_mosaic(real_desk, sit_at)
    page.select_option("#fault-kind", "double", timeout=PATIENCE_MS)
    page.fill("#fault-words", "church")
    page.fill("#fault-assigned", "eve")
    with wire_cut(page):
        page.click("#fault-mark")
    page.click("#fault-mark")
    page.click("[data-fault]")
    page.fill("#fault-answer", "mended")
    with wire_cut(page):
        page.click("#fault-say")
    page.click("#fault-say")
    page.wait_for_selector(".fault-thread p:has-text('mended')")
    (fault,) = standing_faults(real_desk.session.decisions())
    assert (fault.said.words, fault.assigned) == ("church", "eve")
    assert [one.words for _, one in fault.answers] == ["mended"]
    page.evaluate("document.activeElement.blur()")
    for key in ("l", " ", "ArrowRight", " "):
        page.keyboard.press(key)
    with wire_cut(page):
        page.keyboard.press("Enter")
        assert len(page.evaluate("gruber.mosaicState().edit.places")) == 2
