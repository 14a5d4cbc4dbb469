"""Every gesture of the desk by key and by pointer: what a hand does, and what must come of it."""

from collections.abc import Callable
from dataclasses import dataclass

from playwright.sync_api import Page

Hand = Callable[[Page], None]


@dataclass(frozen=True)
class Decides:
    """A gesture after which decisions must be on disk, of these kinds in this order."""

    name: str
    hand: Hand
    kinds: tuple[str, ...]
    reason: str = ""


@dataclass(frozen=True)
class Looks:
    """A gesture that changes what is seen, told by a probe in the page, and records nothing."""

    name: str
    hand: Hand
    probe: str


def key(name: str) -> Hand:
    """A key pressed."""
    return lambda page: page.keyboard.press(name)


def click(selector: str) -> Hand:
    """Something clicked."""
    return lambda page: page.locator(selector).first.click()


def button(name: str) -> Hand:
    """The button of an act clicked."""
    return click(f'[data-act="{name}"]')


def choose(selector: str, index: int) -> Hand:
    """One of a list chosen."""
    return lambda page: page.select_option(selector, index=index) and None


def slide(selector: str, to: int) -> Hand:
    """A slider clicked at a share of its length, per cent."""

    def hand(page: Page) -> None:
        box = page.locator(selector).bounding_box()
        assert box is not None
        page.mouse.click(box["x"] + box["width"] * to / 100, box["y"] + box["height"] / 2)

    return hand


def reason(digit: int, pointed: bool) -> Hand:
    """A rejection, and why."""

    def hand(page: Page) -> None:
        page.keyboard.press("n")
        page.wait_for_selector("#reasons:not([hidden])")
        if pointed:
            page.locator("#reasons button").nth(digit - 1).click()
        else:
            page.keyboard.press(str(digit))

    return hand


def held(hold: Hand, probe: str, release: Hand) -> Hand:
    """Something held for a moment: the page keeps when the probe said yes meanwhile."""

    def hand(page: Page) -> None:
        hold(page)
        page.wait_for_timeout(150)
        page.evaluate(f"if ({probe}) window.seenMeanwhile = performance.now()")
        release(page)

    return hand


def in_pane(page: Page, pane: str, right: float = 0, down: float = 0) -> tuple[float, float]:
    """A place beside the middle of a picture."""
    box = page.locator(f'.pane[data-pane="{pane}"]').bounding_box()
    assert box is not None
    return box["x"] + box["width"] / 2 + right, box["y"] + box["height"] / 2 + down


def click_in_scan(page: Page) -> None:
    """A place clicked beside the middle of the scan."""
    page.mouse.click(*in_pane(page, "right", 45, -30))


def drag_mark(page: Page) -> None:
    """The mark of the measurement dragged."""
    right, down = in_pane(page, "right")
    away = page.evaluate(
        """() => { const { point, view } = gruber.compareState();
        const [east, north] = point.marks.measured;
        return [(east - view.east) * view.scale, (view.north - north) * view.scale]; }"""
    )
    drag(page, (right + away[0], down + away[1]), (24, 18))


def drag(page: Page, start: tuple[float, float], by: tuple[float, float]) -> None:
    """Press, move, let go."""
    page.mouse.move(*start)
    page.mouse.down()
    page.mouse.move(start[0] + by[0], start[1] + by[1], steps=4)
    page.mouse.up()


def wheel(page: Page) -> None:
    """The wheel over the scan."""
    page.mouse.move(*in_pane(page, "right", 30, 20))
    page.mouse.wheel(0, -240)


def new_point(by: Hand) -> Hand:
    """A new point clicked in the ortho."""

    def hand(page: Page) -> None:
        by(page)
        page.wait_for_selector("#adding:not([hidden])")
        page.mouse.click(*in_pane(page, "left", 20, 10))

    return hand


