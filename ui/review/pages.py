"""The parts of each seat's page, renewed only where they changed."""

from collections.abc import Callable, Iterator, Sequence
from functools import cache
from itertools import islice

from ui.review.board import board_drafts_part, board_part
from ui.review.checking import parts_now, seat_checks, signatures_part, still_reads
from ui.review.drafts import opponent_of
from ui.review.drawing import mask_part
from ui.review.history import history_of
from ui.review.judgement import judge_desk, without_readings
from ui.review.mosaic import mosaic_part
from ui.review.picture import (
    Part,
    Pictured,
    order_part,
    point_part,
    queue_part,
    scene_part,
    status_part,
)
from ui.review.placement import placement_part
from ui.review.quality import quality_part
from ui.review.rows import queue_row
from ui.review.scene import ScenePicture, scene_picture
from ui.review.second_reading import blind_keys, blinded, is_blind, without_places
from ui.review.sheet_samples import sheets_part
from ui.review.snapshot import DeskSnapshot
from ui.review.state import SceneOptions, Seat

Scene = Callable[[], ScenePicture]
SCENE = "3D"
"""Under this name it is remembered what a scene was last made of."""
Made = tuple[tuple[object, ...], Callable[[], Part]]
"""What a part is made of, and what makes it."""


class Pages:
    """Remembers what every part of every seat's page was last made of."""

    def __init__(self) -> None:
        self._sources: dict[tuple[str, str], tuple[object, ...]] = {}
        self._scene_sources: tuple[object, ...] = ()
        self._scene: Scene | None = None

    def changed_parts(
        self, seat: Seat, desk: DeskSnapshot, most: int | None = None
    ) -> dict[str, Part]:
        """The parts of a seat's page that are not as they were shown last; of the first so many."""
        changed: dict[str, Part] = {}
        for name, (sources, make) in islice(page_parts(seat, desk), most):
            if not _are_same(self._sources.get((seat.seat_id, name), ()), sources):
                self._sources[seat.seat_id, name] = sources
                changed[name] = make()
        return changed

    def changed_scene(self, seat: Seat, desk: DeskSnapshot) -> Scene | None:
        """What makes the picture of a seat's 3D scene; None where it is as it was shown last."""
        state, figures = desk.state, desk.table.figures
        shown = desk.stale, desk.outlines, figures.misfits, desk.tie_vectors
        if not _are_same(self._scene_sources, (state.block, state.report, *shown)):
            self._scene_sources = (state.block, state.report, *shown)
            # Made by who draws it, once for all seats.
            stale, outlines, dem = desk.stale, desk.outlines, desk.dem
            self._scene = cache(
                lambda: scene_picture(
                    state,
                    stale,
                    outlines,
                    dem,
                    away=figures.misfits,
                    top_m=figures.ramp_top_m,
                    tied=desk.tie_vectors,
                )
            )
        hidden, scene = blind_keys(state, seat), self._scene
        sources = scene, seat.scene, seat.current, hidden
        if _are_same(self._sources.get((seat.seat_id, SCENE), ()), sources):
            return None
        self._sources[seat.seat_id, SCENE] = sources
        if not hidden or scene is None:
            return scene
        return cache(lambda: scene().without_vectors(hidden))

    def forget(self, seat_id: str) -> None:
        """Show a seat everything again: a page or a scene was opened there."""
        self._sources = {key: value for key, value in self._sources.items() if key[0] != seat_id}


def page_parts(seat: Seat, desk: DeskSnapshot) -> Iterator[tuple[str, Made]]:
    """Every part of a seat's page by name, what deciding changes first."""
    state, table = desk.state, desk.table
    block, report, others = state.block, state.report, desk.others(seat.seat_id)
    people = tuple((other.current, other.operator) for other in others)
    adjusted = (block, report, state.before, state.extra, desk.drawn)
    judged = desk.recorded, desk.mosaic_version, desk.sheets, seat.operator, desk.rules
    subject = seat.draft_of(seat.current) or seat.current
    trial = desk.trials.get(subject) if subject else None
    pointed = (seat, table, trial, desk.recorded, *adjusted)
    yield "point", (pointed, lambda: seat_point(seat, desk))
    yield "rows", ((table.lines,), lambda: table.lines)
    yield "order", ((seat.order, table.places), lambda: order_part(seat, table.places))
    looked_at = [(key, name) for key, name in people if key]
    yield (
        "queue",
        (
            (seat, table.places, people),
            lambda: queue_part(seat, table.places, looked_at),
        ),
    )
    top_m = table.figures.ramp_top_m
    yield "scene", ((seat.scene, top_m, report), lambda: scene_part(seat, state, top_m))
    yield (
        "status",
        (
            (
                state,
                desk.rows,
                desk.stale,
                seat.operator,
                len(seat.drafts) + len(seat.marks),
                people,
                desk.rules,
            ),
            lambda: status_part(state, desk.rows, desk.stale, seat, others, rules=desk.rules),
        ),
    )
    if seat.quality:
        yield (
            "quality",
            (
                (
                    *adjusted,
                    state.free,
                    state.holes,
                    desk.outlines,
                    desk.adjustments,
                    seat.pair,
                    *judged,
                    desk.rules_stand,
                ),
                lambda: seat_quality(seat, desk),
            ),
        )
    yield from _sheet_parts(seat, desk, adjusted)


