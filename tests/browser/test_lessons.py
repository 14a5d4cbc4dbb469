"""The lessons in a browser: each opened, moved, and its question answered wrong and right."""

import csv
import re
from dataclasses import replace
from urllib.parse import urlencode

import pytest

from app.found_lessons import find_lessons
from app.lessons.ransac import LESSON, search_of
from app.teaching import Teacher, open_teaching, state_of
from tests.app.lessons.test_textbook import CHECKS
from ui.web.access import Door

READY = "#figures b"
pytestmark = pytest.mark.usefixtures("teaching_cache")
LESSONS = find_lessons()


def settled(page):
    """Wait until the page has shown the newest state."""
    page.wait_for_function("!gruber.state.asking")


def test_scale_bars_axes_and_grids_are_drawn__law(learn):
    page, _ = learn("interior")
    strokes = page.evaluate(
        "[...document.querySelectorAll('svg path:is(.bar, .grid, .nought)')]"
        ".map(e => getComputedStyle(e).stroke)"
    )
    assert len(strokes) > 3
    assert "none" not in strokes


def test_a_typed_number_has_a_comma_or_a_point__law(learn):
    page, _ = learn("relief", language="cs")
    typed = page.locator("[data-typed]").first
    name = typed.get_attribute("data-typed")
    for text in ("10,5", "10.5"):
        typed.fill(text)
        typed.press("Enter")
        settled(page)
        assert page.evaluate(f"gruber.state.values['{name}']") == 10.5
        assert typed.input_value() == "10,5"


@pytest.mark.parametrize("name", LESSONS)
def test_a_lesson_is_moved_and_answered_without_an_error__law(learn, name):
    page, wrong = learn(name)
    teacher, lesson = Teacher(LESSONS), LESSONS[name]
    for slider in lesson.sliders:
        if slider.moved_in or page.locator(f"#slider-{slider.name}").count() == 0:
            continue
        page.locator("#reset").click()
        settled(page)
        before = page.locator("#drawings").inner_html() + page.locator("#below").inner_html()
        box = page.locator(f"#slider-{slider.name}")
        value = slider.low if slider.start != slider.low else slider.high
        if box.is_disabled():
            row = page.locator(f"[data-slider={slider.name}]")
            assert row.locator(".idle").inner_text(), "moves nothing, and does not say why"
            continue
        if slider.is_switch:
            box.click()
        else:
            box.fill(f"{value:g}")
        settled(page)
        state = page.evaluate("gruber.state.values")
        shown = page.evaluate(
            "[...document.querySelectorAll('[data-figure]')]"
            ".map(e => [e.dataset.figure, e.dataset.value])"
        )
        expected = teacher.view(name, state, truth=False)["figures"]
        for key, text in shown:
            told = expected[key]["value"]
            assert text == "null" if told is None else float(text) == pytest.approx(told)
        after = page.locator("#drawings").inner_html() + page.locator("#below").inner_html()
        assert before != after, slider.name
    answer_wrong_and_right(page, teacher, name)
    assert wrong == []


@pytest.mark.parametrize("name", sorted({name for name, *_ in CHECKS}))
def test_the_number_on_screen_is_that_of_engine_and_print__paper(learn, lessons, name):
    """Every row of the table of textbook values, opened as a link."""
    page, wrong = learn(name)
    for state, figure, printed, tolerance, source in (row for own, *row in CHECKS if own == name):
        page.goto(f"{lessons.url}&{urlencode({'lesson': name} | state)}")
        page.wait_for_selector(READY)
        text = page.locator(f'[data-figure="{figure}"] b').text_content()
        number, decimals = re.match(r"([\u2212\d\u202f]+)(?:\.(\d+))?", text).groups()
        said = number.replace("\u2212", "-").replace("\u202f", "") + f".{decimals or 0}"
        view = LESSONS[name].view(state_of(LESSONS[name], state))
        engine = view.figures[figure].value
        half = 0.5 * 10.0 ** -len(decimals or "")
        assert float(said) == pytest.approx(engine, abs=1.001 * half), source
        assert float(said) == pytest.approx(printed, abs=tolerance + half), source
    assert wrong == []


def answer_wrong_and_right(page, teacher, name):
    with page.expect_request(re.compile("/answer$")) as asked:
        page.locator("#answer").fill("-987654")
        page.locator("#check").click()
    page.wait_for_selector("#said.wrong")
    sent = asked.value.post_data_json
    truth = teacher.judge(name, sent["which"], sent["seed"], None)["answer"]
    page.locator("#answer").fill(f"{truth:.4f}")
    page.locator("#check").click()
    page.wait_for_selector("#said.right")
    assert page.locator("#score").inner_text() == "1 of 1 right"
    done = page.locator("#list [data-done]")
    assert [one.get_attribute("data-lesson") for one in done.all()] == [name]


