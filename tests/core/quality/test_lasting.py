"""What lasts in a picture: where lines run through a place, not where single corners are strong."""

import cv2
import numpy as np

from core.quality.lasting import lines_through
from core.reference.salient import line_structure


def test_roads_that_cross_are_clearer_than_crowns__truth() -> None:
    """Crowns stand out far more than the roads, and their edges run through no place."""
    rng = np.random.default_rng(8201)
    picture = np.full((400, 400), 120.0)
    for _ in range(120):
        middle = rng.integers(20, 380, 2)
        if abs(middle[1] - 200 + (middle[0] - 200) // 3) > 30 and abs(middle[0] - 200) > 30:
            cv2.circle(picture, middle.tolist(), int(rng.integers(3, 7)), 40.0, -1)
    cv2.line(picture, (0, 267), (400, 133), 150.0, 5)
    cv2.line(picture, (200, 0), (200, 400), 150.0, 5)
    shown = cv2.GaussianBlur(picture, (0, 0), 0.8) + rng.normal(0, 2, picture.shape)
    gray, usable = shown.astype(np.float32), np.ones((400, 400), dtype=bool)
    clear = line_structure(gray, usable)[0] * lines_through(gray, usable)
    row, column = np.unravel_index(np.argmax(clear), clear.shape)
    # The middle of two edges of each road is known to a pixel.
    assert np.hypot(row - 200, column - 200) < 2.0


def test_a_single_line_is_no_place__truth() -> None:
    picture = np.full((200, 200), 120.0, dtype=np.float32)
    cv2.line(picture, (0, 90), (200, 110), 150.0, 5)
    noise = np.random.default_rng(3).normal(0, 2, picture.shape)
    gray = (picture + noise).astype(np.float32)
    assert not lines_through(gray, np.ones((200, 200), dtype=bool))[90:110, 60:140].any()