def walked_until(test: str, hand: Hand) -> Hand:
    """Along the queue to a measurement that has what the gesture needs; then the gesture."""

    def walked(page: Page) -> None:
        for _ in range(40):
            if page.evaluate(test):
                break
            before = page.evaluate("gruber.parts.point.key.join('|')")
            page.keyboard.press("j")
            page.wait_for_function("k => gruber.parts.point.key.join('|') !== k", arg=before)
        hand(page)

    return walked


def refined(hand: Hand) -> Hand:
    """At the next measurement that has a peak of likeness beside it."""

    def walked(page: Page) -> None:
        for _ in range(8):
            before = page.evaluate("gruber.parts.point.key.join('|')")
            page.keyboard.press("j")
            page.wait_for_function("k => gruber.parts.point.key.join('|') !== k", arg=before)
            hand(page)
            told = page.wait_for_selector(".notice", state="attached").inner_text()
            if "Not refined" not in told:
                return
            page.wait_for_selector(".notice", state="detached")

    return walked


POINT_DRAFT, MARK_DRAFT = "gruber.parts.point.draft", "gruber.parts.board_drafts[0]"


def kept(hand: Hand, yes: Hand, draft: str = POINT_DRAFT) -> Hand:
    """A gesture that drafts a place, and the verdict that keeps it, twice where it is asked."""

    def keeping(page: Page) -> None:
        hand(page)
        page.wait_for_function(f"{draft} && !gruber.isAhead()")
        aimed = "gruber.parts.point.key" if draft == POINT_DRAFT else "[]"
        page.evaluate(f"window.aimed = {aimed}")
        yes(page)
        page.wait_for_function(f"(!{draft} || {draft}.asking) && !gruber.isAhead()")
        if page.evaluate(draft):
            yes(page)

    return keeping


def judged(yes: Hand) -> Hand:
    """A verdict on what nobody has moved, twice where it is asked."""

    def judging(page: Page) -> None:
        yes(page)
        page.wait_for_function("!gruber.isAhead()")
        if page.evaluate(f"{POINT_DRAFT}?.asking"):
            yes(page)

    return judging


def shown(hand: Hand, selector: str) -> Hand:
    """A gesture, and the wait for what it shows."""

    def wait(page: Page) -> None:
        hand(page)
        page.wait_for_selector(selector)

    return wait


def unfolded(hand: Hand) -> Hand:
    """With everything shown that is folded away at first."""

    def shown(page: Page) -> None:
        if not page.locator("#details").is_visible():
            page.keyboard.press(".")
        hand(page)

    return shown


def withdraw_accepted(page: Page) -> None:
    """The newest decision of an accepted measurement withdrawn in its history."""
    page.click('.chip[data-state="accepted"]')
    unfolded(click("#history button"))(page)
    page.evaluate("window.aimed = gruber.parts.point.key")
    page.click('.chip[data-state="open"]')


def click_large(page: Page) -> None:
    """A place clicked in the large picture of a mark."""
    box = page.locator("#mark-room .magnified").bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + box["width"] / 2 + 14, box["y"] + box["height"] / 2 + 9)


def click_frustum(page: Page) -> None:
    """A photo of the 3D scene clicked that is not the current one."""
    scene = next(frame for frame in page.frames if "/scene/" in frame.url)
    place = scene.evaluate(
        """name => {
          const at = __viserMutable.nodeRefFromName[name].getWorldPosition(
            __viserMutable.camera.position.clone());
          at.project(__viserMutable.camera);
          return [(at.x + 1) / 2 * innerWidth, (1 - at.y) / 2 * innerHeight]; }""",
        "/photos/"
        + page.evaluate(
            "Object.keys(Object.fromEntries(gruber.parts.rows.map(r => [r[1], 1])))"
            ".sort().find(n => n !== gruber.parts.point.key[1])"
        ),
    )
    room = page.locator("#scene").bounding_box()
    assert room is not None
    page.mouse.click(room["x"] + place[0], room["y"] + place[1] + 40)


