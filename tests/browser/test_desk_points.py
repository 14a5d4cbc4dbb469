"""The sheet of points in Chromium: a list dropped, its columns named, a row refused, all undone."""

import pytest

from app.desk.wiring import open_desk
from tests.browser.hands import caught_up, until
from tests.ui.user_points import measuring_inputs, true_places

DROP = """([name, text]) => {
  const dataTransfer = new DataTransfer();
  dataTransfer.items.add(new File([text], name));
  dispatchEvent(new DragEvent("drop", { dataTransfer, cancelable: true }));
}"""


@pytest.fixture
def inputs(tmp_path):
    inputs = measuring_inputs(tmp_path)
    yield inputs
    inputs.session.close()


@pytest.fixture
def page(inputs, sit_at):
    with open_desk(inputs) as desk:
        yield sit_at(desk.url, scene=False)


def lines():
    """Two points beside listed ones, and a row whose easting is no number; no header."""
    rows = []
    for name in ("T1", "T2"):
        east, north, height = (float(value) for value in true_places()[name])
        rows.append(f"mill;M{name};{east + 20:.2f};{north + 20:.2f};{height:.2f}")
    return "\n".join([*rows, "barn;B1;somewhere;-1041000.0;300.0"]) + "\n"


def test_a_dropped_list_comes_in_by_its_columns_and_goes_by_one_undo__truth(page, inputs):
    page.evaluate(DROP, ["survey.csv", lines()])
    page.wait_for_selector("#points[open] .points-table")
    assert "survey.csv" in page.inner_text("#points")
    for place, name in enumerate(("description", "id", "X", "Y", "Z")):
        page.select_option(f"#points-column-{place}", name)
        page.wait_for_function(
            "([n, name]) => document.getElementById(`points-column-${n}`)?.value === name",
            arg=[place, name],
        )
    assert page.locator("#points-bring").is_disabled()
    page.click("#points-ask-refused-0")
    page.wait_for_selector("#points-bring:not([disabled])")
    refused = page.inner_text("#points details")
    assert "somewhere" in refused
    assert "3" in refused
    assert page.locator(".points-dot").count() == 2
    page.click("#points-bring")
    page.wait_for_function("gruber.parts.rows.some(row => row[0] === 'MT1')")
    page.wait_for_selector("#points", state="hidden")
    surveyed = inputs.session.replayed(inputs.block).surveyed
    assert {"MT1", "MT2"} <= set(surveyed)
    assert "B1" not in surveyed
    assert surveyed["MT1"].position[0] == pytest.approx(true_places()["T1"][0] + 20, abs=0.01)
    assert surveyed["MT1"].description == "mill"
    page.keyboard.press("u")
    page.wait_for_function("!gruber.parts.rows.some(row => row[0] === 'MT1')")
    assert "MT1" not in inputs.session.replayed(inputs.block).surveyed


def test_a_list_comes_in_once_however_often_its_button_is_pressed__law(page, inputs):
    rows = lines().splitlines()[:2]
    page.evaluate(DROP, ["two.csv", "\n".join(["description;id;X;Y;Z", *rows]) + "\n"])
    page.wait_for_selector("#points-bring:not([disabled])")
    twice = "() => { for (const _ of [1, 2]) document.getElementById('points-bring').click(); }"
    page.evaluate(twice)
    page.wait_for_function("gruber.parts.rows.some(row => row[0] === 'MT1')")
    page.wait_for_selector("#points", state="hidden")
    page.keyboard.press("u")
    page.wait_for_function("!gruber.parts.rows.some(row => row[0] === 'MT1')")
    page.click("#points-open")
    for name, value in {"id": "ONE", "X": "0", "Y": "0", "Z": "280"}.items():
        page.fill(f"#points-one-{name}", value)
    page.click("#points-one-bring")
    page.wait_for_selector("#points .bad:has-text('far outside the block')")
    caught_up(page)
    page.evaluate(twice.replace("points-bring", "points-one-bring"))
    page.wait_for_selector("#points", state="hidden")
    # What is brought is recorded by the desk, after the sheet has closed.
    until(page, lambda: len(inputs.session.decisions()) > 2)
    page.wait_for_timeout(300)
    said = [one.decision for one in inputs.session.decisions()]
    assert [type(one).__name__ for one in said] == ["BringPoints", "Withdraw", "BringPoints"]


def test_a_list_of_nothing_says_so_and_brings_nothing__law(page, inputs):
    page.evaluate(DROP, ["empty.csv", ""])
    page.wait_for_selector("#points[open]")
    page.wait_for_selector("#points .bad, #points-bring[disabled]")
    assert not inputs.session.decisions()


def test_a_typed_point_far_away_is_asked_about__law(page, inputs):
    page.click("#points-open")
    for name, value in {"id": "FAR", "X": "0", "Y": "0", "Z": "280"}.items():
        page.fill(f"#points-one-{name}", value)
    page.dblclick("#points-one-bring")  # a habit: the second click answers nothing
    page.wait_for_selector("#points .bad:has-text('far outside the block')")
    caught_up(page)
    # Of a point typed once more nothing is known.
    page.keyboard.press("Escape")
    page.click("#points-open")
    for name, value in {"id": "FAR", "X": "0", "Y": "0", "Z": "280"}.items():
        page.fill(f"#points-one-{name}", value)
    page.click("#points-one-bring")
    page.wait_for_selector("#points .bad:has-text('far outside the block')")
    caught_up(page)
    assert not inputs.session.decisions()
    page.click("#points-one-bring")
    page.wait_for_selector("#points", state="hidden")
    until(page, lambda: "FAR" in inputs.session.replayed(inputs.block).surveyed)


def test_what_is_typed_before_a_known_point_is_told_stays__law(page):
    """The answer of a slow desk wrote over it."""
    held = []
    page.route("**/points/known*", lambda route: held.append(route))
    page.click("#points-open")
    page.fill("#points-one-id", "T1")
    page.fill("#points-one-X", "17")
    until(page, lambda: held)
    held.pop().continue_()
    page.wait_for_function("document.getElementById('points-one-Y').value")
    assert page.input_value("#points-one-X") == "17"
    assert float(page.input_value("#points-one-Y")) == pytest.approx(true_places()["T1"][1], abs=1)
