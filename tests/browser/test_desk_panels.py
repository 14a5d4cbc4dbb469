"""New points, history, quality, people and looks in a real Chromium, by key and by pointer."""

from importlib.metadata import version

import pytest

from app.desk.wiring import open_desk
from sessions.session import Session
from tests.browser.conftest import PATIENCE_MS, SIZE
from tests.browser.hands import (
    accept,
    becomes,
    caught_up,
    current,
    gone_on,
    grow,
    look_at,
    settled,
    state_of,
    unfold,
)
from tests.ui.desk_block import desk_inputs
from ui.words.catalogue import words


def test_a_new_point_is_clicked_in_the_ortho_and_taken_back__truth(sit, desk):
    page = sit(scene=False)
    page.keyboard.press("p")
    page.wait_for_selector("#adding:not([hidden])")
    page.keyboard.press("Escape")
    page.wait_for_selector("#adding", state="hidden")
    page.click('[data-act="add"]')
    box = page.locator('.pane[data-pane="left"]').bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2 + 30, box["y"] + box["height"] / 2 + 20)
    page.wait_for_function("gruber.parts.point.key[0] === 'H1' && gruber.parts.point.draft")
    key = "|".join(page.evaluate("gruber.parts.point.key"))
    assert page.locator("#keep").is_visible()
    assert page.evaluate("gruber.parts.status.decided") == 0
    accept(page)
    page.wait_for_function("gruber.parts.status.decided === 2")
    assert state_of(page, key) == "accepted"
    caught_up(page)
    page.keyboard.press("u")
    page.wait_for_function("!gruber.parts.rows.some(row => row[0] === 'H1')")
    assert not page.inner_text("#drafts")


LOOKS = """[...document.querySelectorAll('.row')].map(row =>
  [row.dataset.key, row.getAttribute('aria-selected') === 'true',
    getComputedStyle(row).backgroundColor + getComputedStyle(row).boxShadow])"""


def looking_marked(page) -> set[str]:
    """Rows that do not look as the others do."""
    page.mouse.move(2, 2)
    found = page.evaluate(LOOKS)
    plain = {look for key, chosen, look in found if not chosen}
    assert all((look in plain) != chosen for _, chosen, look in found)
    return {key for key, chosen, _ in found if chosen}


def test_a_verdict_takes_exactly_the_rows_that_look_marked__law(sit):
    page = sit(scene=False)
    first = current(page)
    keys = [row[0] for row in page.evaluate(LOOKS)]
    second, third = [key for key in keys if key != first][:2]
    for key in (second, third):
        page.click(f'.row[data-key="{key}"]', modifiers=["Control"])
    assert looking_marked(page) == {first, second, third}
    # What decides tells about how many; the effect of one of them is not that of all.
    assert page.text_content("#acts [data-act=reject] > span") == "Reject 3"
    assert "together" in page.text_content("#trial")
    assert "\u2192" not in page.text_content("#trial") + page.text_content("#neighbours")
    # Taken out again, the current row is still shown, and no longer looks marked.
    page.click(f'.row[data-key="{first}"]', modifiers=["Control"])
    assert looking_marked(page) == {second, third}
    page.click(f'.row[data-key="{first}"]', modifiers=["Control"])
    page.click(f'.row[data-key="{third}"]', modifiers=["Control"])
    assert looking_marked(page) == {first, second}
    page.keyboard.press("m")
    page.wait_for_function("gruber.parts.status.decided === 2")
    assert page.text_content("#acts [data-act=reject] > span") == "Reject"
    assert {key: state_of(page, key) for key in (first, second, third)} == {
        first: "dubious", second: "dubious", third: "auto",
    }  # fmt: skip


def test_a_decision_of_the_history_is_taken_back_by_its_button__truth(sit):
    page = sit(scene=False)
    first = current(page)
    page.keyboard.press("m")
    gone_on(page, first)
    accept(page)
    page.wait_for_function("gruber.parts.status.decided === 2")
    look_at(page, first)
    unfold(page)
    page.click("#history button")
    page.wait_for_function("gruber.parts.status.decided === 1")
    assert state_of(page, first) == "auto"
    page.wait_for_selector("#history li.withdrawn")
    assert "UTC" in page.inner_text("#history h3")
    assert " UTC" in page.get_attribute("#history li", "title")
    page.click("#history button")
    page.wait_for_function("gruber.parts.status.decided === 2")
    assert state_of(page, first) == "dubious"


