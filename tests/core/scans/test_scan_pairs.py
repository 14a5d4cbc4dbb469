"""Rolls of many scans: those of one photo are found, and not all pairs are matched."""

import cv2
import numpy as np
import pytest

from core.scans.naming import WAYS
from core.scans.scan_pairs import MOST_PAIRS, NEIGHBOURS, SIDE, look_from, same_photo, sides_of


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
def test_pairs_that_are_matched_grow_with_the_photos__law(hang_together: bool) -> None:
    names, matched = [f"{number:03}" for number in range(300)], list[str]()

    def matches(first: str, second: str) -> tuple[int, int]:
        """Photos of ten follow each other; the last hundred are mirrored."""
        matched.append(second)
        near = hang_together and int(second) - int(first) <= 10
        turned = (int(first) < 200) != (int(second) < 200)
        return (0, 50) if near and turned else (50 * near, 0)

    sides = sides_of(names, matches)
    assert len(matched) <= (NEIGHBOURS if hang_together else MOST_PAIRS) * len(names)
    groups = [
        {side[name] for name in names[:200]} | {not side[n] for n in names[200:]} for side in sides
    ]
    assert [len(group) for group in groups] == [1] * hang_together