def mark_four(page: Page) -> None:
    """The current row and three more marked by pointer, then one key."""
    places = page.locator(".row:not(.human)")
    places.nth(1).click(modifiers=["Control"])
    places.nth(3).click(modifiers=["Shift"])
    page.wait_for_selector("#queue-place.many")
    page.keyboard.press("m")


def mark_two_by_key(page: Page) -> None:
    """Two rows that nobody decided marked on the way, then the button."""
    page.click(f'.row[data-key="{page.evaluate(TWO_OPEN)}"]')
    page.wait_for_timeout(1000)
    page.focus("#queue")
    before = page.evaluate("gruber.parts.queue.current")
    page.keyboard.press("Shift+ArrowDown")
    page.wait_for_function("at => gruber.parts.queue.current !== at", arg=before)
    page.click('[data-act="dubious"]')


def arrow_in_queue(page: Page) -> None:
    """An arrow while the queue has the focus."""
    page.focus("#queue")
    page.keyboard.press("ArrowDown")


def hold_blink(page: Page) -> None:
    """The pointer pressed on the button."""
    page.evaluate("window.seenMeanwhile = null")
    page.hover('[data-act="blink"]')
    page.mouse.down()


TWO_OPEN = """(() => {
  const top = (row) => parseFloat(row.style.top);
  const rows = [...document.querySelectorAll('.row')].sort((a, b) => top(a) - top(b));
  const open = (row) => row && !row.classList.contains('human');
  return rows.find((row, at) => open(row) && open(rows[at + 1])).dataset.key;
})()"""
OTHERS = "document.querySelectorAll('.other:not(.on)').length > 0"
GROWN = "document.getElementById('desk').dataset.grown"
TWO_PEAKS = "document.querySelectorAll('.peak:not(.on)').length > 0"
PLACED, MARKED, BACK = ("Place",), ("PlaceFiducial",), ("Withdraw",)
ADDED = ("AddPoint", "Accept")
AMENDED = ("Reject", "Withdraw", "Reject")
REASONS = ("wrong object", "changed", "hidden", "blurred", "other")

