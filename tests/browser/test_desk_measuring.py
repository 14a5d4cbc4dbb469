"""A listed point measured in Chromium: expected, clicked, proposed, corrected, accepted."""

import numpy as np
import pytest

from app.desk.wiring import open_desk
from tests.browser.hands import caught_up, current, settled
from tests.ui.desk_block import adjust
from tests.ui.user_points import measuring_inputs, true_pixel, true_places

AT = """([column, row]) => {
  const { raw, marks } = gruber.parts.point;
  const { view } = gruber.compareState();
  const [[a, b], [c, d]] = raw.matrix;
  const [x, y] = [column - raw.predicted[0], row - raw.predicted[1]];
  const whole = a * d - b * c;
  const east = marks.predicted[0] + (d * x - b * y) / whole - view.east;
  const north = marks.predicted[1] + (a * y - c * x) / whole - view.north;
  const box = document.querySelector(".pane[data-pane=right]").getBoundingClientRect();
  return [box.x + box.width / 2 + east * view.scale, box.y + box.height / 2 - north * view.scale];
}"""
"""Where the screen shows a pixel of the raw scan."""


@pytest.fixture
def inputs(tmp_path):
    inputs = measuring_inputs(tmp_path)
    yield inputs
    inputs.session.close()


@pytest.fixture
def page(inputs, sit_at):
    with open_desk(inputs) as desk:
        page = sit_at(desk.url, scene=False)
        page.click('.chip[data-state="measure"]')
        page.wait_for_function("gruber.parts.point?.state === 'predicted'")
        page.wait_for_function("gruber.compareState().drawn.whole")
        yield page


def key_of(page):
    return tuple(page.evaluate("gruber.parts.point.key"))


def click_at_truth(page):
    """Click where the scan really shows the point; its key."""
    key = key_of(page)
    page.mouse.click(*page.evaluate(AT, true_pixel(key).tolist()))
    page.wait_for_function("gruber.parts.point.draft")
    return key


def keep(page):
    """Keep what is drafted or proposed, and be at the next."""
    before = current(page)
    caught_up(page)
    page.keyboard.press("y")
    page.wait_for_function("key => gruber.parts.point?.key.join('|') !== key", arg=before)


def placed(inputs):
    block = inputs.session.replayed(inputs.block)
    return {key: m for key, m in block.measurements.items() if key[0].startswith("T")}


def test_an_operator_measures_a_listed_point_in_three_photos__truth(page, inputs):
    first = click_at_truth(page)
    keep(page)
    assert key_of(page)[0] == first[0]
    page.wait_for_function("gruber.parts.point.state === 'proposed'")
    second = key_of(page)
    keep(page)
    page.wait_for_function("gruber.parts.point.state === 'proposed'")
    third = key_of(page)
    for _ in range(2):
        page.keyboard.press("ArrowLeft")
    keep(page)
    found = placed(inputs)
    assert set(found) == {first, second, third}
    for key, measured in found.items():
        assert measured.status == "accepted"
        # A click is as good as a pixel of the screen, a proposal a fifth of a pixel beside.
        assert np.hypot(*(measured.pixel[0] - true_pixel(key))) < 1.0
    assert found[second].sigma_px == pytest.approx(0.25)
    left = page.evaluate("gruber.parts.rows.filter(r => r[0] === gruber.parts.point.key[0])")
    assert sum(row[3] == "accepted" for row in left) == 3


def test_all_proposals_are_accepted_at_once_and_undone_at_once__law(page, inputs):
    first = click_at_truth(page)
    keep(page)
    page.wait_for_selector("#proposals:not([hidden])")
    caught_up(page)
    page.keyboard.press("Shift+Y")
    page.wait_for_function("name => gruber.parts.point.key[0] !== name", arg=first[0])
    photos = {key[1] for key in placed(inputs)}
    assert len(photos) >= 3
    assert all(measured.status == "accepted" for measured in placed(inputs).values())
    page.keyboard.press("u")
    page.wait_for_function("name => gruber.parts.point.key[0] === name", arg=first[0])
    assert set(placed(inputs)) == {first}


def test_what_cannot_be_seen_leaves_the_list_and_the_strip_says_so__law(page, inputs):
    key = key_of(page)
    page.keyboard.press("y")
    page.wait_for_selector(".notice")
    assert placed(inputs) == {}
    caught_up(page)
    page.keyboard.press("v")
    page.wait_for_function("photo => gruber.parts.point.key[1] !== photo", arg=key[1])
    assert placed(inputs)[key].reason == "not visible"
    page.wait_for_selector(f'.other.unseen[title^="{key[1]}"]')
    page.click(f'.other.unseen[title^="{key[1]}"]')
    page.wait_for_function("photo => gruber.parts.point.key[1] === photo", arg=key[1])


