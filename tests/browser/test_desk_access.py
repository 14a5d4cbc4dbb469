"""Looks and access: no violation that axe-core knows."""

import pytest

from app.desk.wiring import open_desk
from tests.browser.conftest import AT_WORK, PATIENCE_MS, VIOLATIONS, toured
from tests.browser.hands import caught_up, grow, unfold
from tests.ui.desk_block import desk_inputs
from ui.words.catalogue import words


@pytest.fixture
def sit_with(chromium, desk):
    """The desk in a language and a theme."""
    contexts = []

    def sit_down(language: str, theme: str):
        context = chromium.new_context(
            locale="cs-CZ" if language == "cs" else "en-GB",
            bypass_csp=True,
            viewport={"width": 1600, "height": 1000},
            storage_state=toured(desk.url),
        )
        context.set_default_timeout(PATIENCE_MS)
        context.add_init_script(f"localStorage.setItem('gruber.theme', '{theme}')")
        contexts.append(context)
        page = context.new_page()
        page.goto(desk.url)
        page.wait_for_selector(".row.current")
        return page

    yield sit_down
    for context in contexts:
        context.close()


# Colours hang on the theme, names on the language: each is seen once.
@pytest.mark.parametrize(("theme", "language"), [("dark", "en"), ("light", "cs")])
def test_axe_finds_nothing_on_any_page__oracle(sit_with, axe, theme, language):
    page = sit_with(language, theme)
    page.evaluate(axe)
    found = {}

    def look(name: str) -> None:
        page.wait_for_timeout(100)
        found[name] = page.evaluate(VIOLATIONS)

    page.wait_for_function("gruber.parts.point.trial")
    unfold(page)
    look("desk")
    page.keyboard.press("z")
    look("all scans")
    page.keyboard.press("z")
    grow(page, "block")
    look("scene")
    page.keyboard.press("x")
    for key, name in (("h", "help"), ("b", "quality"), ("i", "board"), ("g", "placement")):
        page.keyboard.press(key)
        page.wait_for_selector(f"#{name}[open]")
        look(name)
        page.keyboard.press("Escape")
        page.wait_for_selector(f"#{name}", state="hidden")
    page.click("#who")
    look("name")
    page.keyboard.press("Escape")
    page.evaluate("document.querySelector('[data-act=tour]').click()")
    look("tour")
    page.keyboard.press("Escape")
    page.keyboard.press("Shift+ArrowRight")
    page.wait_for_function("gruber.parts.point.draft")
    look("draft")
    page.keyboard.press("Escape")
    caught_up(page)
    page.keyboard.press("n")
    page.wait_for_selector("#reasons:not([hidden])")
    look("reasons")
    page.click('.chip[data-state="rejected"]')
    page.wait_for_function("gruber.parts.point.state === 'rejected'")
    look("rejected")
    assert {name: lines for name, lines in found.items() if lines} == {}


def test_who_goes_to_the_settings_is_asked_about_what_is_at_work__law(desk, sit):
    """A run, an update of the results or a search was cancelled without a word."""
    page = sit(scene=False)
    left = []

    def leave(route):
        left.append(route.request.url)
        route.fulfill(json={})

    page.route("**/settings", leave)
    asked = ".notice.grave:has-text('Settings stop')"
    for work in ("remaking", "filling"):
        page.evaluate(f"gruber.parts.status.{work} = {{ share: 0.5, what: '' }}")
        before = len(left)
        page.dblclick("#settings-open")  # a habit: the second click answers nothing
        page.wait_for_timeout(700)
        assert len(left) == before
        # Clicked away, it is asked anew.
        page.click(asked)
        page.wait_for_selector(asked, state="detached")
        page.click("#settings-open")
        page.wait_for_selector(asked)
        caught_up(page)
        assert len(left) == before
        with page.expect_request("**/settings"):
            page.click("#settings-open")
        page.evaluate(f"gruber.parts.status.{work} = null")
        with page.expect_request("**/settings"):
            page.click("#settings-open")
    page.route("**/run", lambda route: route.fulfill(json=AT_WORK))
    page.click("#settings-open")
    page.wait_for_selector(asked)


def test_a_desk_that_closes_for_the_settings_is_not_called_lost__law(tmp_path, sit_at, seats):
    """A page said that the desk does not answer, until the settings were there."""
    said = words()
    inputs = desk_inputs(tmp_path)
    with open_desk(inputs) as opened:
        page = sit_at(opened.url, scene=False)
        page.route("**/settings", lambda route: route.fulfill(json={}))
        with page.expect_response("**/settings"):
            page.click("#settings-open")
    inputs.session.close()
    page.wait_for_selector("#lost:not([hidden])")
    assert page.text_content("#lost") == page.text_content("#wire") == said["settings.opening"]
    # They do not come: it is lost.
    page.evaluate("const now = Date.now; Date.now = () => now() + 60000")
    page.wait_for_selector(f"#lost:has-text('{said['lost.title']}')")
    assert page.text_content("#wire") == said["status.lost"]
    seats.leave()
