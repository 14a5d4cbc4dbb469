"""Who works by keys: what arrives from the desk leaves the focus, and Enter means nothing else."""

from collections.abc import Callable
from typing import Any

import pytest

from sessions.decisions import ReadCheck
from tests.browser.conftest import PATIENCE_MS, RealDesk, toured
from tests.browser.hands import accept, caught_up, settled, unfold
from ui.words.catalogue import words

Sit = Callable[..., Any]
OVERHEAR = """(() => {
  const Plain = window.WebSocket;
  window.WebSocket = class extends Plain {
    constructor(...how) {
      super(...how);
      window.wire = this;
      this.addEventListener("message", ({ data }) => {
        const { answered, notices, ...told } = JSON.parse(data);
        window.told = { ...window.told, ...told };
      });
    }
  };
})()"""
ARRIVES = """() => {
  window.turn = (window.turn ?? 0) + 1;
  const told = structuredClone(window.told);
  const by = window.turn / 1000;
  told.status.decided += window.turn;
  if (told.quality) told.quality.sigma += by;
  if (told.mosaic) told.mosaic.stale = window.turn % 2 ? told.mosaic.seams.map(s => s.photo) : [];
  for (const one of told.point?.others ?? []) one.misfit = (one.misfit ?? 0) + by;
  for (const one of told.point?.peaks ?? []) one.score += by;
  for (const one of told.point?.history ?? []) one.who = `ada ${window.turn}`;
  window.wire.onmessage({ data: JSON.stringify(told) });
}"""
"""All that the desk has told comes once more, with other figures."""
LOST = """() => {
  const room = document.querySelector("dialog[open]") ?? document.body;
  const nameOf = e => `${e.tagName} ${e.id || Object.values(e.dataset).join(" ")
    || e.getAttribute("aria-label") || e.textContent.trim().slice(0, 30)}`;
  const stops = () => [...room.querySelectorAll(
    "button, select, input, textarea, summary, a[href], [tabindex='0']")]
    .filter(e => !e.disabled && e.checkVisibility({ visibilityProperty: true }));
  const names = [...new Set(stops().map(nameOf))];
  return names.filter(name => {
    stops().find(e => nameOf(e) === name)?.focus();
    if (nameOf(document.activeElement) !== name) return false;
    (ARRIVES)();
    return nameOf(document.activeElement) !== name;
  });
}""".replace("ARRIVES", ARRIVES)
"""Controls that lose the focus when something arrives."""
SHEETS = {
    "": "", "quality": "b", "board": "i", "mask": "Shift+I", "placement": "g",
    "mosaic": "Shift+O", "checks": "Shift+B", "results": "#results-open",
    "points": "#points-open", "naming": "#who", "help": "h",
}  # fmt: skip


@pytest.fixture
def page(planned: None, real_desk: RealDesk, sit_at: Sit) -> Any:
    """The desk of a block with a plan."""
    found = sit_at(real_desk.desk.url, scene=False)
    settled(found)
    return found


@pytest.fixture
def overheard(planned: None, real_desk: RealDesk, sit_at: Sit) -> Any:
    """The same, and all that the desk tells."""
    url = real_desk.desk.url
    found = sit_at(url, scene=False, storage_state=toured(url))
    found.context.add_init_script(OVERHEAR)
    found.reload()
    found.wait_for_selector(".row.current")
    settled(found)
    return found


def show(page: Any, sheet: str) -> None:
    """Open a sheet, and wait for what is in it."""
    opener = SHEETS[sheet]
    if opener.startswith("#"):
        page.click(opener)
    elif opener:
        page.keyboard.press(opener)
    if sheet:
        page.wait_for_selector(f"#{sheet}[open]:not(:has([aria-busy])) button", timeout=PATIENCE_MS)


def test_what_arrives_leaves_the_focus_where_it_is__law(overheard: Any) -> None:
    """On the desk with all unfolded, and on every sheet."""
    page = overheard
    accept(page)
    page.wait_for_function("gruber.parts.status.decided > 0 && !gruber.isAhead()")
    page.click('.chip[data-state="accepted"]')
    page.select_option("#sieve-role", "control")
    page.wait_for_function("gruber.parts.point?.history.length")
    unfold(page)
    settled(page)
    page.wait_for_function("!gruber.isAhead()")
    lost = {}
    for sheet in SHEETS:
        show(page, sheet)
        lost[sheet] = page.evaluate(LOST)
        page.evaluate("document.querySelectorAll('dialog[open]').forEach(one => one.close())")
        page.evaluate("document.activeElement.blur()")
    assert {sheet: names for sheet, names in lost.items() if names} == {}