def test_a_detail_of_two_scans_gets_coordinates_and_is_undone_as_one__truth(page, inputs):
    name, photo = key_of(page)
    page.keyboard.press("p")
    page.wait_for_selector("#adding:not([hidden])")
    page.mouse.click(*page.evaluate(AT, true_pixel((name, photo)).tolist()))
    page.wait_for_function("gruber.parts.point.key[0] === 'N001' && gruber.parts.point.draft")
    assert key_of(page) == ("N001", photo)
    assert inputs.session.decisions() == ()
    assert not page.locator("#adding").is_visible()
    keep(page)
    page.wait_for_function("gruber.parts.point.key[0] === 'N001'")
    assert "E " not in page.inner_text("#trial")
    page.wait_for_function("gruber.parts.point.state === 'proposed'")
    keep(page)
    page.wait_for_function("document.getElementById('trial').textContent.includes('E ')")
    settled(page)
    figures = page.evaluate("gruber.parts.point.figures")
    off = np.array(figures["surveyed"]) - true_places()[name]
    assert figures["source"] == "hand"
    assert (np.abs(off) < 4 * np.array(figures["surveyed_sigma"])).all()
    block = inputs.session.replayed(inputs.block)
    (told,) = adjust(block).new_points
    assert figures["surveyed_sigma"] == pytest.approx(told.sigma_m, abs=0.01)
    assert sum(key[0] == "N001" for key in block.measurements) == 2
    page.keyboard.press("u")
    page.wait_for_function("!gruber.parts.rows.some(row => row[0] === 'N001')")
    block = inputs.session.replayed(inputs.block)
    assert "N001" not in block.surveyed
    page.keyboard.press("Shift+U")
    page.wait_for_function("gruber.parts.rows.filter(r => r[0] === 'N001' && r[4]).length === 2")


def test_a_new_point_that_is_dropped_leaves_nothing__law(page, inputs):
    key = key_of(page)
    page.keyboard.press("p")
    page.mouse.click(*page.evaluate(AT, true_pixel(key).tolist()))
    page.wait_for_function("gruber.parts.point.key[0] === 'N001' && gruber.parts.point.draft")
    page.keyboard.press("Escape")
    page.wait_for_function("!gruber.parts.rows.some(row => row[0] === 'N001')")
    assert inputs.session.decisions() == ()
    assert not page.inner_text("#drafts")
    assert key_of(page)


GRAY = """name => {
  const canvas = document.querySelector(`.pane[data-pane=${name}] .picture`);
  const at = [canvas.width / 2 - 60, canvas.height / 2 - 60];
  const { data } = canvas.getContext("2d").getImageData(...at, 120, 120);
  return [...data].filter((_, index) => index % 4 === 1);
}"""


def test_without_an_ortho_the_scan_where_it_was_measured_lies_beside__truth(tmp_path, sit_at):
    inputs = measuring_inputs(tmp_path, has_ortho=False)
    with open_desk(inputs) as desk:
        page = sit_at(desk.url, scene=False)
        page.click('.chip[data-state="measure"]')
        page.wait_for_function("gruber.parts.point?.state === 'predicted'")
        page.wait_for_function("gruber.compareState().drawn.whole")
        first = click_at_truth(page)
        keep(page)
        page.wait_for_function("gruber.parts.point.state === 'proposed'")
        page.wait_for_function("gruber.compareState().drawn.whole")
        label = page.locator('.pane[data-pane="left"] .label').inner_text()
        assert label.endswith(first[1][-2:])
        assert key_of(page)[1] != first[1]
        left, right = (np.array(page.evaluate(GRAY, name), float) for name in ("left", "right"))
        # The same ground in two scans, the mark over both.
        assert np.corrcoef(left, right)[0, 1] > 0.6
    inputs.session.close()


def test_an_unlikely_proposal_is_not_accepted_with_the_others__law(page, inputs):
    first = click_at_truth(page)
    keep(page)
    page.wait_for_selector("#proposals:not([hidden])")
    caught_up(page)
    wrong = page.evaluate("""() => {
      const far = gruber.parts.point.others.filter(({ state }) => state === "proposed").at(-1);
      far.score = 0.4;
      return far.photo;
    }""")
    page.keyboard.press("Shift+Y")
    page.wait_for_function("document.querySelector('.notice')?.textContent.startsWith('1 place')")
    page.wait_for_function("gruber.parts.status.decided > 1")
    assert wrong not in {key[1] for key in placed(inputs)}
    assert len(placed(inputs)) >= 2
    assert current(page).split("|")[0] == first[0]