def _sheet_parts(
    seat: Seat, desk: DeskSnapshot, adjusted: tuple[object, ...]
) -> Iterator[tuple[str, Made]]:
    """What the sheet shows that is open, if one is."""
    state = desk.state
    if seat.sheet == "board":
        yield (
            "board",
            (
                (*adjusted, desk.recorded),
                lambda: board_part(state, desk.initial, desk.drawn, desk.recorded),
            ),
        )
        yield (
            "board_drafts",
            (
                (seat.marks, seat.asking, *adjusted, desk.recorded),
                lambda: board_drafts_part(seat, state, desk.initial, desk.recorded),
            ),
        )
    if seat.sheet == "mask":
        yield (
            "mask",
            (
                (state.block, desk.base, desk.drawn, desk.recorded),
                lambda: mask_part(state, desk.base, desk.drawn, desk.recorded),
            ),
        )
    if seat.sheet == "mosaic":
        sources = (state.mosaic, desk.stale, desk.outlines, state.report, desk.recorded)
        of_sheets = desk.sheets, desk.mosaic_version, seat.operator, desk.rules
        yield "mosaic", ((*sources, *of_sheets), lambda: seat_mosaic(seat, desk))
    if seat.sheet == "checks":
        shown = desk.mosaic_version, state.mosaic
        sources = (desk.recorded, seat.operator, *shown, state.block, state.evidence, desk.rules)
        yield "checks", (sources, lambda: seat_checks(seat.operator, desk))
    if seat.sheet == "placement":
        yield "placement", (adjusted, lambda: placement_part(state, desk.initial, desk.doubts))


def seat_quality(seat: Seat, desk: DeskSnapshot) -> Part:
    """The block's quality, what readings say of it, and who has signed it."""
    judged = judge_desk(desk)
    reads = still_reads(desk, seat.operator)
    if reads:
        judged = without_readings(judged)
    told = quality_part(judged, desk.state, desk.adjustments, seat.pair, rules=desk.rules)
    now = parts_now(desk)
    told["sheets"] = sheets_part(desk, blind=reads)
    told["broken"] = not desk.rules_stand
    return {**told, "reads": reads, "signatures": signatures_part(desk, now), "judged": now}


def seat_mosaic(seat: Seat, desk: DeskSnapshot) -> Part:
    """The mosaic, with the sheets of it that are judged for all."""
    blind = still_reads(desk, seat.operator)
    return {**mosaic_part(desk), "sampled": sheets_part(desk, blind=blind)["sample"]}


def seat_point(seat: Seat, desk: DeskSnapshot) -> Part:
    """The numbers of what a seat looks at."""
    key = seat.current
    if key is None:
        return None
    draft, state, rows = seat.draft_of(key), desk.state, desk.rows
    blind = is_blind(state, seat, key)
    history = history_of(key, desk.recorded, desk.state.extra, seat.operator)
    if blind:
        state = blinded(state, seat, key[0])
        hidden = desk.state.block.measurements.keys() - state.block.measurements.keys()
        rows = {**rows, **{one: queue_row(state, desk.table.figures, one) for one in hidden}}
    pictured = Pictured(
        desk.drawn,
        desk.dem,
        None if blind and draft is None else desk.trials.get(draft or key),
        without_places(history, seat) if blind else history,
        opponent_of(key, seat.operator, desk.recorded),
        desk.table.by_point.get(key[0], ()),
    )
    return point_part(state, seat, rows, pictured)


def _are_same(old: Sequence[object], new: Sequence[object]) -> bool:
    """True when nothing changed; large values are never looked into."""
    small = (Seat, SceneOptions, tuple, str, int, float)
    return len(old) == len(new) and all(
        one is other or (isinstance(other, small) and one == other)
        for one, other in zip(old, new, strict=True)
    )
