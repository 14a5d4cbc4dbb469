"""New points from photos: a detail clicked in one scan, then in others, until they place it."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from core.arrays import PixelPoints
from core.block import UNKNOWN_M
from core.control.prediction import shown_in
from sessions.decisions import AddPoint, Decision, Place, Recorded, Withdraw, standing
from ui.review.compare import ground_from_pixel
from ui.review.queue import with_filter
from ui.review.snapshot import DeskSnapshot
from ui.review.state import DeskState, Draft, QueueFilter, Seat

ORTHO, PHOTOS = "H#", "N###"
"""Names of points chosen in the ortho, and of details of photos."""
DIGITS = re.compile(r"#+")
UNKNOWN = (UNKNOWN_M, UNKNOWN_M, UNKNOWN_M)
LEAST_PHOTOS = 2
"""Rays that a new point needs for its coordinates: until then all said of it is one act."""


def next_name(pattern: str, state: DeskState, recorded: Sequence[Recorded]) -> str:
    """N001, N002 and so on: never a name that was given before, withdrawn points included."""
    names = [item.decision.point_id for item in recorded if isinstance(item.decision, AddPoint)]
    return name_after(pattern, (*names, *state.block.surveyed))


def name_after(pattern: str, taken: Iterable[str]) -> str:
    """The next name of a pattern: one more than the greatest number that was ever given.

    Args:
        pattern: Text with one run of `#`, which stands for a number of at least so many digits; it
            is added at the end where there is none.
        taken: All names, those of points that were taken back included.
    """
    pattern = pattern if "#" in pattern else f"{pattern}#"
    run = DIGITS.search(pattern)
    assert run is not None
    before, after = pattern[: run.start()], pattern[run.end() :]
    known = re.compile(rf"{re.escape(before)}(\d+){re.escape(after)}")
    numbers = [int(match[1]) for name in taken if (match := known.fullmatch(name))]
    return f"{before}{max(numbers, default=0) + 1:0{len(run[0])}d}{after}"


def begun(
    seat: Seat, desk: DeskSnapshot, photo_id: str, pixel: PixelPoints
) -> tuple[Seat, AddPoint] | None:
    """A new point where somebody pointed at a detail of a scan, and a draft of its place there.

    None where the photo does not show it within its picture.

    Args:
        seat: Who pointed.
        desk: The desk.
        photo_id: The scan.
        pixel: The place, scan pixels, (1, 2).
    """
    picture = desk.drawn[photo_id]
    ground = ground_from_pixel(pixel, picture, desk.dem, picture.photo.ground_height_m)
    if not np.isfinite(ground).all() or shown_in(picture.photo, picture.camera, ground)[1][0] <= 0:
        return None
    name = next_name(PHOTOS, desk.state, desk.recorded)
    column, row = (float(value) for value in pixel[0])
    east, north, height = (float(value) for value in ground[0])
    seat = with_filter(seat, desk.rows, QueueFilter("measure"))
    key = name, photo_id
    seat = replace(seat, current=key).with_draft(Draft(key, Place(*key, column, row)))
    return seat, AddPoint(name, east, north, height, UNKNOWN, ())


def given_up(state: DeskState, recorded: Sequence[Recorded], name: str) -> tuple[Withdraw, ...]:
    """What takes a new point back of which nothing was kept yet; nothing for any other."""
    point = state.block.surveyed.get(name)
    if (
        point is None
        or point.role != "new"
        or any(key[0] == name for key in state.block.measurements)
    ):
        return ()
    made = _made(recorded, name)
    return () if made is None else (Withdraw(made.decision_id),)


def act_of(
    decisions: Sequence[Decision], state: DeskState, recorded: Sequence[Recorded]
) -> Recorded | None:
    """The record that began a new point which decisions measure, while it has no coordinates yet.

    Both are undone together.
    """
    names = {one.point_id for one in decisions if isinstance(one, Place)}
    if len(names) != 1 or not all(isinstance(one, Place) for one in decisions):
        return None
    name = names.pop()
    point, every = state.block.surveyed.get(name), state.block.measurements.values()
    rays = sum(item.used for item in every if item.point_id == name)
    if point is None or point.role != "new" or rays >= LEAST_PHOTOS:
        return None
    return _made(recorded, name)


def _made(recorded: Sequence[Recorded], name: str) -> Recorded | None:
    """The standing record of a new point."""
    for item in standing(recorded):
        if isinstance(item.decision, AddPoint) and item.decision.point_id == name:
            return item
    return None
