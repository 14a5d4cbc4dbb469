"""The mosaic at the desk: what its sheet shows, and what a place on it leads to."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any, cast
from zlib import crc32

import numpy as np
import shapely

from core.arrays import Position
from core.block import USED
from core.control.prediction import LEAST_UNIT, pixels_by_plan, plan_errors, shown_in
from core.doubts import Failure
from core.mosaic.seam_edits import (
    SeamArea,
    SeamEdit,
    SeamLine,
    apply_edit,
    changed_ground,
    photos_along,
    refused_ground_m2,
    with_edits,
)
from core.mosaic.seams import LEAST_TOLD_M2, Seam
from core.quality.check_plan import CheckPlace
from core.raster.holes import Hole
from core.scans.fiducials import HAND_SIGMA_PX
from sessions.decisions import Recorded, Remark
from sessions.remarks import standing_faults
from sessions.seam_decisions import standing_seams, withdrawn_seams
from ui.review.history import subject_of
from ui.review.judgement import footprint_polygons
from ui.review.looks import short
from ui.review.queue import passes, sort_keys, with_filter
from ui.review.sight import photos_over
from ui.review.snapshot import DeskSnapshot
from ui.review.state import Area, Key, Notice, QueueFilter, Seat, ShownMosaic, Sorting

Part = dict[str, Any]
MOST_PLACES = 2000
"""A line drawn by hand has no more corners."""
HOLES_TOLD = 60
"""Holes in the list; the largest come first."""
MISFITS_TOLD = 20
"""Places that are likely wrong in the list; the worst come first."""
NEAR_TOLD = 6
"""Measurements told about a place, the nearest ones."""
NEAR_TIES = 20
"""Ties told about a place together, the nearest ones."""
STRAIGHT_PX = 1.0
"""Seams are drawn to so many pixels of the mosaic."""


@dataclass(frozen=True, slots=True)
class MosaicPicked:
    """A place on the mosaic of which everything is asked: easting and northing, metres."""

    seat_id: str
    east: float
    north: float
    number: int
    """The page's own number of the question, so that it knows the answer again."""
    photo_id: str = ""
    """The photo that is asked about; that which the mosaic shows there when empty."""


@dataclass(frozen=True, slots=True)
class NearAsked:
    """The queue shall show the points of a photo, nearest to a place first."""

    seat_id: str
    photo_id: str
    east: float
    north: float


def place_of(message: Mapping[str, Any]) -> tuple[float, float]:
    """Easting and northing of a message.

    Raises:
        ValueError: They lie nowhere.
    """
    east, north = (float(value) for value in cast("list[Any]", message["place"]))
    if not (abs(east) < 1e9 and abs(north) < 1e9):
        raise ValueError("not a place")
    return east, north


def area_of(message: Mapping[str, Any]) -> Area:
    """Corners of an area in a message; none where it has none.

    Raises:
        ValueError: They are too few or too many, or lie nowhere.
    """
    places = cast("list[Any]", message.get("area") or [])
    area = tuple(place_of({"place": place}) for place in places)
    if area and not 3 <= len(area) <= MOST_PLACES:
        raise ValueError("not an area")
    return area


def picked_from_message(seat_id: str, message: Mapping[str, Any]) -> MosaicPicked:
    """A place on the mosaic."""
    photo_id = str(message.get("photo", ""))
    return MosaicPicked(seat_id, *place_of(message), int(message["number"]), photo_id)


def near_from_message(seat_id: str, message: Mapping[str, Any]) -> NearAsked:
    """A photo and a place."""
    return NearAsked(seat_id, str(message["photo"]), *place_of(message))


@dataclass(frozen=True, slots=True)
class SeamDrawn:
    """A line that a seam shall follow, or the outline of what one photo shall show, metres."""

    seat_id: str
    photo_id: str
    """The photo of an outline; empty for a line."""
    places: tuple[tuple[float, float], ...]
    replaces: int = 0
    """Number of the decision whose corners were moved; 0 for what is new."""


def seam_from_message(seat_id: str, message: Mapping[str, Any]) -> SeamDrawn:
    """A line or an outline on the mosaic.

    Raises:
        ValueError: It has too few corners or too many, or lies nowhere.
    """
    photo_id = str(message.get("photo", ""))
    places = tuple(place_of({"place": place}) for place in cast("list[Any]", message["places"]))
    if not (3 if photo_id else 2) <= len(places) <= MOST_PLACES:
        raise ValueError("not a line")
    return SeamDrawn(seat_id, photo_id, places, int(message.get("replaces", 0)))


