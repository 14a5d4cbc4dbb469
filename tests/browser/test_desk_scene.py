"""The 3D scene under a hand in a real Chromium: cards, flights, lists, and what fits the inset."""

import numpy as np

from tests.browser.conftest import scene_of
from tests.browser.hands import caught_up, grow
from tests.ui.desk_block import tiny_block

ON_SCREEN = """name => {
  const { nodeRefFromName, camera, canvas } = window.__viserMutable;
  const place = nodeRefFromName[name].getWorldPosition(camera.position.clone()).project(camera);
  return [(place.x + 1) / 2 * canvas.clientWidth, (1 - place.y) / 2 * canvas.clientHeight];
}"""
ROW = "[gruber.parts.point.key, gruber.parts.queue.filter]"
NODE = "name => !!window.__viserMutable.nodeRefFromName[name]"


def test_a_photo_is_named_chosen_entered_and_left__truth(sit):
    page = sit()
    scene, room = scene_of(page), page.locator("#scene")
    grow(page, "block")
    page.wait_for_selector("#scene-scale:not([hidden])")
    scene.wait_for_function(
        "innerWidth > 1000 && "
        "Math.abs(__viserMutable.camera.aspect - innerWidth / innerHeight) < 0.01"
    )
    before = scene.evaluate(ON_SCREEN, "/photos/1938_02_015")
    for _ in range(10):
        # In a window of another shape the block is fitted anew.
        page.wait_for_timeout(1500)
        was, before = before, scene.evaluate(ON_SCREEN, "/photos/1938_02_015")
        if was == before:
            break
    box = room.bounding_box()
    # Just below its perspective centre the pyramid is narrow.
    photo = box["x"] + before[0], box["y"] + before[1] + 6
    page.mouse.move(photo[0] - 2, photo[1])
    page.mouse.move(*photo)
    page.wait_for_selector("#scene-card:has-text('02_015'):has-text('RMS')")
    page.mouse.click(*photo)
    page.wait_for_function("gruber.parts.scene.photo === '1938_02_015'")
    page.wait_for_selector("#scene-legend:has-text('02_015')")
    page.wait_for_function("gruber.parts.point.key[1] === '1938_02_015'")
    chosen = page.evaluate(ROW)
    page.mouse.dblclick(*photo)
    page.wait_for_selector("#scene-leave:has-text('02_015')")
    assert not page.locator("#scene-legend").is_visible()
    scene.wait_for_function(NODE, arg="/veil")
    # The second click met what is seen from inside, and another row was chosen.
    assert page.evaluate(ROW) == chosen
    page.keyboard.press("Escape")
    page.wait_for_selector("#scene-leave", state="hidden")
    # The eye is back where it was.
    scene.wait_for_function(
        f"([name, x, y]) => {{ const [a, b] = ({ON_SCREEN})(name);"
        " return Math.hypot(a - x, b - y) < 2; }",
        arg=["/photos/1938_02_015", *before],
    )
    page.click('[data-layer="photos"]')
    page.wait_for_function("!gruber.parts.scene.layers.photos")
    page.mouse.dblclick(box["x"] + box["width"] / 2, box["y"] + box["height"] * 0.7)
    page.wait_for_selector("#scene-list button[data-photo]")
    page.keyboard.press("Escape")
    page.wait_for_selector("#scene-list", state="hidden")
    page.mouse.dblclick(box["x"] + box["width"] / 2, box["y"] + box["height"] * 0.7)
    first = page.locator("#scene-list button[data-photo]").first
    name = first.get_attribute("data-photo")
    first.click()
    page.wait_for_function("name => gruber.parts.scene.inside === name", arg=name)


SEEN_AT = """places => {
  const { nodeRefFromName, camera } = window.__viserMutable;
  const frame = nodeRefFromName["/footprints"].matrixWorld;
  return places.map(place => {
    const seen = camera.position.clone().set(...place).applyMatrix4(frame).project(camera);
    return [(seen.x + 1) / 2 * innerWidth, (1 - seen.y) / 2 * innerHeight];
  });
}"""
SHOWN = """[...gruber.parts.order].map(n => gruber.parts.rows[n]).filter(row =>
  gruber.areaShown().places.some(([e, n]) => e === row[11] && n === row[12])).map(row => row[0])"""