def test_a_button_that_went_away_leaves_no_other_under_enter__law(
    page: Any, real_desk: RealDesk
) -> None:
    """In the checks: N shows its reasons where the focus was, and they go when one is chosen."""
    show(page, "checks")
    page.focus("#checks [data-step=back]")
    page.keyboard.press("n")
    assert page.evaluate("document.activeElement.dataset.step") == "back"
    page.focus("#checks [data-reason=blurred]")
    before = len(real_desk.session.decisions())
    for _ in range(4):
        page.keyboard.press("Enter")
    caught_up(page)
    made = [item.decision for item in real_desk.session.decisions()[before:]]
    assert [type(one) for one in made] == [ReadCheck]


def test_enter_on_a_draft_that_is_kept_does_not_refine_the_next_point__law(page: Any) -> None:
    page.keyboard.press("Shift+ArrowRight")
    page.wait_for_function("gruber.parts.point.draft")
    shown = page.evaluate("gruber.parts.point.key.join('|')")
    page.focus("#keep button:last-of-type")
    for _ in range(3):
        page.keyboard.press("Enter")
        page.wait_for_function("!gruber.isAhead()")
    page.wait_for_timeout(300)
    assert page.evaluate("gruber.parts.point.key.join('|')") == shown
    assert not page.evaluate("gruber.parts.point.draft")
    # Any other key goes on: then Enter is the desk's own again.
    page.keyboard.press("k")
    page.wait_for_function("!gruber.isAhead()")
    page.keyboard.press("Enter")
    page.wait_for_selector(".notice")


def test_a_notice_in_a_sheet_outlives_what_is_drawn_anew_and_the_sheet__law(page: Any) -> None:
    """It lay in the sheet that was drawn anew; from then on every notice was an error."""
    page.keyboard.press("b")
    page.select_option("#quality #sign-verdict", "accept-with-remarks")
    page.fill("#quality #sign-remark", "small holes")
    caught_up(page)
    page.click("#quality #sign")
    page.wait_for_selector("#quality .notice")
    page.wait_for_selector("#quality .signature")
    assert page.locator("#quality .notice").is_visible()
    page.keyboard.press("Escape")
    page.wait_for_selector("#quality", state="hidden")
    page.wait_for_selector("body > #notices > .notice:has-text('Signed')")
    page.keyboard.press("b")
    page.wait_for_selector("#quality[open] #sign")
    page.keyboard.press("Escape")
    page.keyboard.press("1")
    page.wait_for_selector("body > #notices > .notice")


def test_nothing_is_chosen_once_it_is_signed__law(page: Any) -> None:
    page.keyboard.press("b")
    page.select_option("#quality #sign-verdict", "accept-with-remarks")
    caught_up(page)
    page.click("#quality #sign")
    page.wait_for_selector("#quality .notice")
    # What was refused stays chosen: the remark is missing.
    assert page.input_value("#quality #sign-verdict") == "accept-with-remarks"
    page.fill("#quality #sign-remark", "small holes")
    caught_up(page)
    page.click("#quality #sign")
    page.wait_for_selector("#quality .signature")
    assert page.input_value("#quality #sign-verdict") == ""
    assert page.input_value("#quality #sign-remark") == ""
    assert page.is_disabled("#quality #sign")


DECIDED = """() => {
  const rows = gruber.parts.rows.map(row => row.with(3, row[3] === "auto" ? "accepted" : row[3]));
  const { quality } = gruber.parts;
  const told = { "rows/count": rows.length };
  for (let at = 0; at < rows.length; at += 50) told[`rows/${at / 50}`] = rows.slice(at, at + 50);
  const control = { class: "control_image", worst: "control", ratio: "2.1" };
  const far = { worst: rows[0][0], photo: rows[0][1], metres: "1", pixels: "9", test: "9",
    shift: "1", limit: "1", most: "1", more: "3" };
  told.quality = { ...quality, findings: [["verdict.class-large", 1, control],
    ["verdict.bare", 1, { count: "1", worst: "no such photo" }]],
    rules: [["against", 1, "verdict.contradicted", far, "rules.value.against",
      "rules.limit.none", "gruber"]] };
  window.wire.onmessage({ data: JSON.stringify(told) });
}"""
"""All is decided; a class is worse than stated, and of four disputed points the worst is told."""


def test_what_the_sheet_leads_to_is_never_an_empty_queue__law(overheard: Any) -> None:
    page = overheard
    show(page, "quality")
    # At once: what the server tells next is of the rows as they are.
    leads = page.evaluate(f"""() => {{
      ({DECIDED})();
      const buttons = document.querySelectorAll("#quality [data-part=verdict] li button");
      buttons[0].click();
      return buttons.length;
    }}""")
    assert leads == 1
    page.wait_for_selector("#quality", state="hidden")
    page.wait_for_function("gruber.parts.queue.filter.role === 'control'")
    # The order is asked for by a message of its own.
    page.wait_for_function("gruber.parts.queue.sort.column === 'misfit'")
    assert page.evaluate("gruber.parts.queue.filter.state") == "all"
    assert not page.is_visible("#queue-empty")