def test_a_point_is_dragged_and_pushed_by_keys__law(learn):
    page, wrong = learn("resection")
    knob = page.locator(".handle[data-names='x1 y1']").bounding_box()
    page.mouse.move(knob["x"] + knob["width"] / 2, knob["y"] + knob["height"] / 2)
    page.mouse.down()
    page.mouse.move(knob["x"] + 90, knob["y"] + 70, steps=4)
    page.mouse.up()
    settled(page)
    state = page.evaluate("gruber.state.values")
    assert state["x1"] > -800
    assert state["y1"] < 700
    page.locator(".handle[data-names='x1 y1']").focus()
    page.keyboard.press("ArrowRight")
    settled(page)
    assert page.evaluate("gruber.state.values")["x1"] == state["x1"] + 10
    assert wrong == []


def test_a_drawing_in_space_is_turned_by_hand_keys_and_buttons__law(learn):
    page, wrong = learn("tilt")
    sheet = page.locator("svg.in-space")
    seen = [sheet.inner_html()]
    box = sheet.bounding_box()
    page.mouse.move(box["x"] + 200, box["y"] + 150)
    page.mouse.down()
    page.mouse.move(box["x"] + 320, box["y"] + 190, steps=3)
    page.mouse.up()
    seen.append(sheet.inner_html())
    page.mouse.move(box["x"] + 100, box["y"] + 100)
    assert sheet.inner_html() == seen[-1]
    sheet.focus()
    page.keyboard.press("ArrowUp")
    seen.append(sheet.inner_html())
    page.locator("[data-side=above]").click()
    seen.append(sheet.inner_html())
    assert len(set(seen)) == 4
    page.locator("[data-side=oblique]").click()
    assert sheet.inner_html() == seen[0]
    page.locator("#slider-t").fill("5")
    settled(page)
    assert sheet.inner_html() != seen[0]
    assert wrong == []


def test_template_and_window_are_dragged_over_scan_and_ortho__law(learn):
    page, wrong = learn("places")
    assert page.locator("#drawings image").count() == 3
    sizes = page.evaluate(
        "Promise.all([...document.querySelectorAll('#drawings image')].map(async e => {"
        "const made = new Image(); made.src = e.href.baseVal; await made.decode();"
        "return made.width; }))"
    )
    assert sizes == [261, 261, 59]
    best = page.locator("[data-figure=best]").get_attribute("data-value")
    for names, (x, y) in (("tx ty", (0, 0)), ("wx wy", (1, 1))):
        knob = page.locator(f".handle[data-names='{names}']").bounding_box()
        page.mouse.move(knob["x"] + knob["width"] / 2, knob["y"] + knob["height"] / 2)
        page.mouse.down()
        page.mouse.move(knob["x"] + 30 + 9 * x, knob["y"] - 20 - 9 * y, steps=3)
        page.mouse.up()
        settled(page)
    state = page.evaluate("gruber.state.values")
    assert min(state["tx"], state["ty"], state["wx"], state["wy"]) > 5
    assert page.locator("[data-figure=best]").get_attribute("data-value") != best
    # A patch of the ortho is sought in the scan: both handles change places.
    page.locator("[data-choice=way][data-value='4']").click()
    settled(page)
    drawings = page.locator(".drawing")
    assert drawings.nth(0).locator("[data-names='wx wy']").count() == 1
    assert drawings.nth(1).locator("[data-names='tx ty']").count() == 1
    assert wrong == []


def test_ransac_goes_forward_and_back_by_one_step__law(learn):
    page, wrong = learn("ransac")
    words = Teacher(LESSONS).listed("en")["words"]
    for phase in ("sample", "model", "agreeing", "best", "sample"):
        page.locator("[data-pace=forward]").click()
        settled(page)
        assert page.locator("#about p").first.inner_text() == words[f"lesson.ransac.step.{phase}"]
    assert page.locator("#slider-samples").is_disabled()
    assert page.locator("[data-figure=sample]").get_attribute("data-value") == "2"
    for _ in range(6):
        page.locator("[data-pace=back]").click()
        settled(page)
    assert page.evaluate("gruber.state.values.step") == 0
    assert page.locator("#about p").first.inner_text() == words["lesson.ransac.idea"]
    assert wrong == []


def test_sliders_of_a_published_block_show_what_is_in_force__law(learn):
    page, wrong = learn("ransac")
    shown = "['half', 'limit'].map(n => document.querySelector(`[data-typed=${n}]`).value)"
    model = page.locator("[data-choice=model].on")
    own = page.evaluate(shown), model.get_attribute("data-value")
    page.locator("[data-choice=block][data-value='1']").click()
    settled(page)
    search, limit = search_of(LESSON.start | {"block": 1})
    assert [float(one) for one in page.evaluate(shown)] == [search.half_m, limit]
    assert page.evaluate(shown) != own[0]
    assert model.count() == 1
    page.locator("[data-choice=block][data-value='0']").click()
    settled(page)
    assert (page.evaluate(shown), model.get_attribute("data-value")) == own
    assert wrong == []


