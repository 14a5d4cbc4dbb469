"""New points from photos: a detail clicked in one scan, then in others, until they place it."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from core.arrays import PixelPoints
from core.block import UNKNOWN_M
from core.control.prediction import shown_in
from sessions.decisions import AddPoint, Decision, Place, Recorded, standing
from sessions.replay import replay
from ui.review.compare import ground_from_pixel
from ui.review.queue import with_filter
from ui.review.snapshot import DeskSnapshot
from ui.review.state import DeskState, Draft, QueueFilter, Seat
from ui.review.to_measure import kept_up

ORTHO, PHOTOS = "H#", "N###"
"""Names of points chosen in the ortho, and of details of photos."""
DIGITS = re.compile(r"#+")
UNKNOWN = (UNKNOWN_M, UNKNOWN_M, UNKNOWN_M)
LEAST_PHOTOS = 2
"""Rays that a new point needs for its coordinates: until then all said of it is one act."""


def next_name(pattern: str, desk: DeskSnapshot) -> str:
    """N001, N002 and so on: never a name that was given before, withdrawn points included."""
    names = [
        item.decision.point_id for item in desk.recorded if isinstance(item.decision, AddPoint)
    ]
    drafted = [name for seat in desk.seats.values() for name in seat.begun]
    return name_after(pattern, (*names, *drafted, *desk.state.block.surveyed))


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


def begun(seat: Seat, desk: DeskSnapshot, photo_id: str, pixel: PixelPoints) -> Seat | None:
    """The seat with a draft of a new point where somebody pointed at a detail of a scan.

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
    name = next_name(PHOTOS, desk)
    column, row = (float(value) for value in pixel[0])
    east, north, height = (float(value) for value in ground[0])
    seat = with_filter(seat, desk.rows, QueueFilter("measure"))
    key = name, photo_id
    begins = AddPoint(name, east, north, height, UNKNOWN, ())
    draft = Draft(key, Place(*key, column, row), begins)
    return replace(seat, current=key).with_draft(draft)


def with_begun(desk: DeskSnapshot, seat: Seat) -> DeskSnapshot:
    """The desk as a seat sees it: with the new points that its drafts begin."""
    begun = seat.begun
    if not begun:
        return desk
    said = [Recorded(0, "", "", point) for point in begun.values()]
    block = replay(desk.state.block, said).block
    state = kept_up(desk.state, replace(desk.state, block=block), desk.dem)
    table = desk.table
    for name in begun:
        table = table.with_point(state, name)
    return replace(desk, state=state, table=table)


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
