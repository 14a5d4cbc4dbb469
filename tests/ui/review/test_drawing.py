"""Masks drawn by hand: messages, decisions, and what the sheet shows."""

import numpy as np
import pytest

from core.block import Block
from sessions.decisions import DrawMask, Recorded
from sessions.replay import replay
from tests.sessions.conftest import block as block
from ui.review.drawing import MaskDrawn, decided_mask, mask_from_message, mask_part
from ui.review.gestures import gesture_from_message
from ui.review.state import DeskState

MESSAGE = {
    "kind": "draw", "photo": "A", "outline": [[1, 2], [30, 2], [30, 40]], "width": 0,
    "hides": True, "camera": False,
}  # fmt: skip


def test_an_outline_and_a_touch_of_the_brush_are_gestures__law() -> None:
    drawn = gesture_from_message("s", MESSAGE)
    assert isinstance(drawn, MaskDrawn)
    assert drawn.outline == ((1.0, 2.0), (30.0, 2.0), (30.0, 40.0))
    touch = mask_from_message("s", {**MESSAGE, "outline": [[5, 5]], "width": 12})
    assert touch.width == 12


@pytest.mark.parametrize(
    "wrong",
    [
        {"outline": [[1, 2], [3, 4]]}, {"outline": [], "width": 3}, {"width": -1},
        {"outline": [[1e9, 0], [1, 1], [2, 5]]}, {"outline": [[1, 2]] * 6000},
        {"outline": [[float("nan"), 0], [1, 1], [2, 5]]}, {"photo": None, "outline": "x"},
    ],
)  # fmt: skip
def test_what_covers_nothing_or_lies_nowhere_is_no_gesture__truth(wrong: dict[str, object]) -> None:
    assert gesture_from_message("s", {**MESSAGE, **wrong}) is None


def test_a_mask_of_a_camera_is_decided_on_the_film__law(block: Block) -> None:
    drawn = mask_from_message("s", {**MESSAGE, "camera": True, "width": 20})
    (decided,) = decided_mask(drawn, block)
    film = block.photos["A"].interior.film_from_pixel(np.array(drawn.outline))
    assert np.allclose(decided.outline, film, atol=1e-4)
    assert (decided.subject, decided.on_film) == ("wide", True)
    assert decided.width == pytest.approx(20 * 0.015, rel=0.01)
    assert decided_mask(mask_from_message("s", {**MESSAGE, "photo": "gone"}), block) == ()


def test_the_sheet_names_what_a_mask_took_out_of_use__truth(block: Block) -> None:
    item = block.measurements["P1", "A"]
    mask = DrawMask("A", ((item.column, item.row),), 60.0, hides=True)
    recorded = [Recorded(1, "2026-01-01T10:00:00", "ada", mask)]
    state = DeskState(replay(block, recorded).block, None, made={})  # pyright: ignore[reportArgumentType]
    part = mask_part(state, block, {}, recorded)
    by_name = {photo["photo"]: photo for photo in part["photos"]}
    assert by_name["A"]["out"] == ["P1"]
    assert by_name["A"]["hidden"]
    assert not by_name["B"]["out"]
    assert [(one["id"], one["who"]) for one in part["strokes"]] == [(1, "ada")]