def test_what_moves_nothing_is_shut_and_says_why__law(learn):
    page, wrong = learn("triangulation")
    why = page.locator("[data-slider=gnss] .idle")
    for method, shut in ((1, True), (2, True), (3, False), (4, False)):
        page.locator(f"[data-choice=method][data-value='{method}']").click()
        settled(page)
        assert page.locator("#slider-gnss").is_disabled() == shut
        assert why.count() == shut
        assert page.locator("[data-choice=about].on").count() == (method == 1)
    page.locator("#slider-control").fill("2")
    settled(page)
    assert "turn about the line" in page.locator("#figures .beware").inner_text()
    page.locator("#slider-gnss").click()
    settled(page)
    assert page.locator("#figures .beware").count() == 0
    assert wrong == []


def test_least_squares_shows_what_it_found_and_gives_the_hand_its_own_back__law(learn):
    page, wrong = learn("relative")
    omega = page.locator("#slider-omega")
    omega.fill("0.5")
    for _ in range(2):
        page.locator("#slider-solve").click()
        settled(page)
        figure = page.locator("[data-figure=omega]").get_attribute("data-value")
        assert float(omega.input_value()) == pytest.approx(float(figure), abs=0.006)
    assert (omega.is_enabled(), omega.input_value()) == (True, "0.5")
    page.locator("#truth").click()
    page.wait_for_selector("[data-figure=omega] em")
    page.locator("#reset").click()
    page.wait_for_selector("[data-figure=omega] em", state="detached")
    assert not page.evaluate("gruber.state.truth")
    assert wrong == []


def test_the_truth_is_shown_on_demand_and_a_link_keeps_the_state__law(learn, lessons):
    page, _ = learn("stereo")
    assert page.locator("[data-figure=height]").count() == 0
    page.locator("#truth").click()
    page.locator("#slider-B").fill("1200")
    page.wait_for_selector("[data-figure=height] em")
    page.wait_for_function("location.search.includes('B=1200')")
    page.goto(page.url)
    page.wait_for_selector("[data-figure=height] em")
    assert page.evaluate("gruber.state.values.B") == 1200


def test_back_returns_to_the_lesson_before_as_it_was__law(learn):
    page, wrong = learn("relief")
    page.locator("#slider-h").fill("20")
    settled(page)
    page.click("[data-lesson=stereo]")
    page.wait_for_selector("#slider-mark")
    page.go_back()
    page.wait_for_selector("#slider-h")
    assert page.locator("#slider-h").input_value() == "20"
    page.go_forward()
    page.wait_for_selector("#slider-mark")
    assert wrong == []


def test_a_link_without_a_value_opens_the_lesson_with_its_own__law(learn, lessons):
    page, _ = learn("relief")
    opening = page.locator("#slider-h").input_value()
    page.goto(f"{lessons.url}&lesson=relief&h=")
    page.wait_for_selector(READY)
    assert page.locator("#slider-h").input_value() == opening != "0"


def test_what_no_longer_holds_is_greyed_and_said_in_the_place_of_the_figures__law(sit_at):
    """A state without a picture, come to by a slider and by a link, and left again."""
    relief = LESSONS["relief"]

    def view(state):
        return relief.view(state | {"H": 1 / (state["h"] - 5) * 0 + state["H"]})

    found = {"relief": replace(relief, view=view), "stereo": LESSONS["stereo"]}
    with open_teaching(found, Door()) as opened:
        page = sit_at(f"{opened.url}&lesson=relief", scene=False, ready=READY)
        said = page.locator("#figures [role=alert]")
        assert relief.sliders[0].low <= 5
        for leave in ("slider", "lesson"):
            page.locator("#slider-h").fill("5")
            said.wait_for()
            assert said.inner_text().startswith("Relief displacement: a tower leans outwards:")
            assert page.locator("#figures b").count() == 0
            for room in ("#drawings", "#below"):
                assert page.locator(room).evaluate("e => getComputedStyle(e).opacity < 0.5")
            if leave == "slider":
                page.locator("#slider-h").fill("20")
            else:
                page.click("[data-lesson=stereo]")
            page.wait_for_selector(READY)
            assert said.count() == page.locator("[data-stale]").count() == 0
            assert page.locator(".notice").count() == 0
        page.goto(f"{opened.url}&lesson=relief&h=5")
        said.wait_for()
        page.locator("#slider-h").fill("20")
        page.wait_for_selector(READY)
        assert page.locator("#drawings svg *").count() > 3