def test_quality_is_printed_light_with_date_operator_and_version__truth(sit):
    """In the dark theme it was black on dark, without a date."""
    page = sit(scene=False)
    assert page.evaluate("document.documentElement.dataset.theme") == "dark"
    page.keyboard.press("b")
    page.wait_for_selector("#quality p.verdict")
    assert not page.locator("#quality .printed").is_visible()
    page.evaluate(
        """addEventListener("beforeprint", () => {
             const line = document.querySelector("#quality .printed");
             window.paper = [document.documentElement.dataset.theme, line.textContent,
               ...[".printed", ".signed"].map(one =>
                 document.querySelector(`#quality ${one}`).checkVisibility())];
           })"""
    )
    page.emulate_media(media="print")
    page.pdf(print_background=True)
    # Names of photos and counts lead somewhere, and are read on paper.
    assert page.locator('#quality [data-part="photos"] button.link').first.is_visible()
    assert page.locator("#quality .cells button").first.is_visible()
    assert not page.locator("#quality-close").is_visible()
    theme, line, *seen = page.evaluate("window.paper")
    assert theme == "light"
    assert seen == [True, True]
    told = f"Printed {page.evaluate('new Date().toISOString().slice(0, 10)')}"
    assert line.startswith(told)
    assert line.endswith(f"UTC by anna, Gruber {version('gruber')}")
    page.wait_for_function("document.documentElement.dataset.theme === 'dark'")


def test_quality_follows_the_block_and_compares_adjustments__truth(sit):
    page = sit(scene=False)
    page.keyboard.press("b")
    page.wait_for_selector("#quality p.verdict")
    assert page.locator("#quality svg.map").count() == 3
    assert page.locator('#quality [data-part="photos"] tr').count() == 7
    page.keyboard.press("y")
    page.keyboard.press("b")
    page.wait_for_selector("#quality", state="hidden")
    assert page.evaluate("gruber.parts.status.decided") == 0
    caught_up(page)
    page.keyboard.press("n")
    settled(page)
    page.click('[data-act="quality"]')
    page.wait_for_function("gruber.parts.quality.milestones.length >= 2")
    page.select_option('[data-pair="1"]', "1")
    page.wait_for_function("gruber.parts.quality.compared.pair[1] === 1")
    assert page.evaluate("gruber.parts.quality.compared.shifts.every(s => s[1] === 0)")


def test_quality_leads_to_points_and_photos_in_the_queue__truth(sit):
    page = sit(scene=False)
    page.keyboard.press("b")
    page.wait_for_selector("#quality p.verdict")
    link = page.locator('#quality [data-part="photos"] button.link').first
    photo = link.inner_text()
    link.click()
    page.wait_for_selector("#quality", state="hidden")
    page.wait_for_function(
        "name => document.querySelector('#sieve-photo').value.endsWith(name)", arg=photo
    )
    page.keyboard.press("b")
    arrow = page.locator('#quality [data-map="residuals"] g.goes').last
    point = arrow.locator("title").text_content()
    arrow.dispatch_event("click")
    page.wait_for_selector("#quality", state="hidden")
    page.wait_for_function(
        "name => document.querySelector('.row.current').innerText.includes(name)", arg=point
    )
    # By key as well: Tab comes to the first arrow, arrows to the next.
    page.keyboard.press("b")
    page.focus('#quality [data-map="residuals"] g.goes[tabindex="0"]')
    page.keyboard.press("ArrowRight")
    point = page.evaluate("document.activeElement.getAttribute('aria-label')")
    page.keyboard.press("Enter")
    page.wait_for_selector("#quality", state="hidden")
    page.wait_for_function(
        "name => document.querySelector('.row.current').innerText.includes(name)", arg=point
    )
    assert page.evaluate("gruber.parts.status.decided") == 0