def test_a_rule_tells_how_many_more_there_are_and_leads_to_all__law(overheard: Any) -> None:
    page = overheard
    show(page, "quality")
    page.evaluate(DECIDED)
    assert "(3 more findings)" in page.inner_text("[data-rule=against]")
    page.evaluate(
        """() => {
          const row = gruber.parts.rows[0].with(8, 1.2);
          const rows = [row, ...gruber.parts.rows.slice(1, 50)];
          window.wire.onmessage({ data: JSON.stringify({ "rows/0": rows }) });
        }"""
    )
    page.click("[data-rule=against] button")
    page.wait_for_function("gruber.parts.queue.filter.state === 'disputed'")
    page.wait_for_function("gruber.parts.queue.sort.column === 'gain'")


def test_a_remark_is_typed_on_while_the_block_is_adjusted__law(overheard: Any) -> None:
    page = overheard
    show(page, "quality")
    page.focus("#sign-remark")
    page.keyboard.type("shifted nrth")
    for _ in range(3):
        page.keyboard.press("ArrowLeft")
    page.evaluate(ARRIVES)
    page.keyboard.type("o")
    assert page.input_value("#sign-remark") == "shifted north"


def test_checks_are_read_by_keys_alone__law(page: Any, real_desk: RealDesk) -> None:
    show(page, "checks")
    before = len(real_desk.session.decisions())
    place = page.evaluate("gruber.checksState().current")
    page.keyboard.press("y")
    for side in (0, 1):
        page.focus(f".check-room >> nth={side}")
        page.keyboard.press("ArrowRight")
        page.keyboard.press("Shift+ArrowUp")
        assert page.evaluate(f"gruber.checksState().marks[{side}]")
    # The middles of the two views are different ground: such a reading is asked about.
    page.keyboard.press("y")
    page.wait_for_selector("#checks-state.against")
    caught_up(page)
    page.keyboard.press("y")
    page.wait_for_function("name => gruber.checksState().current !== name", arg=place)
    page.wait_for_function("!gruber.isAhead()")
    made = [item.decision for item in real_desk.session.decisions()[before:]]
    assert [one.place_id for one in made if isinstance(one, ReadCheck)] == [place]
    assert len(made) == 1
    page.keyboard.press("u")
    page.wait_for_function(
        "name => gruber.checksState().found.places.find(p => p.place === name).state === 'open'",
        arg=place,
    )


def test_an_older_answer_does_not_undo_the_last_filter__law(overheard: Any) -> None:
    """Two filters in one breath: what the desk says of the first must not stand for the second."""
    page = overheard
    shown = page.evaluate(f"""() => {{
      ({ARRIVES})();
      const role = document.getElementById("sieve-role");
      role.value = "fiducial";
      role.dispatchEvent(new Event("change"));
      document.querySelector('.chip[data-state="all"]').click();
      ({ARRIVES})();
      return [role.value, document.querySelector("#chips .on, #chips [aria-pressed=true]")
        ?.dataset.state];
    }}""")
    assert shown == ["fiducial", "all"]
    settled(page)
    page.wait_for_function("gruber.parts.queue.filter.state === 'all' && !gruber.isAhead()")
    assert page.evaluate("gruber.parts.queue.filter.role") == "fiducial"
    # Nothing is awaited any more: the desk's word counts.
    page.evaluate(f"() => {{ window.told.queue.filter.role = ''; ({ARRIVES})(); }}")
    assert page.input_value("#sieve-role") == ""


HELD = """async () => {
  const asked = () => document.querySelector("#asked.against [data-answer='draft.keep']");
  const begin = performance.now();
  let seen = Infinity;
  for (;;) {
    if (asked()) seen = Math.min(seen, performance.now());
    const y = new KeyboardEvent("keydown", { key: "y", code: "KeyY", bubbles: true });
    if (y.timeStamp - seen > 250 || y.timeStamp - begin > 60_000) return;
    document.body.dispatchEvent(y);
    await new Promise(requestAnimationFrame);
  }
}"""
"""Y again and again, from before the desk asks until nearly three tenths of a second after."""


