"""Rolls of many scans: those of one photo are found, and not all pairs are matched."""

import cv2
import numpy as np
import pytest

import core.scans.scan_pairs as scan_pairs
from core.scans.naming import WAYS
from core.scans.scan_pairs import MOST_PAIRS, NEIGHBOURS, SIDE, look_from, same_photo, sides_shown


def look(rng: np.random.Generator) -> np.ndarray:
    """A photo of fields that lie nowhere else."""
    fields = cv2.GaussianBlur(rng.normal(size=(SIDE, SIDE)).astype(np.float32), (0, 0), 3.0)
    return np.clip(128 + 40 * fields / fields.std(), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("shift", [(0, 0), (2, -2), (-4, 4)])
def test_copies_are_found_among_many_however_they_lie__truth(shift: tuple[int, int]) -> None:
    rng = np.random.default_rng(7)
    looks = {f"{number:03}": look(rng) for number in range(40)}
    for number, way in enumerate(WAYS):
        grain = looks[f"{number:03}"] + rng.normal(0, 12, (SIDE, SIDE))
        moved = np.roll(np.clip(grain, 0, 255).astype(np.uint8), shift, (0, 1))
        looks[f"{number:03}_again"] = np.ascontiguousarray(look_from(moved, way))
    found = {(doubt.evidence["other"], doubt.subject) for doubt in same_photo(looks)}
    assert found == {(f"{number:03}", f"{number:03}_again") for number in range(len(WAYS))}


@pytest.mark.parametrize("hang_together", [True, False])
def test_pairs_that_are_matched_grow_with_the_photos__law(
    monkeypatch: pytest.MonkeyPatch, hang_together: bool
) -> None:
    count, matched = 300, list[int]()

    def agreeing(first: int, second: int) -> int:
        matched.append(second)
        # Mirrored pictures are numbered from nought down; photos of ten follow each other.
        return 50 if second > 0 and hang_together and second - first <= 10 else 0

    monkeypatch.setattr(scan_pairs, "_inside", lambda number, _: np.array([[number, -number]]))
    monkeypatch.setattr(scan_pairs, "_details", lambda gray: int(gray[0, 0]))
    monkeypatch.setattr(scan_pairs, "_agreeing", agreeing)
    sides = sides_shown({f"{number:03}": (number, None) for number in range(1, count + 1)})
    assert len(sides) == (1 if hang_together else 0)
    # As it is and mirrored.
    most = NEIGHBOURS if hang_together else MOST_PAIRS
    assert len(matched) <= 2 * most * count