def test_quality_leads_from_parts_bars_and_doubts__truth(sit):
    page = sit(scene=False)
    page.keyboard.press("b")
    page.wait_for_selector("#quality p.verdict")
    quality = page.evaluate("gruber.parts.quality")
    assert page.locator("#quality .ramped .ramp").is_visible()
    cells = page.locator('#quality [data-part="control"] .cells button')
    counts = [int(text) for text in cells.all_inner_texts()]
    assert counts == [count for row in quality["control_cells"] for count in row]
    held = counts.index(max(counts))
    cells.nth(held).click()
    page.wait_for_selector("#quality", state="hidden")
    page.wait_for_selector("#sieve-area:not([hidden])")
    page.wait_for_function("gruber.parts.queue.filter.area.length === 4")
    shown = page.evaluate("new Set(gruber.areaShown().places.map(String)).size")
    assert shown >= counts[held]
    page.keyboard.press("b")
    bar = page.locator('#quality [data-part="rays"] button.link').last
    rays = int(bar.inner_text())
    bar.click()
    page.wait_for_selector("#desk[data-grown=block]")
    page.wait_for_function("gruber.parts.scene.layers.ties")
    # Those alone that the bar counts, until Esc.
    assert page.evaluate("gruber.parts.scene.rays") == rays
    page.keyboard.press("Escape")
    page.wait_for_function("!gruber.parts.scene.layers.ties && !gruber.parts.scene.rays")
    page.wait_for_selector("#desk:not([data-grown])")
    page.keyboard.press("b")
    page.locator("#quality li", has_text="check").locator("button").first.click()
    page.wait_for_selector("#quality", state="hidden")


def test_a_row_that_is_clicked_is_nudged_by_arrows__law(sit):
    page = sit(scene=False)
    page.locator(".row").nth(2).click()
    caught_up(page)
    page.keyboard.press("Shift+ArrowRight")
    page.wait_for_function("gruber.parts.point.draft")


def test_enter_in_the_queue_chooses_a_row_and_drafts_nothing__law(sit):
    page = sit(scene=False)
    page.focus("#table")
    page.keyboard.press("ArrowDown")
    caught_up(page)
    shown = current(page)
    page.keyboard.press("Enter")
    page.wait_for_timeout(300)
    caught_up(page)
    assert current(page) == shown
    assert page.evaluate("gruber.parts.queue.drafts.length") == 0
    assert page.locator(".notice").count() == 0
    # With the focus on the desk it is the desk's.
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press("Enter")
    page.wait_for_function("gruber.parts.queue.drafts.length || document.querySelector('.notice')")


def test_a_sort_by_hand_shows_the_top_and_keeps_the_row__law(sit):
    page = sit(scene=False, size={"width": 1366, "height": 620})
    page.click('[data-state="all"]')
    page.wait_for_function("gruber.parts.queue.filter.state === 'all'")
    top = "document.querySelector('#table').scrollTop"
    page.evaluate(top + " = 9999")
    page.locator(".row").last.click()
    caught_up(page)
    before = current(page)
    assert page.evaluate(top) > 0
    for descending in (True, False):
        page.click('[data-column="misfit"]')
        page.wait_for_function(
            "down => gruber.parts.queue.sort.column === 'misfit'"
            " && gruber.parts.queue.sort.descending === down",
            arg=descending,
        )
        page.wait_for_function(top + " === 0")
        caught_up(page)
        assert page.evaluate(top) == 0
        key = page.evaluate("gruber.parts.point.key.join('|')")
        assert key == before
    # Filtered before the order is there, it is the row that is seen.
    page.evaluate("""() => {
      document.querySelector('[data-column="misfit"]').click();
      document.querySelector('[data-state="all"]').click();
    }""")
    caught_up(page)
    page.wait_for_selector(f'.row.current[data-key="{before}"]')


def test_two_people_see_names_and_where_the_other_is__law(sit):
    anna, berta = sit(scene=False), sit(scene=False)
    berta.click("#who")
    berta.fill("#name-field", "Berta")
    berta.click("#naming button")
    anna.wait_for_selector(".person:has-text('Berta')")
    anna.click(".row.taken")
    anna.wait_for_selector("#also-here:has-text('Berta')")
    berta.keyboard.press("j")
    anna.wait_for_selector("#also-here", state="hidden")
    anna.wait_for_selector(".row.taken")
    berta.reload()
    berta.wait_for_function("window.gruber?.parts.status?.operator === 'Berta'")


def test_light_and_dark_and_the_tour__law(sit):
    page = sit(scene=False)
    page.click('[data-act="theme"]')
    assert page.evaluate("document.documentElement.dataset.theme") == "light"
    page.reload()
    page.wait_for_selector(".row.current")
    assert page.evaluate("document.documentElement.dataset.theme") == "light"
    page.keyboard.press("h")
    page.click("#help-close")
    page.wait_for_selector("#help", state="hidden")
    page.keyboard.press("h")
    page.click("#help button")
    for _ in range(5):
        page.click("#tour-next")
    page.wait_for_selector("#tour", state="hidden")


