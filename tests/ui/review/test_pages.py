"""Pages: every part is shown once, and again only where it changed."""

from dataclasses import replace

from core.quality.job_rules import USUAL_RULES
from ui.review.pages import Pages, page_parts, seat_point
from ui.review.state import Seat

ALWAYS = {"point", "rows", "order", "queue", "scene", "status"}


def test_a_page_gets_everything_once__law(desk, seat):
    pages = Pages()
    assert set(pages.changed_parts(seat, desk)) == ALWAYS
    assert pages.changed_parts(seat, desk) == {}
    assert set(pages.changed_parts(replace(seat, seat_id="seat-2"), desk)) == ALWAYS


def test_a_step_changes_point_and_queue_only__law(desk, seat):
    pages = Pages()
    pages.changed_parts(seat, desk)
    stepped = replace(seat, current=seat.order[4])
    assert set(pages.changed_parts(stepped, desk)) == {"point", "queue"}


def test_another_name_changes_what_shows_it__law(desk, seat):
    pages = Pages()
    pages.changed_parts(seat, desk)
    assert "status" in pages.changed_parts(replace(seat, operator="berta"), desk)


def test_rules_changed_or_damaged_since_are_shown_where_the_block_is_judged__law(desk, seat):
    """The verdict stood with the limits of before until something was decided."""
    pages, judging = Pages(), replace(seat, quality=True)
    first = pages.changed_parts(judging, desk)["quality"]
    strict = replace(desk, rules=replace(USUAL_RULES, position_m=0.01))
    changed = pages.changed_parts(judging, strict)
    assert changed.keys() >= {"quality", "status"}
    assert changed["quality"]["rules"] != first["rules"]
    damaged = pages.changed_parts(judging, replace(strict, rules_stand=False))
    assert damaged["quality"]["broken"]


def test_a_page_that_was_opened_anew_gets_everything_again__law(desk, seat):
    pages = Pages()
    pages.changed_parts(seat, desk)
    assert pages.changed_scene(seat, desk) is not None
    pages.forget(seat.seat_id)
    assert set(pages.changed_parts(seat, desk)) == ALWAYS
    assert pages.changed_scene(seat, desk) is not None


def test_a_scene_is_made_again_only_for_another_block_or_switch__law(desk, seat):
    pages = Pages()
    first = pages.changed_scene(seat, desk)
    assert pages.changed_scene(seat, desk) is None
    hidden = replace(seat, scene=replace(seat.scene, hidden=frozenset({"points"})))
    assert pages.changed_scene(hidden, desk) is first


def test_views_are_made_only_while_they_are_open__law(desk, seat):
    def names(one: Seat) -> set[str]:
        return {name for name, _ in page_parts(one, desk)}

    assert names(seat) == ALWAYS
    assert names(replace(seat, quality=True)) == ALWAYS | {"quality"}
    assert names(replace(seat, sheet="board")) == ALWAYS | {"board", "board_drafts"}
    assert names(replace(seat, sheet="placement")) == ALWAYS | {"placement"}


def test_who_looks_at_nothing_is_shown_nothing__law(desk, seat):
    assert seat_point(replace(seat, current=None), desk) is None
    assert seat_point(seat, desk)["key"] == list(seat.current)