def decided_seam(gesture: SeamDrawn, desk: DeskSnapshot) -> tuple[SeamEdit | None, Notice | None]:
    """The decision of what was drawn, and why it comes to nothing or to less than was drawn."""
    mosaic = desk.state.mosaic
    if mosaic is None:
        return None, Notice("notice.seam.none")
    if mosaic.outside:
        return None, Notice("notice.seam.outside", grave=True)
    seams, former = _before(gesture.replaces, mosaic, desk.recorded)
    number = 0 if former is None else gesture.replaces
    if gesture.photo_id:
        edit = SeamArea(gesture.photo_id, gesture.places, number)
    else:
        pair = photos_along(seams, gesture.places)
        if pair is None:
            return None, Notice("notice.seam.none")
        edit = SeamLine(*pair, gesture.places, number)
    if former is not None and replace(edit, replaces=former.replaces) == former:
        return None, None
    shown = mosaic.product.shown
    done = apply_edit(seams, edit, shown)
    if isinstance(done, Failure):
        return None, Notice("notice.not-done", {"why": done.reason}, grave=True)
    refused = refused_ground_m2(seams, edit, shown)
    if refused <= LEAST_TOLD_M2:
        return edit, None
    return edit, Notice("notice.seam.part", {"area": f"{refused:.0f}"})


def _before(
    number: int, mosaic: ShownMosaic, recorded: Sequence[Recorded]
) -> tuple[Sequence[Seam], SeamEdit | None]:
    """The seams over which an edit is laid, and what it replaces; as they stand for a new one."""
    laid = standing_seams(recorded)
    turn = next((at for at, (one, _) in enumerate(laid) if one.decision_id == number), None)
    if turn is None:
        return mosaic.seams, None
    edits = [edit for _, edit in laid[: turn + 1]]
    return with_edits(mosaic.drawn, edits[:turn], mosaic.product.shown), edits[turn]


def with_seam_edits(mosaic: ShownMosaic, edits: tuple[SeamEdit, ...]) -> ShownMosaic:
    """The mosaic with the seams that some edits make of those that were drawn."""
    if edits == mosaic.edits or mosaic.outside:
        return replace(mosaic, seams=mosaic.product.seams, edition=0, changed=None)
    seams = with_edits(mosaic.drawn, edits, mosaic.product.shown)
    changed = changed_ground(mosaic.product.seams, seams)
    if changed.is_empty:
        return replace(mosaic, seams=seams, edition=0, changed=None)
    edition = 1 + crc32(repr(edits).encode())
    return replace(mosaic, seams=seams, edition=edition, changed=changed.bounds)


def mosaic_part(desk: DeskSnapshot) -> Part:
    """Seams, borders of the photos and holes of the mosaic on disk, and what of it is stale."""
    shown = desk.state.mosaic
    if shown is None:
        return {"version": 0, "stale": []}
    product = shown.product
    gsd = product.grid.ground_sample_distance_m
    written = datetime.fromtimestamp(shown.version / 1000, UTC)
    borders = footprint_polygons(desk.state, desk.outlines)
    return {
        "version": shown.version,
        "written": written.isoformat(" ", "minutes")[:16],
        "pixel": gsd,
        "bounds": [round(value, 2) for value in product.grid.bounds],
        "area": round(product.covered_share * product.asked_m2),
        "stale": list(desk.stale),
        "gone": desk.mosaic_gone,
        "outside": shown.outside,
        "edition": shown.edition,
        "changed": None if shown.changed is None else [round(v, 2) for v in shown.changed],
        "edits": [
            {
                **_edit_line(item, edit),
                "turn": turn,
                "places": edit.outline if isinstance(edit, SeamArea) else edit.line,
            }
            for turn, (item, edit) in reversed([*enumerate(standing_seams(desk.recorded), 1)])
        ],
        "withdrawn": [
            {**_edit_line(item, edit), "by": by}
            for item, edit, by in reversed(withdrawn_seams(desk.recorded))
        ],
        "seams": [_seam(seam, gsd) for seam in shown.seams],
        "borders": {
            name: np.round(shapely.get_coordinates(polygon.exterior), 1).tolist()
            for name, polygon in borders.items()
        },
        "holes": [_hole(hole) for hole in product.holes[:HOLES_TOLD]],
        "hole_count": len(product.holes),
        "faults": faults_part(desk.recorded),
        "misfits": [
            {
                "place": [round(one.east, 1), round(one.north, 1)],
                "kind": one.kind,
                "photos": list(one.photo_ids),
                "shift": [short(value, 2) for value in one.shift_m],
                "length": short(one.length_m, 2),
                "sigma": short(one.sigma_m, 2),
                "predicted": short(float(np.hypot(*one.predicted_m)), 2),
                "significant": one.significant,
                "height": short(one.height_m, 0),
            }
            for one in shown.misfit[:MISFITS_TOLD]
        ],
    }


