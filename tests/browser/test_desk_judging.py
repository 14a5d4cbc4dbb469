"""What helps to judge a place: edges of the ortho, flicker, other peaks, all scans of a point."""

import pytest

from tests.browser.hands import current, gone_on, unfold, until

INK = """([pane, [red, green, blue]]) => {
  const canvas = document.querySelector(`.pane[data-pane=${pane}] .marks`);
  const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  let count = 0;
  for (let at = 0; at < data.length; at += 4) {
    const away = Math.abs(data[at] - red) + Math.abs(data[at + 1] - green)
      + Math.abs(data[at + 2] - blue);
    if (data[at + 3] > 200 && away < 24) count += 1;
  }
  return count;
}"""
"""Pixels of a colour among the marks of a pane."""
EDGE = [255, 230, 70]
PEAK = [243, 177, 60]
LABEL = "document.querySelector('.pane[data-pane=left] .label').textContent"


def test_a_pane_without_its_picture_says_that_it_loads__law(sit):
    page, held = sit(scene=False), []
    page.mouse.move(5, 5)
    page.context.route("**/tiles/scan/**", lambda route: held.append(route))
    page.reload()
    page.wait_for_selector('[data-pane="right"] .wait')
    page.wait_for_selector('[data-pane="left"] .wait', state="hidden")
    page.context.unroute("**/tiles/scan/**")
    for route in held:
        route.continue_()
    page.wait_for_selector('[data-pane="right"] .wait', state="hidden")


def test_places_beside_the_pictures_are_of_the_point_in_sight__law(sit):
    page = sit(scene=False)
    page.hover('[data-pane="left"]')
    page.wait_for_selector('[data-pane="left"] .where:not(:empty)')
    point = current(page)
    page.keyboard.press("j")
    gone_on(page, point)

    def is_in_sight() -> bool:
        said = page.inner_text('[data-pane="left"] .where').replace("\u2212", "-")
        view = page.evaluate("(({ east, north }) => [east, north])(gruber.compareState().view)")
        told = zip(said.split(), view, strict=True)
        return all(abs(float(part) - middle) < 1 for part, middle in told)

    until(page, is_in_sight)


@pytest.fixture
def page(sit):
    page = sit(scene=False)
    page.wait_for_function("gruber.compareState().drawn.whole")
    page.mouse.move(5, 5)
    return page


def test_edges_of_the_ortho_are_laid_over_the_scan_alone__law(page):
    assert page.evaluate(INK, ["right", EDGE]) == 0
    page.keyboard.press("o")
    page.wait_for_function(f"({INK})(['right', {EDGE}]) > 300")
    assert page.get_attribute('[data-act="edges"]', "aria-pressed") == "true"
    assert page.evaluate(INK, ["left", EDGE]) == 0
    page.keyboard.press("r")
    page.wait_for_function("gruber.compareState().raw && gruber.compareState().drawn.whole")
    page.wait_for_function(f"({INK})(['right', {EDGE}]) > 300")
    page.click('[data-act="edges"]')
    page.mouse.move(5, 5)
    page.wait_for_function(f"({INK})(['right', {EDGE}]) === 0")


def test_pictures_flicker_by_themselves_as_fast_as_asked__law(page):
    at_rest = page.evaluate(LABEL)
    page.keyboard.press("t")
    page.wait_for_selector("#rate:not([hidden])")
    page.focus("#rate")
    page.keyboard.press("End")
    page.evaluate(
        f"""window.swaps = 0; window.last = {LABEL};
        setInterval(() => {{
          if ({LABEL} !== last) {{ swaps += 1; last = {LABEL}; }}
        }}, 20)"""
    )
    page.wait_for_function("swaps >= 4")
    page.keyboard.press("t")
    page.wait_for_function(f"label => {LABEL} === label && last === label", arg=at_rest)
    before = page.evaluate("swaps")
    page.wait_for_timeout(800)
    assert page.evaluate("swaps") == before
    assert page.evaluate("gruber.parts.status.decided") == 0


def test_other_peaks_show_only_where_one_points__law(page):
    assert page.evaluate("gruber.parts.point.peaks.filter(p => p.away > 0.05).length") > 0
    unfold(page)
    page.wait_for_timeout(300)
    assert page.evaluate(INK, ["right", PEAK]) == 0
    page.hover("#peaks .peak:not(.on)")
    page.wait_for_function(f"({INK})(['right', {PEAK}]) > 10")


def test_all_scans_of_a_point_stand_in_equal_pictures__law(page):
    point, scans = current(page), page.evaluate("gruber.parts.point.others.length")
    page.keyboard.press("z")
    page.wait_for_selector("#together canvas")
    page.wait_for_function("gruber.compareState().drawn.whole")
    sizes = page.evaluate(
        "[...document.querySelectorAll('#together canvas')]"
        ".map(c => `${c.clientWidth}x${c.clientHeight}`)"
    )
    assert len(sizes) == scans + 1
    assert len(set(sizes)) == 1
    page.click("#together button:not(.on)")
    gone_on(page, point)
    assert current(page).split("|")[0] == point.split("|")[0]
    # What would change nothing here is out of use, its key as well.
    page.keyboard.press("o")
    page.wait_for_selector("[data-act=edges]:disabled")
    assert not page.evaluate("gruber.compareState().edges")
    assert page.locator("[data-act=wallis]").is_enabled()
    page.keyboard.press("Escape")
    page.wait_for_selector("#together", state="hidden")
    page.wait_for_selector("[data-act=edges]:enabled")
