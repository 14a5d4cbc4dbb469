"""Rows of the queue in a real Chromium: marked together, in sight, searched."""

from tests.browser.hands import caught_up, current, drawn, grow

SHOWN = """gruber.parts.queue.shown.map(index => gruber.parts.rows[index].slice(0, 2).join("|"))"""
DRAWN = """[...document.querySelectorAll('.row')].sort((a, b) => a.offsetTop - b.offsetTop)
  .map(row => row.dataset.key)"""
MARKED = DRAWN.replace(".row", ".row.marked")


def test_a_range_marked_by_key_holds_the_row_that_is_shown__law(sit):
    """`Y` decided the row that was left, not the one in the pictures."""
    page = sit(scene=False)
    keys = page.evaluate(SHOWN)
    page.click(f'.row[data-key="{keys[2]}"]')
    page.focus("#table")

    def marks(key: str) -> list[str]:
        page.keyboard.press(key)
        caught_up(page)
        drawn(page)
        return page.evaluate(MARKED)

    assert marks("Shift+ArrowDown") == keys[2:4]
    assert current(page) == keys[3]
    assert marks("Shift+ArrowDown") == keys[2:5]
    assert marks("Shift+ArrowUp") == keys[2:4]
    assert marks("Shift+Home") == keys[:3]
    assert current(page) == keys[0]
    page.click(f'.row[data-key="{keys[3]}"]', modifiers=["Shift"])
    caught_up(page)
    assert page.evaluate(MARKED) == keys[2:4]
    # A draft is about one row.
    page.click('.pane[data-pane="right"]', position={"x": 60, "y": 60})
    page.wait_for_selector(".notice:has-text('single row')")
    assert not page.evaluate("gruber.parts.point.draft")
    assert marks("Escape") == []
    page.focus("#table")
    assert marks("Home") == []
    assert current(page) == keys[0]
    assert marks("Control+a") == [key for key in page.evaluate(DRAWN) if key in keys]
    assert page.text_content("#acts [data-act=reject] > span") == f"Reject {len(keys)}"
    assert page.evaluate("getSelection().toString()") == ""
    assert marks("ArrowDown") == []
    assert current(page) == keys[1]


def test_the_current_row_is_in_sight_after_the_scene_had_the_window__law(sit):
    page = sit(scene=False)
    page.click('.chip[data-state="all"]')
    caught_up(page)
    drawn = page.evaluate(DRAWN)
    grow(page, "compare")
    for _ in drawn:
        page.keyboard.press("j")
        caught_up(page)
    assert page.evaluate("gruber.parts.point.key.join('|')") not in drawn
    page.click('[data-grow="compare"]')
    page.wait_for_selector("#queue:visible")
    page.wait_for_function(
        "() => { const row = document.querySelector('.row.current')?.getBoundingClientRect();"
        " const table = document.querySelector('#table').getBoundingClientRect();"
        " return row && row.top >= table.top && row.bottom <= table.bottom; }"
    )


def test_esc_empties_the_search_and_then_leaves_it__law(sit):
    """What was typed next went to the keys of the desk."""
    page = sit(scene=False)
    page.fill("#sieve-text", "no point is named so")
    page.wait_for_selector("#queue-empty:not([hidden])")
    page.keyboard.press("Escape")
    page.wait_for_selector("#queue-empty", state="hidden")
    page.keyboard.press("y")
    assert page.input_value("#sieve-text") == "y"
    for _ in range(2):
        page.keyboard.press("Escape")
    assert page.evaluate("document.activeElement === document.body")
    assert page.evaluate("gruber.parts.status.decided") == 0
