"""The marks read by eye are well formed, so that a detection can be judged by them."""

import pytest

from tests.benchmarks.marks_by_eye import SeenPicture, read_seen
from tests.benchmarks.prove_canberra import SEEN

PICTURES = [
    pytest.param(picture, id=f"{kind}-{name}")
    for kind, pictures in read_seen().items()
    for name, picture in pictures.items()
]


@pytest.mark.parametrize("picture", PICTURES)
def test_every_mark_lies_inside_its_picture_and_its_inset__truth(picture: SeenPicture) -> None:
    for mark in picture.marks:
        left, top, right, bottom = mark.box or (0, 0, *picture.size)
        assert 0 <= left < mark.column < right <= picture.size[0], mark
        assert 0 <= top < mark.row < bottom <= picture.size[1], mark
        assert 0 < mark.sure_px <= 3, mark
        assert mark.kind, mark


@pytest.mark.parametrize("picture", PICTURES)
def test_a_mark_is_read_once_or_said_to_be_unreadable__truth(picture: SeenPicture) -> None:
    names = [mark.name for mark in picture.marks]
    assert names or picture.not_read
    assert len({*names, *picture.not_read}) == len(names) + len(picture.not_read)


def test_each_frame_accounts_for_eight_places__truth() -> None:
    frames = read_seen()["frames"]
    assert set(frames) == set(SEEN)
    for frame in frames.values():
        told = {mark.name for mark in frame.marks} | set(frame.not_read)
        assert told == {"UL", "UR", "LR", "LL", "T", "R", "B", "L"}


def test_each_family_has_its_insets_at_the_sides_at_the_corners_or_at_both__truth() -> None:
    families = read_seen()["families"]
    assert len(families) == 23
    corners, sides = {"P1", "P2", "P3", "P4"}, {"P5", "P6", "P7", "P8"}
    for family in families.values():
        assert {mark.name for mark in family.marks} in (corners, sides, corners | sides)
        assert all(mark.box for mark in family.marks)


def test_each_crop_holds_the_mark_of_its_side__truth() -> None:
    crops = read_seen()["crops"]
    assert len(crops) == 28
    for name, crop in crops.items():
        assert [mark.name for mark in crop.marks] + list(crop.not_read) == [name[-1]]