def test_two_students_have_a_state_each__law(learn):
    (one, _), (other, _) = learn("relief"), learn("relief", language="cs-CZ")
    one.locator("#slider-h").fill("20")
    settled(one)
    assert other.evaluate("gruber.state.values.h") == 150
    assert other.locator("#about h1").inner_text().startswith("Radiální posun")


def test_answers_are_saved_as_a_table_for_excel__law(learn):
    page, _ = learn("relief")
    page.locator("#slider-h").fill("20")
    settled(page)
    answer_wrong_and_right(page, Teacher(LESSONS), "relief")
    page.on("dialog", lambda dialog: dialog.accept('=Žofie "A"'))
    with page.expect_download() as saved:
        page.locator("#answers-save").click()
    whole = saved.value.path().read_bytes()
    assert whole.startswith(b"\xef\xbb\xbf")
    rows = list(csv.DictReader(whole.decode("utf-8-sig").splitlines()))
    assert [row["result"] for row in rows] == ["wrong", "right"]
    assert rows[0]["student"] == '\'=Žofie "A"'
    assert float(rows[0]["answer"]) == -987654
    assert "h=20" in rows[0]["sliders"]
    assert rows[0]["right_answer"] == rows[1]["right_answer"]


@pytest.mark.parametrize("hide", [False, True])
def test_a_copied_link_lets_a_student_in_who_sees_no_hidden_truth__law(sit_at, hide):
    with open_teaching(LESSONS, Door(), hide_truth=hide) as opened:
        page = sit_at(f"{opened.url}&lesson=stereo", scene=False, ready=READY)
        assert page.locator("#truth").count() == 1
        page.locator("#slider-B").fill("1200")
        page.locator("#truth").click()
        page.wait_for_selector("[data-figure=height] em")
        page.evaluate(
            "Object.defineProperty(navigator, 'clipboard', { value: "
            "{ writeText: async (text) => { window.copied = text; } } })"
        )
        page.locator("#link-copy").click()
        page.wait_for_function("window.copied")
        link = page.evaluate("window.copied")
        assert opened.token not in link
        # Another machine, which has no cookie yet.
        student = sit_at(link, scene=False, ready=READY)
        assert student.evaluate("gruber.state.values.B") == 1200
        assert student.locator("#truth").count() == (0 if hide else 1)
        assert student.locator("[data-figure=height]").count() == (0 if hide else 1)


def test_the_right_amount_with_the_wrong_sign_is_told_as_such__law(learn):
    page, _ = learn("corrections")
    assert "inwards as \u2212" in page.locator("#question .asked").inner_text()
    with page.expect_request(re.compile("/answer$")) as asked:
        page.locator("#answer").fill("987654")
        page.locator("#check").click()
    sent = asked.value.post_data_json
    truth = Teacher(LESSONS).judge("corrections", sent["which"], sent["seed"], None)["answer"]
    page.locator("#answer").fill(f"{-truth + 1:.2f}")
    page.locator("#check").click()
    page.wait_for_function("document.getElementById('said').textContent.includes('amount')")
    page.locator("#answer").fill(f"\u2212{-truth:.2f}")
    page.locator("#check").click()
    page.wait_for_selector("#said.right")


@pytest.mark.parametrize("theme", ["dark", "light"])
def test_a_lesson_can_be_used_by_everyone__law(learn, axe, theme):
    from tests.browser.conftest import VIOLATIONS

    page, _ = learn("resection")
    if theme == "light":
        page.locator("[data-act=theme]").click()
    page.evaluate(axe)
    assert page.evaluate(VIOLATIONS, {}) == []


@pytest.mark.parametrize("language", ["en", "cs"])
def test_each_step_of_the_chain_has_its_drawings_text_formula_and_source__law(learn, language):
    page, wrong = learn("chain", language=language, size={"width": 1366, "height": 768})
    teacher = Teacher(LESSONS)
    words = teacher.listed(language)["words"]
    for step in range(1, 11):
        page.locator("#slider-step").fill(str(step))
        settled(page)
        view = teacher.view("chain", page.evaluate("gruber.state.values"), truth=False)
        assert page.locator(".drawing").count() == len(view["canvases"])
        titles = [words[f"lesson.chain.canvas.{one['name']}"] for one in view["canvases"]]
        assert page.locator(".drawing figcaption").all_inner_texts() == titles
        pictures = [canvas for canvas in view["canvases"] if canvas["picture"]]
        assert page.locator(".drawing image").count() == len(pictures)
        assert page.locator("#about p").first.inner_text().startswith(f"{step} ")
        source = words[f"lesson.chain.source_of.{view['step']}"]
        assert source in page.locator("#formulas .source").inner_text()
        room = page.locator("#formulas")
        assert room.evaluate("e => e.scrollWidth <= e.clientWidth")
    assert wrong == []