def test_the_first_enter_of_a_new_user_turns_the_tour_and_decides_nothing__law(
    chromium, desk, tmp_path
):
    context = chromium.new_context(viewport=SIZE, bypass_csp=True)
    context.set_default_timeout(PATIENCE_MS)
    page = context.new_page()
    page.goto(desk.url)
    page.wait_for_selector("#tour-next:focus")
    page.wait_for_function("gruber.parts.point")
    step = "document.querySelector('#tour footer span').textContent"
    for key in ("Enter", " ", "y", "n", "u", "ArrowRight"):
        page.keyboard.press(key)
    page.wait_for_timeout(600)
    assert page.evaluate(step) == "3 / 5"
    page.keyboard.press("Escape")
    page.wait_for_selector("#tour", state="hidden")
    with Session.open(tmp_path, "reader") as session:
        assert session.decisions() == ()
    page.reload()
    page.wait_for_selector(".row.current")
    assert not page.locator("#tour").is_visible()
    context.close()


def test_focused_controls_keep_their_keys_and_the_desk_has_the_rest__law(sit):
    page = sit(scene=False)
    before = page.evaluate("gruber.parts.point.figures.place")
    page.focus('[data-act="quality"]')
    page.keyboard.press("Enter")
    page.wait_for_selector("#quality[open]")
    page.keyboard.press("Escape")
    page.wait_for_selector("#quality", state="hidden")
    page.focus('[data-mode="swipe"]')
    page.keyboard.press(" ")
    assert page.evaluate("gruber.compareState().mode") == "swipe"
    assert not page.evaluate("gruber.compareState().blink")
    for slider in ("#contrast", "#swipe"):
        box = page.locator(slider).bounding_box()
        page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        value = float(page.input_value(slider))
        page.keyboard.press("ArrowRight")
        assert float(page.input_value(slider)) == value + 1
    page.focus("#sort-column")
    page.keyboard.press("ArrowDown")
    page.keyboard.press("ArrowDown")
    assert page.evaluate("document.activeElement.id") == "sort-column"
    # A letter is the desk's even beside a button or slider; a pointer leaves no focus behind.
    page.focus("#contrast")
    page.keyboard.press("h")
    page.wait_for_selector("#help[open]")
    page.keyboard.press("h")
    page.click('[data-mode="side"]')
    assert page.evaluate("document.activeElement.tagName") != "BUTTON"
    page.wait_for_timeout(600)
    assert page.evaluate("gruber.parts.status.decided") == 0
    assert page.evaluate("gruber.parts.point.figures.place") == before


def test_what_is_decided_leaves_the_list_and_the_rest_is_counted__law(sit):
    page = sit(scene=False)
    first, shown = current(page), page.evaluate("gruber.parts.queue.shown.length")
    accept(page)
    becomes(page, first, "accepted")
    # A key is of the row on screen: until the desk has gone on, N would turn the first one over.
    gone_on(page, first)
    page.keyboard.press("n")
    page.wait_for_function("gruber.parts.status.decided === 2")
    said = words()["queue.progress"].format(left=shown - 2, done=2)
    page.wait_for_selector(f"#progress-said:has-text('{said}')")
    assert page.evaluate("gruber.parts.queue.shown.length") == shown - 2
    here = current(page)
    tally = page.locator("#tally [data-tally] b").all_inner_texts()
    assert tally == [str(shown - 2), "1", "0", "1"]
    # Every filter keeps its place, and among all points J passes over what is decided.
    page.click('.chip[data-state="rejected"]')
    page.wait_for_function("gruber.parts.point.state === 'rejected'")
    page.click('.chip[data-state="open"]')
    page.wait_for_function("key => gruber.parts.point.key.join('|') === key", arg=here)
    look_at(page, first)
    page.wait_for_function("gruber.parts.point.state === 'accepted'")
    page.keyboard.press("j")
    page.wait_for_function("gruber.parts.point.state === 'auto'")


def test_a_queue_of_nothing_has_a_way_back__law(sit):
    page = sit(scene=False)
    page.fill("#sieve-text", "nowhere")
    page.wait_for_selector("#queue-all:visible")
    page.keyboard.press("Escape")
    page.wait_for_function("gruber.parts.queue.filter.text === ''")
    assert page.input_value("#sieve-text") == ""
    page.keyboard.press("Escape")
    page.select_option("#sieve-role", "fiducial")
    page.wait_for_selector("#queue-all:visible")
    page.keyboard.press("a")
    page.wait_for_function("gruber.parts.queue.filter.role === ''")
    assert page.evaluate("gruber.parts.queue.filter.state") == "all"
    page.wait_for_selector("#queue-empty", state="hidden")