def _edit_line(item: Recorded, edit: SeamEdit) -> Part:
    """What is told of an edit of the seams, whether it stands or was withdrawn."""
    return {
        "id": item.decision_id,
        "who": item.who,
        "when": item.when[:16].replace("T", " "),
        "area": isinstance(edit, SeamArea),
        "what": subject_of(edit),
    }


def _hole(hole: Hole) -> list[object]:
    """Its middle and area, why nothing is shown, and the photos that the reason names."""
    place = (round(value, 1) for value in (hole.east, hole.north, hole.area_m2))
    return [*place, hole.why, list(hole.told_photos)]


def _seam(seam: Seam, gsd_m: float) -> Part:
    """One photo's part as rings, and where its name is written."""
    drawn = seam.area.simplify(STRAIGHT_PX * gsd_m)
    parts = [part for part in shapely.get_parts(drawn) if part.area > 0]
    largest = max(parts, key=lambda part: part.area, default=seam.area)
    middle = largest.centroid
    if not largest.contains(middle):
        middle = largest.representative_point()
    return {
        "photo": seam.photo_id,
        "date": seam.date,
        "label": [round(middle.x, 1), round(middle.y, 1)],
        "rings": [
            np.round(shapely.get_coordinates(ring), 1).tolist()
            for part in parts
            for ring in (part.exterior, *part.interiors)
        ],
    }


def faults_part(recorded: Sequence[Recorded]) -> list[Part]:
    """Faults of the mosaic with their answers, as its sheet shows them."""
    return [
        {
            "id": one.recorded.decision_id,
            "place": one.said.place,
            "photo": one.said.name,
            "kind": one.said.fault,
            "open": one.is_open,
            "assigned": one.assigned,
            "said": [_line(item, said) for item, said in ((one.recorded, one.said), *one.answers)],
        }
        for one in standing_faults(recorded)
    ]


def _line(item: Recorded, said: Remark) -> Part:
    return {
        "who": item.who,
        "when": item.when[:16].replace("T", " "),
        "words": said.words,
        "closes": said.closes,
    }


def picked_part(gesture: MosaicPicked, desk: DeskSnapshot) -> Part:
    """Which photo shows a place, how sharply and how surely; and which others could."""
    east, north = gesture.east, gesture.north
    height = float(desk.dem.heights(np.array([[east, north]]))[0])
    told: Part = {
        "number": gesture.number,
        "place": [round(east, 2), round(north, 2), short(height, 1)],
        "photo": None,
    }
    seam, block = seam_at(desk, east, north), desk.state.oriented
    shown = "" if seam is None else seam.photo_id
    if shown not in block.photos:
        return told
    level = block.photos[shown].ground_height_m
    position = np.array([east, north, height if np.isfinite(height) else level])
    others = photos_over(position, block, desk.dem)
    asked = gesture.photo_id in {one.photo_id for one in others}
    name = gesture.photo_id if asked else shown
    photo = block.photos[name]
    pixel_from_plane = pixels_by_plan(photo, block.camera_of(name), position[None])[0]
    sigma = ground_sigma_m(desk, name, position)
    near = nearest_keys(desk, name, east, north)
    # What is not used holds nothing: it comes behind.
    used = [one for one in near if desk.rows[one[1]].state in USED]
    holding = [*used, *(one for one in near if one not in used)]
    return {
        **told,
        "photo": name,
        "shown": shown,
        "date": _date_of(desk, name),
        "stale": name in desk.stale,
        "pixel": short(float(abs(np.linalg.det(pixel_from_plane))) ** -0.5, 3),
        "sigma": None if sigma is None else [short(value, 2) for value in sigma],
        "others": [
            [one.photo_id, round(one.nadir_deg, 1), round(one.pixel_m, 3)] for one in others
        ],
        "points": len(near),
        "nearest": short(used[0][0], 0) if used else None,
        "control": [_control_near(desk, away, key) for away, key in holding[:NEAR_TOLD]],
        "ties": _ties_near(desk, name, position),
    }


def _date_of(desk: DeskSnapshot, photo_id: str) -> str:
    """When a photo of the mosaic was taken; empty where that is not known."""
    seams = () if desk.state.mosaic is None else desk.state.mosaic.seams
    return next((seam.date for seam in seams if seam.photo_id == photo_id), "")


