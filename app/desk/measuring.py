"""Measurements in scans that a gesture asked for, computed outside the review thread."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from jaxtyping import Float64

from app.desk.messages import Deliver, Measured, MeasuringBegun, ProposalsWanted, Proposed
from app.settings import Threads
from core.adjustment.adjusted import ExteriorSigmas
from core.block import HAND_SIGMA_PX, Block, Measurement, Peak
from core.control.likeness import OPERATOR, Likeness
from core.control.prediction import EDGE_MM, JointErrors, shown_in
from core.doubts import Failure
from core.geometry.camera import Camera
from core.matching.reference import SigmasAt, usual_sigmas_m
from core.progress import Progress, Work
from core.said import say
from core.scans.centring import Centre
from core.scans.corrected_marks import Example, corrected_scan, fill_marks, snap_mark
from core.scans.interior_orientation import ScanOrientation
from core.scans.judging import FiducialSet
from sessions.decisions import AddPoint, FillMarks, Place, PlaceFiducial, Recorded
from sessions.readings import SAME_PLACE_PX
from sessions.scan_decisions import mark_changes, with_effect
from ui.review.compare import HeightSource, LikenessSource, PlanePoints
from ui.review.drafts import apply_draft
from ui.review.gestures import Gesture, PointAsked, Refined
from ui.review.mark_gestures import MarkPlaced
from ui.review.new_points import ORTHO, next_name
from ui.review.second_reading import blinded, is_blind
from ui.review.snapshot import DeskSnapshot
from ui.review.state import DeskState, InitialState, Notice, Seat
from ui.review.to_measure import stated_place


@dataclass(frozen=True, slots=True, eq=False)
class Errors:
    """How well photos are oriented."""

    sigmas: Mapping[str, ExteriorSigmas]
    """Each by itself."""
    joint: JointErrors | None = None
    """All together, where the equations are at hand."""


class PhotoToPhoto(Protocol):
    """Compares scans with each other, and with the ortho where there is one."""

    def proposals(
        self, block: Block, errors: Errors, point_id: str, measured: Sequence[Measurement]
    ) -> Sequence[Measurement]:
        """Where photos show a point, by where it is measured."""
        ...

    def refined(
        self, block: Block, errors: Errors, place: Measurement, measured: Sequence[Measurement]
    ) -> Measurement | Failure:
        """A place on what other photos show of its point."""
        ...


NOTHING_ALIKE = Failure("there is nothing to compare with")
SURE, AGREEING_PX = 0.7, 0.3
"""Likeness and agreement of its two ways that make a mark an example for others."""
SAME_PIXEL = 0.02
"""Share by which the pixels of two scans may differ for one to be an example for the other."""


@dataclass(frozen=True, slots=True, eq=False)
class MeasuringTool:
    """Measures what a gesture asks for; called in a thread of its own."""

    likeness: LikenessSource | None = None
    """Compares reference and scan; None where there is nothing to compare with."""
    sigmas_m: SigmasAt = usual_sigmas_m
    """Standard deviations of reference ortho and DEM at places, metres."""
    transfer: PhotoToPhoto | None = None
    """Finds a place of some photos in others; None where the scans cannot be read."""

    def __call__(
        self, gesture: Gesture | ProposalsWanted, desk: DeskSnapshot, begun: Deliver
    ) -> Measured | Proposed:
        """The decision to record, and what to tell the operator.

        Args:
            gesture: What was asked for.
            desk: The desk when it was asked for.
            begun: Told once it is known that this takes a while.
        """
        match gesture:
            case PointAsked():
                return self._add_point(gesture, desk, begun)
            case Refined():
                return self._refine(gesture, desk)
            case ProposalsWanted():
                return self._propose(gesture, desk)
            case MarkPlaced():
                return self._snap_mark(gesture, desk)
            case _:
                raise AssertionError("no other gesture is measured")

    @staticmethod
    def _snap_mark(gesture: MarkPlaced, desk: DeskSnapshot) -> Measured:
        """The draft of a fiducial, or the fiducial, on its middle."""
        seat = desk.seats.get(gesture.seat_id)
        since = None if seat is None else seat.mark_of(gesture.photo_id, gesture.name)
        found = _snap(gesture, desk.initial)
        return Measured(gesture.seat_id, *found, since, len(desk.recorded))

    def _add_point(self, gesture: PointAsked, desk: DeskSnapshot, begun: Deliver) -> Measured:
        """A new point, measured in every scan that shows it."""
        seat_id, place = gesture.seat_id, (gesture.east, gesture.north)
        shown = photos_showing(desk.state, np.array([place]), desk.dem)
        if not shown:
            return Measured(seat_id, None, Notice("notice.no-scan", grave=True))
        begun(MeasuringBegun(seat_id, Notice("notice.measuring", {"count": str(len(shown))})))
        name = next_name(ORTHO, desk)
        known_m = self.sigmas_m(np.array([place]))[0]
        found = measure_point(desk.state, name, place, (desk.dem, self.likeness), known_m)
        return Measured(seat_id, found, notice_of_point(found), known=len(desk.recorded))

    def _propose(self, wanted: ProposalsWanted, desk: DeskSnapshot) -> Proposed:
        """Where photos show a point in which nobody has measured it yet."""
        state, name = desk.state, wanted.point_id
        photos = {photo for point, photo in state.to_measure.waiting if point == name}
        measured = measurements_of(state, name)
        found: Iterable[Measurement] = ()
        # A new point has no coordinates by which the ortho could show it.
        known = bool(measured) or state.block.surveyed[name].role != "new"
        if self.transfer is not None and known and photos:
            within = self._within(state, photos | {item.photo_id for item in measured})
            found = self.transfer.proposals(within, _errors(state), name, measured)
        mine = tuple(item for item in found if item.photo_id in photos)
        return Proposed(wanted.seat_id, name, mine)

    @staticmethod
    def _within(state: DeskState, photos: Iterable[str]) -> Block:
        """The block of some photos."""
        block = state.oriented
        return block.with_photos({photo: block.photos[photo] for photo in sorted(photos)})

    def _refine(self, gesture: Refined, desk: DeskSnapshot) -> Measured:
        """The measurement, or its draft, on what is alike beside it; and how far that is.

        Alike is what other scans show of a point that hands measure; else the ortho. On the peak
        that was measured a measurement keeps its weight; elsewhere it is as if placed by hand.
        """
        seat_id, key, known = gesture.seat_id, gesture.key, len(desk.recorded)
        seat, state = desk.seats.get(seat_id), desk.state
        draft = None if seat is None else seat.draft_of(key)
        if seat is not None and is_blind(state, seat, key):
            state = blinded(state, seat, key[0])
        measured = state.measurement_of(key)
        drafted = apply_draft(state, draft).measurement_of(key) if draft else None
        start = drafted or measured
        assert start is not None, "only what has a row is refined"
        assert measured is not None, "only what has a row is refined"
        others = [item for item in measurements_of(state, key[0]) if item.photo_id != key[1]]
        by_photos = bool(others) and key in state.to_measure.predictions
        text = "notice.refined.photos" if by_photos else "notice.refined"
        place = self._by_photos(state, start, others) if by_photos else self._by_ortho(state, start)
        if isinstance(place, Failure):
            refused = Notice("notice.not-refined", {"why": place.reason})
            return Measured(seat_id, None, refused, known=known)
        moved = place.column - start.column, place.row - start.row
        values = {
            "distance": f"{np.hypot(*moved):.2f}",
            "column": f"{moved[0]:+.2f}",
            "row": f"{moved[1]:+.2f}",
        }
        away = np.hypot(place.column - measured.column, place.row - measured.row)
        own = away < SAME_PLACE_PX and not state.is_waiting(key)
        sigma = place.sigma_px if by_photos else measured.sigma_px if own else None
        # A second reading stays one: what has a sigma of its own was measured by the program.
        sigma = sigma if state is desk.state else None
        decision = Place(*key, place.column, place.row, sigma)
        return Measured(seat_id, decision, Notice(text, values, draft=key), draft, known)

    def _by_photos(
        self, state: DeskState, start: Measurement, others: Sequence[Measurement]
    ) -> Measurement | Failure:
        """On what other scans show of the point."""
        if self.transfer is None:
            return NOTHING_ALIKE
        within = self._within(state, {start.photo_id, *(item.photo_id for item in others)})
        return self.transfer.refined(within, _errors(state), start, others)

    def _by_ortho(self, state: DeskState, start: Measurement) -> Measurement | Failure:
        """On the peak of likeness to the ortho."""
        point, oriented = state.block.surveyed[start.point_id], state.oriented
        if self.likeness is None or point.role == "new":
            return NOTHING_ALIKE
        photo, camera = oriented.photos[start.photo_id], oriented.camera_of(start.photo_id)
        found = self.likeness(photo, camera, point.position[None, :])
        place = found if isinstance(found, Failure) else found.refined(start.pixel)
        if isinstance(place, Failure):
            return place
        column, row = (float(value) for value in place[0])
        return replace(start, column=column, row=row)


FindLike = Callable[
    [Mapping[str, ScanOrientation], Camera, Mapping[str, float], str, tuple[float, float], Work],
    Mapping[str, FiducialSet],
]
"""(scans, camera, pixels in mm, photo, place, work): the marks like the one at a place."""
WORKERS = 2
"""Scans that are searched side by side."""


@dataclass(frozen=True, slots=True)
class Filling:
    """Finds and names the marks like an example, in all scans of its camera."""

    find: FindLike
    """What searches the scans."""

    def __call__(
        self, gesture: MarkPlaced, desk: DeskSnapshot, progress: Progress
    ) -> tuple[FillMarks | None, Notice]:
        """The decision to record, and what to tell the operator.

        Raises:
            ScanError: A scan cannot be read.
            Cancelled: The operator stopped it.
        """
        initial, name = desk.initial, desk.state.block.photos[gesture.photo_id].camera
        films = _standing(desk, name)
        if gesture.photo_id not in films:
            return None, Notice("notice.not-filled", {"why": "the scan is not at hand"})
        camera = initial.cameras.get(name, desk.state.block.cameras[name])
        pixels_mm = {photo: initial.pixel_mm[photo] for photo in films}
        place, threads = (gesture.column, gesture.row), Threads(WORKERS)
        try:
            work = Work(progress, threads.map)
            found = self.find(films, camera, pixels_mm, gesture.photo_id, place, work)
        finally:
            threads.close()
        filled = fill_marks(films, found, camera, pixels_mm)
        if isinstance(filled, Failure):
            return None, Notice("notice.not-filled", {"why": filled.reason})
        values = {
            "marks": str(sum(len(marks) for marks in filled.found.values())),
            "scans": str(len(filled.found)),
            "all": str(len(films)),
        }
        bare = [photo for photo in filled.found if not films[photo].interior.names]
        told = "notice.filled-anew" if bare else "notice.filled"
        decision = FillMarks(
            name, gesture.photo_id, *place, filled.found, filled.places_mm, filled.sigma_mm
        )
        return decision, Notice(told, {**values, "bare": str(len(bare))})


def _errors(state: DeskState) -> Errors:
    """As the newest adjustment tells."""
    influence, report = state.evidence.influence, state.report
    joint = None if influence is None else JointErrors(influence, report.unit)
    return Errors(report.exterior_sigmas, joint)


def measurements_of(state: DeskState, point_id: str) -> tuple[Measurement, ...]:
    """Where a point is measured and in use."""
    every = state.block.measurements.values()
    return tuple(item for item in every if item.point_id == point_id and item.used)


class Proposer:
    """Wants proposals of a point as soon as somebody looks where it is not measured yet.

    Once for each set of its measurements, while it has the same coordinates: what was measured
    since says more.
    """

    def __init__(self) -> None:
        self._wanted: dict[str, tuple[bytes, tuple[Measurement, ...]]] = {}

    def wanted(self, state: DeskState, seats: Iterable[Seat]) -> Iterator[ProposalsWanted]:
        """What to look for now."""
        block = state.block
        still = {k: v for k, v in self._wanted.items() if v[0] == stated_place(block, k)}
        self._wanted = still
        for seat in seats:
            if seat.current is None or not state.is_waiting(seat.current):
                continue
            name = seat.current[0]
            asked = stated_place(block, name), measurements_of(state, name)
            if self._wanted.get(name) != asked:
                self._wanted[name] = asked
                yield ProposalsWanted(seat.seat_id, name)


def _snap(gesture: MarkPlaced, initial: InitialState) -> tuple[PlaceFiducial | None, Notice]:
    """A mark on its middle beside the place that was pointed at."""
    place = gesture.column, gesture.row
    found = snap_to_mark(initial, gesture.photo_id, gesture.name, place)
    if isinstance(found, Failure):
        return None, Notice("notice.not-snapped", {"why": found.reason})
    values = {
        "name": gesture.name,
        "distance": f"{np.hypot(found.column - place[0], found.row - place[1]):.2f}",
        "alike": f"{found.correlation:.2f}",
    }
    decision = PlaceFiducial(gesture.photo_id, gesture.name, found.column, found.row)
    return decision, Notice("notice.snapped", values)


def notice_of_point(point: AddPoint) -> Notice:
    """How often a new point was found."""
    sure = sum(item.used for item in point.measured)
    values = {"what": point.point_id, "sure": f"{sure}", "count": f"{len(point.measured)}"}
    return Notice("notice.added", values)


def is_overtaken(decision: Place | PlaceFiducial, newer: Sequence[Recorded]) -> bool:
    """True when somebody decided about the same thing while it was measured, by what was shown."""
    names = (
        ("photo_id", "name") if isinstance(decision, PlaceFiducial) else ("point_id", "photo_id")
    )
    subject = [getattr(decision, name) for name in names]
    others = [[getattr(item.decision, name, None) for name in names] for item in newer]
    return subject in others


def photos_showing(
    state: DeskState, plane: PlanePoints, dem: HeightSource
) -> dict[str, np.ndarray]:
    """Oriented photos whose frame shows a place (1, 2), with the pixel where they should.

    Those that show it at the very edge only where no other does.
    """
    position = np.column_stack([plane, dem.heights(plane)])
    oriented, found, at_edge = state.oriented, dict[str, np.ndarray](), dict[str, np.ndarray]()
    if not np.isfinite(position).all():
        return found
    for name, photo in oriented.photos.items():
        camera = oriented.camera_of(name)
        pixel, margin = shown_in(photo, camera, position)
        if photo.oriented and margin[0] > 0:
            (found if margin[0] > EDGE_MM else at_edge)[name] = pixel
    return found or at_edge


def measure_point(
    state: DeskState,
    name: str,
    place: tuple[float, float],
    sources: tuple[HeightSource, LikenessSource | None],
    known_m: Float64[np.ndarray, "2"],
) -> AddPoint:
    """The point with a measurement in every scan that shows it.

    Where reference and scan are not alike near the predicted place, the measurement is dubious and
    lies there, to be placed by hand; one no more alike than chance has it is dubious as well.

    Args:
        state: The block with its newest adjustment.
        name: Name of the new point.
        place: Easting and northing, metres.
        sources: Heights; and what compares reference and scan.
        known_m: Standard deviations there of reference ortho per axis and DEM, metres.
    """
    dem, likeness = sources
    plane = np.array([place])
    height = float(dem.heights(plane)[0])
    oriented, shown = state.oriented, photos_showing(state, plane, dem)
    measured: list[Measurement] = []
    for photo_id, pixel in shown.items():
        photo, camera = oriented.photos[photo_id], oriented.camera_of(photo_id)
        found: Likeness | Failure = Failure("there is nothing to compare with")
        if likeness is not None:
            found = likeness(photo, camera, np.array([[*place, height]]))
        measured.append(_measured(name, photo_id, pixel, found))
    plan_m, height_m = known_m.tolist()
    return AddPoint(name, *place, height, (plan_m, plan_m, height_m), tuple(measured))


def with_name(found: AddPoint, name: str) -> AddPoint:
    """The same point under another name."""
    measured = tuple(replace(item, point_id=name) for item in found.measured)
    return replace(found, point_id=name, measured=measured)


def _measured(
    name: str, photo_id: str, pixel: np.ndarray, likeness: Likeness | Failure
) -> Measurement:
    """On the peak of likeness beside the predicted place; there, and dubious, without one.

    A peak no higher than chance brings in such a window is dubious too: not used until the operator
    accepts it.
    """
    refined = likeness if isinstance(likeness, Failure) else likeness.refined(pixel)
    if isinstance(likeness, Failure) or isinstance(refined, Failure):
        column, row = (float(value) for value in pixel[0])
        return Measurement(
            name, photo_id, column, row, HAND_SIGMA_PX, 0.0, "dubious",
            say("predicted only: not found by likeness"),
        )  # fmt: skip
    column, row = (float(value) for value in refined[0])
    height, least = likeness.height_at(refined), likeness.chance_height
    score = float(np.clip(likeness.value_at(refined), 0.0, 1.0))
    sigma = HAND_SIGMA_PX * max(1.0, likeness.reduction / 2)
    found = Measurement(
        name, photo_id, column, row, sigma, score,
        peaks=(Peak(column, row, sigma, height, OPERATOR.name),),
    )  # fmt: skip
    if height >= least:
        return found
    return replace(
        found,
        status="dubious",
        reason=say(
            "its peak is {height:.1f} sigma high; chance alone brings up to {least:.1f} here",
            height=height,
            least=least,
        ),
    )


def snap_to_mark(
    initial: InitialState, photo_id: str, name: str, place: tuple[float, float]
) -> Centre | Failure:
    """The middle of a mark beside the place that somebody pointed at."""
    film = initial.films.get(photo_id)
    if film is None:
        return Failure("the scan is not at hand")
    pixel_mm = film.interior.pixel_size_mm
    return snap_mark(film.scan, place, pixel_mm, _example(initial, photo_id, name))


def _example(initial: InitialState, photo_id: str, name: str) -> Example | None:
    """The same mark of the camera where it is surest, in a scan that lies the same way."""
    own = initial.films[photo_id]
    size = own.interior.pixel_size_mm
    candidates = [
        (mark.correlation, Example(film.scan, (mark.column, mark.row)))
        for other, film in initial.films.items()
        if other != photo_id
        and film.way == own.way
        and abs(film.interior.pixel_size_mm / size - 1) < SAME_PIXEL
        for mark in film.fiducials
        if mark.name == name
        and mark.correlation > SURE
        and mark.disagreement_px < AGREEING_PX
        and name in film.interior.names
    ]
    return max(candidates, key=lambda pair: pair[0])[1] if candidates else None


def _standing(desk: DeskSnapshot, camera: str) -> dict[str, ScanOrientation]:
    """The scans of a camera with all that was said about their marks."""
    block, films = desk.state.block, desk.initial.films
    changes = with_effect(mark_changes(desk.recorded))
    standing: dict[str, ScanOrientation] = {}
    for name, photo in block.photos.items():
        film = films.get(name)
        if film is None or photo.camera != camera:
            continue
        if name in changes:
            pixel_mm = desk.initial.pixel_mm[name]
            film = corrected_scan(film, block.cameras[camera], pixel_mm, changes[name])
        used = tuple(mark for mark in film.fiducials if mark.name in film.interior.names)
        standing[name] = replace(film, fiducials=used)
    return standing