def test_a_question_is_answered_only_once_it_is_read__law(page: Any, real_desk: RealDesk) -> None:
    """Y and Y without a pause kept a draft at 30 sigma; so did a double click on *Keep*."""
    box = page.locator('.pane[data-pane="right"]').bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2 + 60, box["y"] + box["height"] / 2 - 60)
    page.wait_for_function("gruber.parts.point.draft && !gruber.isAhead()")
    before = len(real_desk.session.decisions())
    page.evaluate(HELD)
    page.wait_for_function("gruber.parts.point.draft?.asking && !gruber.isAhead()")
    assert len(real_desk.session.decisions()) == before
    page.locator("[data-answer='draft.keep']").evaluate(
        "e => e.dispatchEvent(new MouseEvent('click', { detail: 2, bubbles: true }))"
    )
    settled(page)
    assert len(real_desk.session.decisions()) == before
    page.keyboard.press("y")
    page.wait_for_function("!gruber.parts.point.draft")
    settled(page)
    assert len(real_desk.session.decisions()) == before + 1


UNCOVERED = """() => new Promise((done) => {
  const sheet = document.querySelector("dialog[open]");
  sheet.addEventListener("close", () => {
    const pressed = new KeyboardEvent("keydown", { key: "y", code: "KeyY", bubbles: true });
    document.body.dispatchEvent(pressed);
    done();
  });
  sheet.close();
})"""
"""Y as soon as the sheet over the desk is gone."""


def test_a_question_behind_a_sheet_is_read_once_the_sheet_is_gone__law(
    page: Any, real_desk: RealDesk
) -> None:
    box = page.locator('.pane[data-pane="right"]').bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2 + 60, box["y"] + box["height"] / 2 - 60)
    page.wait_for_function("gruber.parts.point.draft && !gruber.isAhead()")
    before = len(real_desk.session.decisions())
    page.keyboard.press("y")
    page.wait_for_function("gruber.parts.point.draft?.asking")
    page.keyboard.press("h")
    page.wait_for_selector("#help[open]")
    caught_up(page)
    page.evaluate(UNCOVERED)
    page.wait_for_selector(f".notice >> text={words()['notice.unread']}")
    assert page.evaluate("gruber.parts.point.draft.asking")
    assert len(real_desk.session.decisions()) == before
    caught_up(page)
    page.keyboard.press("y")
    page.wait_for_function("!gruber.parts.point.draft")
    settled(page)
    assert len(real_desk.session.decisions()) == before + 1


HASTY = """new MutationObserver((_, hand) => {
  const keep = document.querySelector("#asked.against [data-answer='draft.keep']");
  if (!keep) return;
  hand.disconnect();
  keep.click();
}).observe(document.querySelector("#asked"), { attributes: true, childList: true, subtree: true })
"""
"""A click on *Keep* as soon as the desk asks."""
LATE = """new MutationObserver((_, hand) => {
  if (!document.querySelector("#asked.against")) return;
  hand.disconnect();
  const pressed = new KeyboardEvent("keydown", { key: "y", code: "KeyY", bubbles: true });
  setTimeout(() => document.body.dispatchEvent(pressed), 600);
}).observe(document.querySelector("#asked"), { attributes: true, childList: true, subtree: true })
"""
"""A key that is pressed as soon as the desk asks, and reaches a busy page later."""


@pytest.mark.parametrize("answer", [HASTY, LATE], ids=["a click too soon", "a key taken late"])
def test_a_press_before_the_question_answers_nothing_and_says_so__law(
    page: Any, real_desk: RealDesk, answer: str
) -> None:
    """Such a click did nothing and said nothing; of a key counted when a busy page took it."""
    box = page.locator('.pane[data-pane="right"]').bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2 + 60, box["y"] + box["height"] / 2 - 60)
    page.wait_for_function("gruber.parts.point.draft && !gruber.isAhead()")
    before = len(real_desk.session.decisions())
    page.evaluate(answer)
    page.keyboard.press("y")
    page.wait_for_selector(f".notice >> text={words()['notice.unread']}")
    assert page.evaluate("gruber.parts.point.draft.asking")
    assert len(real_desk.session.decisions()) == before


def test_a_held_enter_presses_a_button_once__law(page: Any, real_desk: RealDesk) -> None:
    """It went on with the points that came next, which nobody had seen."""
    before = len(real_desk.session.decisions())
    page.focus("[data-act=accept]")
    for _ in range(8):
        page.keyboard.down("Enter")
        page.wait_for_timeout(100)
    page.keyboard.up("Enter")
    page.wait_for_function("!gruber.isAhead()")
    assert len(real_desk.session.decisions()) == before + 1


def test_a_double_click_decides_once__law(page: Any, real_desk: RealDesk) -> None:
    """The second click judged the point that came next, which nobody had seen."""
    before = len(real_desk.session.decisions())
    first = page.evaluate("gruber.parts.point.key.join('|')")
    button = page.locator("[data-act=reject]")
    button.click()
    page.wait_for_function(
        "first => gruber.parts.point.key.join('|') !== first && !gruber.isAhead()", arg=first
    )
    button.evaluate("e => e.dispatchEvent(new MouseEvent('click', { detail: 2, bubbles: true }))")
    settled(page)
    assert len(real_desk.session.decisions()) == before + 1