def test_what_is_about_one_row_says_so_while_several_are_marked__law(sit):
    page = sit(scene=False)
    rows = page.locator("#rows .row")
    rows.nth(0).click()
    rows.nth(1).click(modifiers=["Control"])
    before = page.evaluate("gruber.parts.point.role")
    for key in ("c", "Enter"):
        page.keyboard.press(key)
        page.wait_for_selector(".notice:has-text('single row')")
        page.click(".notice:has-text('single row')")
    assert page.evaluate("gruber.parts.point.role") == before
    assert not page.evaluate("gruber.parts.point.draft")


def test_kinds_beside_points_have_a_queue_and_say_when_it_is_empty__law(sit):
    page = sit(scene=False)
    empty = words()["queue.empty.fiducial"]
    page.select_option("#sieve-role", "fiducial")
    page.wait_for_selector(f"#queue-empty:has-text('{empty}')")
    page.wait_for_selector(f"#nothing:visible:has-text('{empty}')")
    assert not page.is_visible("#hint"), "there is nothing to place"
    page.wait_for_selector("#acts button:not(:disabled)", state="detached")
    page.select_option("#sieve-role", "")
    page.wait_for_selector(".row.current")


def test_a_toggle_shows_that_it_is_on_under_the_pointer_too__law(sit):
    page, on = sit(scene=False), set()
    look = "b => getComputedStyle(b).backgroundColor"
    toggles = "mode=swipe", "mode=blend", "act=wallis", "layer=ties"
    for name in (f"button[data-{toggle}]" for toggle in toggles):
        button = page.locator(name)
        if "layer" in name:
            grow(page, "block")
        assert button.get_attribute("aria-pressed") == "false"
        button.hover()
        off = button.evaluate(look)
        button.click()
        page.wait_for_function("n => document.querySelector(n).ariaPressed === 'true'", arg=name)
        assert button.evaluate(look) != off
        on.add(button.evaluate(look))
    assert len(on) == 1, "toggles of the layers had a style of their own"


def test_what_a_button_says_is_what_its_hint_says__law(sit):
    """The hint spoke of orthos while the button wrote results."""
    page, texts = sit(scene=False), words()
    hint = """async changes => {
      const { showStatus } = await import("/pages/status.js");
      showStatus({ ...gruber.parts.status, ...changes });
      const { textContent, title } = document.getElementById("remake-start");
      return [textContent, title];
    }"""
    photo = page.evaluate("gruber.parts.rows[0][1]")
    for stale, name in (([], "remake.write"), ([photo], "remake")):
        shown = page.evaluate(hint, {"stale": stale, "written": False})
        assert shown == [texts[name], texts[f"{name}.tip"]]


def test_the_wipe_line_is_dragged_in_the_picture_and_places_nothing__law(sit):
    page = sit(scene=False)
    page.click('[data-mode="swipe"]')
    before = page.evaluate("gruber.compareState().view")
    box = page.locator('.pane[data-pane="left"]').bounding_box()
    x, y = box["x"] + 0.4 * box["width"], box["y"] + box["height"] / 3
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 0.35 * box["width"], y, steps=5)
    page.mouse.up()
    assert page.evaluate("gruber.compareState().share") == pytest.approx(0.75, abs=0.02)
    assert float(page.input_value("#swipe")) == pytest.approx(75, abs=2)
    page.wait_for_timeout(300)
    assert page.evaluate("gruber.compareState().view") == before
    assert page.evaluate("gruber.parts.point.draft") is None


def test_a_report_that_was_written_beside_the_desk_is_told_listed_and_shown__law(sit_at, tmp_path):
    results = tmp_path / "results"
    results.mkdir()
    (results / "report.html").write_text("<p>of yesterday</p>", encoding="utf-8")
    inputs = desk_inputs(tmp_path, results=results)
    with open_desk(inputs) as opened:
        page = sit_at(opened.url, scene=False)
        page.click("#results-open")
        with page.expect_popup() as asked:
            page.click("#results a[href$='report.html']")
        report = asked.value
        report.wait_for_selector("text=of yesterday")
        (results / "misfit.csv").write_text("a", encoding="utf-8")
        (results / "report.html").write_text("<p>of today</p>", encoding="utf-8")
        report.wait_for_selector("text=of today")
        page.wait_for_selector("#results[open] a[href$='misfit.csv']")
        assert words("en")["results.file.misfit.csv"] in page.inner_text("#results")
        said = page.locator(".notice").all_inner_texts()
        assert words("en")["notice.written-beside"] in said
    inputs.session.close()