DECISIONS = (
    Decides("Y", judged(key("y")), ("Accept",)),
    Decides("accept button", judged(button("accept")), ("Accept",)),
    Decides("N", key("n"), ("Reject",)), Decides("reject button", button("reject"), ("Reject",)),
    Decides("M", key("m"), ("MarkDubious",)),
    Decides("dubious button", button("dubious"), ("MarkDubious",)),
    Decides("V", key("v"), ("MarkNotVisible",)),
    Decides("not-visible button", button("invisible"), ("MarkNotVisible",)),
    *(Decides(f"N, {1 + n}", reason(1 + n, False), AMENDED, why)
      for n, why in enumerate(REASONS[:4])),
    *(Decides(f"N, reason button {1 + n}", reason(1 + n, True), AMENDED, why)
      for n, why in enumerate(REASONS[:4])),
    Decides("rows marked, M", mark_four, 4 * ("MarkDubious",)),
    Decides("marked by key, button", mark_two_by_key, 2 * ("MarkDubious",)),
    Decides("C", key("c"), ("SetRole",)), Decides("role button", button("role"), ("SetRole",)),
    Decides("U", key("u"), BACK), Decides("undo button", button("undo"), BACK),
    Decides("Shift+U", key("Shift+U"), BACK), Decides("redo button", button("redo"), BACK),
    Decides("click in the scan, Y", kept(click_in_scan, key("y")), PLACED),
    Decides("mark dragged, Y", kept(drag_mark, key("y")), PLACED),
    Decides("arrow, Y", kept(key("ArrowRight"), key("y")), PLACED),
    Decides("Shift+arrow, keep button", kept(key("Shift+ArrowUp"), click("#keep button")), PLACED),
    Decides("Enter, Y", kept(refined(key("Enter")), key("y")), PLACED),
    Decides("refine button, Y", kept(refined(button("refine")), key("y")), PLACED),
    Decides("history button", withdraw_accepted, BACK),
    Decides("other peak, Y",
            kept(walked_until(TWO_PEAKS, unfolded(click(".peak:not(.on)"))), key("y")),
            ("ChoosePeak",)),
    Decides("P, click in the ortho, Y", kept(new_point(key("p")), key("y")), ADDED),
    Decides("add button, click, Y", kept(new_point(button("add")), key("y")), ADDED),
    Decides("U after it", key("u"), (*BACK, *BACK)),
)  # fmt: skip
BOARD = (
    Decides("board: V", key("v"), ("JudgeFiducial",)),
    Decides("board: hide button", click('[data-board="hide"]'), ("JudgeFiducial",)),
    Decides("board: Y", key("y"), ("JudgeFiducial",)),
    Decides("board: keep button", click('[data-board="keep"]'), ("JudgeFiducial",)),
    Decides("board: click in the picture, Y", kept(click_large, key("y"), MARK_DRAFT), MARKED),
    Decides("board: arrow, Y", kept(key("ArrowLeft"), key("y"), MARK_DRAFT), MARKED),
    Decides("board: Enter, Y", kept(key("Enter"), key("y"), MARK_DRAFT), MARKED),
    Decides(
        "board: snap and keep button",
        kept(click('[data-board="snap"]'), click('[data-board="keep"]'), MARK_DRAFT),
        MARKED,
    ),
    Decides("board: U", key("u"), BACK),
    Decides("board: undo button", click('[data-board="undo"]'), BACK),
    Decides("board: Shift+U", key("Shift+U"), BACK),
)
PLACE, LOOK = "gruber.parts.queue.current", "gruber.compareState()"
SCALE, SEEN = f"{LOOK}.view.scale", "window.seenMeanwhile"
FILTER, SORT = (
    "JSON.stringify(gruber.parts.queue.filter)",
    "JSON.stringify(gruber.parts.queue.sort)",
)
DRAFTED = "gruber.parts.status.drafts"
BLINK = f"{LOOK}.blink"
OPEN = "document.querySelector('dialog[open]')?.id ?? ''"
COMPARED = "JSON.stringify(gruber.parts.quality.compared?.pair)"
ON_MAP = "gruber.placementState().current"
MARK = "gruber.boardState().current?.join('|')"
LOOKING = (
    Looks("click in the scan", click_in_scan, DRAFTED), Looks("Esc", key("Escape"), DRAFTED),
    Looks("arrow", key("ArrowRight"), DRAFTED), Looks("U on a draft", key("u"), DRAFTED),
    Looks("J", key("j"), PLACE), Looks("K", key("k"), PLACE),
    Looks("next button", button("next"), PLACE),
    Looks("previous button", button("previous"), PLACE),
    Looks("row clicked", click(".row:not(.current)"), PLACE),
    Looks("other scan clicked", walked_until(OTHERS, unfolded(click(".other:not(.on)"))), PLACE),
    Looks("arrow in the queue", arrow_in_queue, PLACE),
    Looks("chip clicked", click('.chip[data-state="all"]'), FILTER),
    Looks("scan chosen", choose("#sieve-photo", 3), FILTER),
    Looks("all scans again", choose("#sieve-photo", 0), FILTER),
    Looks("kind chosen", choose("#sieve-role", 2), FILTER),
    Looks("all kinds again", choose("#sieve-role", 0), FILTER),
    Looks("sorting chosen", choose("#sort-column", 2), SORT),
    Looks("sorting turned", click("#sort-turn"), SORT),
    Looks("heading clicked", click('[data-column="misfit"]'), SORT),
    Looks("+", key("+"), SCALE), Looks("-", key("-"), SCALE), Looks("wheel", wheel, SCALE),
    Looks("picture dragged", lambda page: drag(page, in_pane(page, "left", -60, 40), (50, 30)),
          f"{LOOK}.view.east"),
    Looks("F", key("f"), f"{LOOK}.view.east"),
    Looks("wheel again", wheel, SCALE), Looks("fit button", button("fit"), SCALE),
    Looks("R", key("r"), f"{LOOK}.raw"), Looks("raw button", button("raw"), f"{LOOK}.raw"),
    Looks("L", key("l"), f"{LOOK}.likeness"),
    Looks("likeness button", button("likeness"), f"{LOOK}.likeness"),
    Looks("Wallis button", button("wallis"), f"{LOOK}.wallis"),
    Looks("marks button", button("marks"), f"{LOOK}.marks"),
    Looks("marks again", button("marks"), f"{LOOK}.marks"),
    Looks("swipe", click('[data-mode="swipe"]'), f"{LOOK}.mode"),
    Looks("swipe moved", slide("#swipe", 25), f"{LOOK}.share"),
    Looks("blend", click('[data-mode="blend"]'), f"{LOOK}.mode"),
    Looks("side by side", click('[data-mode="side"]'), f"{LOOK}.mode"),
    Looks("contrast", slide("#contrast", 70), f"{LOOK}.contrast"),
    Looks("Space held", held(lambda p: p.keyboard.down(" "), BLINK, lambda p: p.keyboard.up(" ")),
          SEEN),
    Looks("blink button held", held(hold_blink, BLINK, lambda p: p.mouse.up()), SEEN),
    Looks("scene maximised", click('[data-grow="block"]'), GROWN),
    Looks("layer switched", click('[data-layer="ties"]'), "gruber.parts.scene.layers.ties"),
    Looks("vectors longer", slide("#vectors input", 80), "gruber.parts.scene.scale"),
    Looks("photo clicked in 3D", click_frustum, PLACE),
    Looks("X", key("x"), GROWN),
    Looks("theme button", button("theme"), "localStorage['gruber.theme']"),
    Looks("theme again", button("theme"), "localStorage['gruber.theme']"),
    Looks("H", key("h"), OPEN), Looks("H again", key("h"), OPEN),
    Looks("help button", button("help"), OPEN), Looks("Escape", key("Escape"), OPEN),
    Looks("B", shown(key("b"), "#quality .quality-part"), OPEN),
    Looks("adjustments compared", choose('[data-pair="0"]', 1), COMPARED),
    Looks("B again", key("b"), OPEN),
    Looks("quality button", button("quality"), OPEN),
    Looks("its close button", click("#quality-close"), OPEN),
    Looks("G", key("g"), OPEN),
    Looks("J on the map", key("j"), ON_MAP),
    Looks("photo's row clicked", click("#placement tr[data-photo]:not(.on)"), ON_MAP),
    Looks("Space on the map", key(" "), "gruber.placementState().mode"),
    Looks("after clicked", click('[data-mode="both"]'), "gruber.placementState().mode"),
    Looks("map closed", click("#placement-close"), OPEN),
    Looks("placement button", button("placement"), OPEN), Looks("G again", key("g"), OPEN),
    *(look for opener in ("Shift+O", "Shift+B", "Shift+I")
      for look in (Looks(opener, key(opener), OPEN),
                   Looks(f"Esc after {opener}", key("Escape"), OPEN))),
    Looks("points button", click("#points-open"), OPEN),
    Looks("Esc after points", key("Escape"), OPEN),
)  # fmt: skip
BOARD_LOOKING = (
    Looks("board button", button("board"), OPEN),
    Looks("J on the board", key("j"), MARK),
    Looks("K on the board", key("k"), MARK),
    Looks("mark clicked", click("#board .mark:not(.on)"), MARK),
    Looks("click in its picture", click_large, DRAFTED),
    Looks("Esc on its draft", key("Escape"), DRAFTED),
    Looks("next mark button", click("#mark-room h3 button >> nth=1"), MARK),
    Looks("film", click('[data-tab="film"]'), "gruber.boardState().tab"),
    Looks("marks again", click('[data-tab="board"]'), "gruber.boardState().tab"),
    Looks("board closed", click("#board-close"), OPEN),
    Looks("I", key("i"), OPEN),
)
