"""Lessons on the usual screen of a notebook: nothing is cut, covered, too small or out of sight."""

from urllib.parse import urlencode

import pytest

from tests.browser.test_lessons import LESSONS, READY, settled

pytestmark = pytest.mark.usefixtures("teaching_cache")


@pytest.mark.parametrize("size", [(1600, 1000), (1366, 768)])
def test_every_choice_lies_within_its_room__law(learn, size):
    for name in ("places", "matching"):
        page, _ = learn(name, size={"width": size[0], "height": size[1]})
        room = page.locator("#controls")
        assert room.evaluate("e => e.scrollWidth <= e.clientWidth"), name
        assert page.locator("[data-choice=operator]").count() >= 5, name


@pytest.mark.parametrize("language", ["en", "cs"])
def test_the_question_is_seen_without_scrolling__law(learn, language):
    """On the usual screen of a notebook the field and its button lie above the lower edge."""
    page, wrong = learn(next(iter(LESSONS)), language=language, size={"width": 1366, "height": 768})
    for name in LESSONS:
        page.click(f'[data-lesson="{name}"]')
        settled(page)
        page.wait_for_selector("#check")
        assert page.locator("#check").bounding_box()["y"] + 24 <= 768, name
        room = page.locator("#controls")
        assert room.evaluate("e => e.scrollWidth <= e.clientWidth"), name
    assert wrong == []


@pytest.mark.parametrize("language", ["en", "cs"])
def test_models_are_named_at_their_axis_and_every_arrow_has_its_number__law(learn, language):
    page, _ = learn("interior", language=language, size={"width": 1366, "height": 768})
    names = page.locator("[data-choice=model]").all_inner_texts()
    for state in ({}, {"shrink_x": 3, "shrink_y": -1, "shear": 1, "bend": 5, "noise": 30}):
        for name, value in state.items():
            page.locator(f"#slider-{name}").fill(str(value))
        settled(page)
        ticks = page.locator("#plot .tick").all_text_contents()
        assert ticks[: len(names)] == names
        assert page.evaluate(TEXTS) == []
        labels = page.locator("#drawings .label").all_text_contents()
        assert sum("µm" in one for one in labels) == 9


@pytest.mark.parametrize("language", ["en", "cs"])
def test_a_verdict_comes_into_sight__law(learn, language):
    """With the truth shown, figures push the question below the lower edge."""
    size = {"width": 1366, "height": 768}
    page, _ = learn(next(iter(LESSONS)), language=language, size=size)
    for name in LESSONS:
        page.click(f'[data-lesson="{name}"]')
        if page.locator("#truth").count():
            page.locator("#truth").click()
        page.wait_for_selector("#check")
        settled(page)
        page.locator("#answer").fill("-987654")
        for act, verdict in (("#check", "#said.wrong"), ("#hint", "#said"), ("#give-up", "#said")):
            page.locator("#controls").evaluate("e => { e.scrollTop = 0; }")
            page.locator(act).evaluate("e => e.click()")
            page.wait_for_function("document.getElementById('said').textContent")
            box = page.locator(verdict).bounding_box()
            assert box["y"] + box["height"] <= 768, (name, act)
            page.locator("#said").evaluate("e => { e.textContent = ''; }")


TEXTS = """() => [...document.querySelectorAll('.drawing svg, #plot svg')].flatMap((sheet) => {
  const room = sheet.getBoundingClientRect();
  const texts = [...sheet.querySelectorAll('text')].map((e) => [e.textContent,
    e.getBoundingClientRect()]);
  const cut = texts.filter(([, b]) => b.left < room.left - 1 || b.right > room.right + 1
    || b.top < room.top - 1 || b.bottom > room.bottom + 1).map(([text]) => `${text} is cut`);
  const over = texts.flatMap(([text, b], place) => texts.slice(place + 1).filter(([, c]) =>
    Math.min(b.right, c.right) - Math.max(b.left, c.left) > 2
    && Math.min(b.bottom, c.bottom) - Math.max(b.top, c.top) > 3)
    .map(([other]) => `${text} lies over ${other}`));
  return [...cut, ...over]; })"""
"""Words of drawings and plots that are cut, or of which one lies over another."""


@pytest.mark.parametrize("language", ["en", "cs"])
def test_no_word_of_a_drawing_or_plot_is_cut_or_covered__law(learn, language):
    page, wrong = learn("chain", language=language, size={"width": 1366, "height": 768})
    for step in range(1, 11):
        for point in (1, 7):
            page.locator("#slider-point").fill(str(point))
            page.locator("#slider-step").fill(str(step))
            settled(page)
            assert page.evaluate(TEXTS) == [], (step, point)
    for name in LESSONS:
        page.click(f'[data-lesson="{name}"]')
        settled(page)
        assert page.evaluate(TEXTS) == [], name
        room = page.locator("#formulas")
        assert room.evaluate("e => e.scrollHeight <= e.clientHeight + 1"), name
    assert wrong == []


FORMULAS = """() => { const edge = document.getElementById('formulas').getBoundingClientRect();
  return [...document.querySelectorAll('#formulas math')].filter((e) =>
    e.getBoundingClientRect().right > edge.right - 6).map((e) => e.textContent)
  .concat([...document.querySelectorAll('#formulas :is(mi, mn, mtext)')].filter((e) =>
    parseFloat(getComputedStyle(e).fontSize) < 11.9).map((e) => `${e.textContent} is small`)); }"""
"""Formulas that come too near to the edge of their room, and letters below 12 pixels."""


@pytest.mark.parametrize("language", ["en", "cs"])
def test_formulas_with_their_numbers_fit_into_their_room__law(learn, lessons, language):
    page, _ = learn(next(iter(LESSONS)), language=language, size={"width": 1366, "height": 768})
    line = {f"{axis}{i}": at for i in range(1, 5) for axis, at in (("x", 0), ("y", 250 * i - 700))}
    wide = [{"lesson": "corrections", "H": high, "h": low, "lens": -30}
            for high, low in ((16000, 2000), (4500, 300), (600, 0), (600, 2000))]  # fmt: skip
    wide += [{"lesson": "resection", "noise": 30} | {"fourth": fourth} | at
             for fourth in (0, 1) for at in ({}, line)]  # fmt: skip
    for state in wide:
        page.goto(f"{lessons.url}&{urlencode(state)}")
        page.wait_for_selector(READY)
        assert page.evaluate(FORMULAS) == [], state
    for name in LESSONS:
        page.click(f'[data-lesson="{name}"]')
        settled(page)
        assert page.evaluate(FORMULAS) == [], name