def _control_near(desk: DeskSnapshot, away_m: float, key: Key) -> Part:
    """A measurement that holds a photo, or does not, near a place."""
    report, row = desk.state.report, desk.rows[key]
    residual = report.residuals_px.get(key)
    return {
        "point": key[0],
        "away": short(away_m, 0),
        "residual": None if residual is None else short(float(np.hypot(*residual)), 1),
        "state": row.state,
    }


def _ties_near(desk: DeskSnapshot, photo_id: str, position: Position) -> Part | None:
    """What the nearest ties of a photo in use say: how many, how far, RMS and largest residual."""
    report = desk.state.report
    ties = report.block.ties
    if photo_id not in ties.photo_ids:
        return None
    lengths = np.hypot(*report.tie_residuals_px.T)
    own = (ties.photo == ties.photo_ids.index(photo_id)) & np.isfinite(lengths)
    away = np.hypot(*(report.tie_positions[ties.point[own], :2] - position[:2]).T)
    near = np.argsort(away, kind="stable")[:NEAR_TIES]
    if not len(near):
        return None
    residuals = lengths[own][near]
    return {
        "count": len(near),
        "away": short(float(away[near].max()), 0),
        "rms": short(float(np.sqrt(np.mean(residuals**2))), 2),
        "largest": short(float(residuals.max()), 2),
    }


def seam_at(desk: DeskSnapshot, east: float, north: float) -> Seam | None:
    """The part of the mosaic that holds a place; None beside all of them, and without a mosaic."""
    place = shapely.Point(east, north)
    seams = () if desk.state.mosaic is None else desk.state.mosaic.seams
    return next((seam for seam in seams if seam.area.covers(place)), None)


def ground_sigma_m(
    desk: DeskSnapshot, photo_id: str, position: Position
) -> tuple[float, float] | None:
    """Predicted standard deviations of a place in the ortho of a photo, east and north, metres.

    That of the photo's orientation, and what an error of the heights of the ground displaces. None
    for a photo that took no part in the adjustment, of which nothing is known.
    """
    state = desk.state
    block, covariances = state.oriented, state.evidence.covariances
    if photo_id not in covariances:
        return None
    photo, camera = block.photos[photo_id], block.camera_of(photo_id)
    if shown_in(photo, camera, position[None])[1][0] <= 0:
        return None
    errors = plan_errors(
        photo,
        camera,
        position[None],
        max(state.report.unit, LEAST_UNIT) ** 2 * covariances[photo_id],
        np.array([0.0, 0.0, desk.height_sigma_m]),
    )
    east, north = np.linalg.norm(np.concatenate(errors, axis=2)[0], axis=1).tolist()
    return east, north


def expected_sigma_m(place: CheckPlace, desk: DeskSnapshot, pixel_m: float) -> list[float] | None:
    """Standard deviations (east, north) that a reading may be expected to have, metres.

    Those of the photo that the mosaic shows there, of heights, of the reference and of the hand.
    None where nothing is known of the photo.
    """
    seam = seam_at(desk, place.east, place.north)
    if seam is None or seam.photo_id not in desk.state.oriented.photos:
        return None
    height = float(desk.dem.heights(np.array([[place.east, place.north]]))[0])
    level = desk.state.oriented.photos[seam.photo_id].ground_height_m
    position = np.array([place.east, place.north, height if np.isfinite(height) else level])
    shown = ground_sigma_m(desk, seam.photo_id, position)
    if shown is None:
        return None
    own = place.sigma_m or desk.ortho_sigma_m
    return [float(np.linalg.norm([one, own, HAND_SIGMA_PX * pixel_m])) for one in shown]


def nearest_keys(
    desk: DeskSnapshot, photo_id: str, east: float, north: float
) -> list[tuple[float, Key]]:
    """Rows of a photo with their distance from a place, metres, nearest first."""
    found: list[tuple[float, Key]] = []
    for key, row in desk.rows.items():
        point = desk.state.point_of(key[0])
        if point is not None and passes(row, QueueFilter("all", photo_id)):
            away = np.hypot(point.position[0] - east, point.position[1] - north)
            found.append((float(away), key))
    return sorted(found)


def near_place(gesture: NearAsked, seat: Seat, desk: DeskSnapshot) -> Seat:
    """The seat with the queue at a photo's points, the nearest to a place first and current."""
    near = nearest_keys(desk, gesture.photo_id, gesture.east, gesture.north)
    if not near:
        return seat
    seat = with_filter(seat, desk.rows, QueueFilter("all", gesture.photo_id))
    sorting = Sorting("distance", descending=False, place=(gesture.east, gesture.north))
    order = sort_keys(desk.rows.values(), sorting)
    return replace(seat, sorting=sorting, order=order, current=near[0][1])