def test_an_area_drawn_over_the_scene_is_what_the_queue_shows__truth(sit):
    page = sit()
    page.click('.chip[data-state="all"]')
    grow(page, "block")
    scene, room = scene_of(page), page.locator("#scene")
    page.wait_for_selector("#scene-scale:not([hidden])")
    scene.wait_for_function(
        "innerWidth > 1000 && "
        "Math.abs(__viserMutable.camera.aspect - innerWidth / innerHeight) < 0.01"
    )
    block = tiny_block().block
    names = sorted({name for name, _ in block.measurements})
    places = {name: block.surveyed[name].position - block.origin for name in names}
    seen = np.array(scene.evaluate(SEEN_AT, [place.tolist() for place in places.values()]))
    at = dict(zip(places, seen, strict=True))
    low, high = np.quantile(seen, 0.3, axis=0), np.quantile(seen, 0.75, axis=0)
    box = room.bounding_box()
    # Escape leaves it, and the next drag turns the block again.
    page.keyboard.press("Shift+F")
    page.wait_for_selector("#scene-area:not([hidden])")
    page.keyboard.press("Escape")
    page.wait_for_selector("#scene-area", state="hidden")
    # Enter takes all in sight, and refines nothing.
    page.keyboard.press("Shift+F")
    page.keyboard.press("Enter")
    page.wait_for_function("gruber.parts.queue.filter.area.length > 4")
    assert set(page.evaluate(SHOWN)) == set(places)
    assert page.evaluate("gruber.parts.status.drafts") == 0
    page.click('[data-act="area"]')
    page.wait_for_selector('[data-act="area"].on')
    page.mouse.move(box["x"] + low[0], box["y"] + low[1])
    page.mouse.down()
    page.mouse.move(box["x"] + high[0], box["y"] + high[1], steps=4)
    page.mouse.up()
    page.wait_for_function("gruber.parts.queue.filter.area.length > 4")
    caught_up(page)
    shown = set(page.evaluate(SHOWN))
    # Points lie on the ground as the reference has it; the outline may pass them by a few pixels.
    sure = 6
    inside = {n for n, p in at.items() if (p > low + sure).all() and (p < high - sure).all()}
    near = {n for n, p in at.items() if (p > low - sure).all() and (p < high + sure).all()}
    assert len(inside) > 5
    assert inside <= shown <= near
    page.click('[data-grow="block"]')
    page.click("#sieve-area")
    page.wait_for_selector("#sieve-area", state="hidden")
    assert set(page.evaluate(SHOWN)) > near


def test_the_inset_has_only_what_fits__law(sit):
    page = sit()
    page.set_viewport_size({"width": 1366, "height": 768})
    page.wait_for_selector("#scene-scale:not([hidden])")
    room = page.locator("#scene-room").bounding_box()
    boxes = [page.locator(part).bounding_box() for part in ("#scene-scale", "#scene-buttons")]
    for box in boxes:
        assert room["x"] <= box["x"]
        assert box["x"] + box["width"] <= room["x"] + room["width"]
    assert boxes[0]["x"] + boxes[0]["width"] < boxes[1]["x"]
    for part in ("#scene-legend", "#vectors", "#relief-room"):
        assert not page.locator(part).is_visible()
    grow(page, "block")
    for part in ("#scene-legend", "#vectors", "#relief-room"):
        assert page.locator(part).is_visible()
    scene = scene_of(page)
    for layer in ("hillshade", "ties", "areas", "ellipses"):
        page.click(f'[data-layer="{layer}"]')
    scene.wait_for_function(NODE, arg="/hillshade")
    page.wait_for_selector("#scene-legend:has-text('Rays'):has-text('6+')")
    page.click('[data-relief="5"]')
    page.wait_for_selector('[data-relief="5"].on')
    # Others keep what they chose.
    assert sit(scene=False).evaluate("gruber.parts.scene.relief") == 1


def test_a_scene_that_was_cut_off_says_so_and_comes_back__law(sit, desk):
    """It stood still without a sign until somebody clicked into it."""
    page = sit()
    page.wait_for_selector("#scene-wait", state="hidden")
    page.focus("#table")
    connections = vars(desk.scene.infrastructure)["_live_connections"]

    def cut_off():
        for one in list(connections.values()):
            one.loop.call_soon_threadsafe(one.transport.abort)

    before = dict(connections)
    cut_off()
    page.wait_for_selector("#scene-wait:has-text('Loading')")
    page.wait_for_selector("#scene-wait", state="hidden")
    assert connections.keys() - before.keys()
    scene = scene_of(page)
    scene.wait_for_function(NODE, arg="/photos/1938_02_015")
    # Where it does not connect again, what it shows is old.
    scene.evaluate("() => { document.hasFocus = () => false; }")
    cut_off()
    page.wait_for_selector("#scene-wait:has-text('Loading')")


def test_escape_drops_the_draft_before_it_closes_the_list_of_photos__law(sit):
    page = sit()
    grow(page, "block")
    page.click('[data-layer="photos"]')
    page.wait_for_function("!gruber.parts.scene.layers.photos")
    page.click('[data-grow="block"]')
    page.wait_for_function("gruber.compareState().drawn.whole")
    page.keyboard.press("ArrowRight")
    page.wait_for_function("gruber.parts.point.draft")
    box = page.locator("#scene").bounding_box()
    page.mouse.dblclick(box["x"] + box["width"] / 2, box["y"] + box["height"] * 0.6)
    page.wait_for_selector("#scene-list:not([hidden])")
    assert page.evaluate("gruber.parts.point.draft")
    page.keyboard.press("Escape")
    page.wait_for_function("!gruber.parts.point.draft")
    assert page.locator("#scene-list").is_visible()
    page.keyboard.press("Escape")
    page.wait_for_selector("#scene-list", state="hidden")


def test_the_scene_says_that_it_loads_and_stands_on_the_pages_ground__law(sit):
    page = sit()
    scene = scene_of(page)
    page.wait_for_selector("#scene-wait", state="hidden")
    behind = "getComputedStyle(document.querySelector('canvas[data-engine]')).backgroundColor"
    dark = scene.evaluate(behind)
    page.click('[data-act="theme"]')
    scene.wait_for_function(f"dark => {behind} !== dark", arg=dark)
    ground = "getComputedStyle(document.documentElement).getPropertyValue('--scene')"
    red, green, blue = (int(page.evaluate(ground)[at : at + 2], 16) for at in (1, 3, 5))
    assert scene.evaluate(behind) == f"rgb({red}, {green}, {blue})"
    scene.evaluate("window.__viserMutable.nodeRefFromName = {}")
    page.wait_for_selector("#scene-wait:has-text('Loading')")
