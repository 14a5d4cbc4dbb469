"""The mosaic's sheet, what a place on it leads to, and how surely it lies where it is shown."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from core.adjustment.influence import influence_of
from core.control.prediction import covariances_of
from core.geometry.collinearity import rotations_from_increments
from core.geometry.exterior import ExteriorOrientation, angles_from_rotation
from core.mosaic.composition import MosaicProduct
from core.mosaic.fault_places import FaultPlace, Kind
from core.mosaic.seam_edits import SeamArea, SeamLine
from core.mosaic.seams import Seam
from core.quality.check_plan import CheckPlace
from core.raster.grid import Grid
from core.raster.holes import Hole
from sessions.decisions import Recorded, Withdraw
from tests.ui.desk_block import OPTIONS, outlines, tiny_snapshot
from ui.review.checking import seat_checks
from ui.review.gestures import LOOKING, gesture_from_message
from ui.review.history import asked_back
from ui.review.judgement import judge_desk
from ui.review.mosaic import (
    MosaicPicked,
    NearAsked,
    SeamDrawn,
    expected_sigma_m,
    ground_sigma_m,
    mosaic_part,
    near_place,
    nearest_keys,
    picked_part,
    with_seam_edits,
)
from ui.review.outcome import Outcome, outcome_of
from ui.review.queue import visible
from ui.review.snapshot import DeskSnapshot
from ui.review.state import Evidence, Notice, Seat, ShownMosaic

EAST, WEST = "1938_01_016", "1938_01_014"


@pytest.fixture(scope="module")
def desk() -> DeskSnapshot:
    """The tiny block with a mosaic of two photos that meet half-way."""
    known = tiny_snapshot()
    centres = [known.state.oriented.photos[name].exterior.centre for name in (WEST, EAST)]
    middle = float(np.mean([centre[0] for centre in centres]))
    west, east = middle - 600, middle + 600
    south, north = (float(centres[0][1]) + side for side in (-500, 300))
    seams = (
        Seam(WEST, "1938-07-02", shapely.box(west, south, middle, north)),
        Seam(EAST, "", shapely.box(middle, south, east, north)),
    )
    grid = Grid(west, north, 1.0, int(east - west), int(north - south))
    holes = (Hole(900.0, west + 40.0, north - 30.0, masked_in=("west",)),)
    product = MosaicProduct(Path("mosaic.tif"), grid, seams, {}, 0.5, holes)
    influence = influence_of(known.state.report, OPTIONS)
    assert influence is not None
    evidence = Evidence(covariances=covariances_of(influence))
    mosaic = ShownMosaic(product, 1_700_000_000_000, seams, seams)
    state = replace(known.state, mosaic=mosaic, evidence=evidence)
    return replace(known, state=state, outlines=outlines(state))


def middle_of(desk: DeskSnapshot) -> tuple[float, float]:
    """A place well inside the part of the western photo."""
    assert desk.state.mosaic is not None
    return desk.state.mosaic.product.seams[0].area.centroid.coords[0]


def test_the_sheet_tells_seams_borders_holes_and_what_is_stale__truth(desk: DeskSnapshot) -> None:
    part = mosaic_part(replace(desk, stale=(EAST,)))
    assert part["version"] == 1_700_000_000_000
    assert part["written"] == "2023-11-14 22:13"
    assert part["stale"] == [EAST]
    assert [seam["photo"] for seam in part["seams"]] == [WEST, EAST]
    assert part["seams"][0]["label"] == pytest.approx(middle_of(desk), abs=0.1)
    assert set(part["borders"]) == set(desk.state.oriented.photos)
    assert part["holes"] == [[*part["holes"][0][:2], 900.0, "masked", ["west"]]]
    assert part["area"] == 0.5 * 1200 * 800


def test_without_a_mosaic_the_sheet_says_so__law() -> None:
    assert mosaic_part(tiny_snapshot()) == {"version": 0, "stale": []}


def test_a_mosaic_whose_file_is_gone_is_told__law(desk: DeskSnapshot) -> None:
    for version in ("one", ""):
        at = replace(desk, mosaic_version=version)
        told = "mosaic-gone" in {one.kind for one in judge_desk(at).findings}
        assert mosaic_part(at)["gone"] == seat_checks("ada", at)["gone"] == told == (not version)


def line_west_of_the_seam(desk: DeskSnapshot) -> list[list[float]]:
    """From the seam 60 m to the west, along it, and back."""
    assert desk.state.mosaic is not None
    west = desk.state.mosaic.seams[0].area
    _, south, seam, north = west.bounds
    level = (south + north) / 2
    return [
        [seam - away, level + along] for away, along in ((1, -90), (60, -60), (60, 60), (1, 90))
    ]


def test_a_line_becomes_a_decision_on_the_photos_it_runs_between__law(desk: DeskSnapshot) -> None:
    places = line_west_of_the_seam(desk)
    drawn = gesture_from_message("s", {"kind": "seam", "photo": "", "places": places})
    assert isinstance(drawn, SeamDrawn)
    assert not isinstance(drawn, LOOKING)
    outcome = outcome_of(drawn, Seat("s", "anna"), desk)
    (made,) = outcome.decisions
    assert made == SeamLine(WEST, EAST, tuple((x, y) for x, y in places))
    area = replace(drawn, photo_id=EAST)
    assert outcome_of(area, Seat("s", "anna"), desk).decisions == (SeamArea(EAST, drawn.places),)


def test_corners_of_a_line_are_moved_over_the_seams_before_it__law(desk: DeskSnapshot) -> None:
    mosaic, places = desk.state.mosaic, line_west_of_the_seam(desk)
    assert mosaic is not None
    seat, message = Seat("s", "anna"), {"kind": "seam", "photo": "", "places": places}

    def outcome(places: list[list[float]], now: DeskSnapshot) -> Outcome:
        drawn = gesture_from_message("s", {**message, "places": places, "replaces": 7})
        assert isinstance(drawn, SeamDrawn)
        return outcome_of(drawn, seat, now)

    (laid,) = outcome(places, desk).decisions
    assert isinstance(laid, SeamLine)
    assert laid.replaces == 0, "there is none of that number"
    state = replace(desk.state, mosaic=with_seam_edits(mosaic, (laid,)))
    now = replace(desk, state=state, recorded=(Recorded(7, "2026-01-01", "anna", laid),))
    assert mosaic_part(now)["edits"][0]["places"] == laid.line
    assert not outcome(places, now).decisions, "no corner was moved"
    nearer = [places[0], *([x + 30, y] for x, y in places[1:3]), places[3]]
    (moved,) = outcome(nearer, now).decisions
    assert isinstance(moved, SeamLine)
    assert (moved.first, moved.second, moved.replaces) == (WEST, EAST, 7)


def test_withdrawn_edits_are_told_beside_those_that_stand__law(desk: DeskSnapshot) -> None:
    line = SeamLine(WEST, EAST, ((1.0, 2.0), (3.0, 4.0)))
    moved = replace(line, line=((1.0, 2.0), (3.0, 5.0)), replaces=1)
    said = (line, SeamArea(EAST, (*line.line, (0.0, 9.0))), moved, Withdraw(3))
    recorded = tuple(Recorded(n, "2026-01-01", "anna", one) for n, one in enumerate(said, 1))

    def told(recorded: tuple[Recorded, ...]) -> tuple[list[list[int]], list[int]]:
        part = mosaic_part(replace(desk, recorded=recorded))
        standing = [[one["turn"], one["id"]] for one in part["edits"]]
        return standing, [one["id"] for one in part["withdrawn"]]

    # Before its corners were moved, the line was as it is again now.
    assert told(recorded[:3]) == ([[2, 2], [1, 3]], [])
    assert told(recorded) == ([[2, 2], [1, 1]], [3])
    again = asked_back(3, recorded, Seat("s", "berta"), again=True)[0]
    assert again == (Withdraw(4),)
    assert told((*recorded, Recorded(5, "2026-01-01", "berta", *again)))[1] == []


def test_seams_edited_outside_hold_alone__law(desk: DeskSnapshot) -> None:
    mosaic, places = desk.state.mosaic, line_west_of_the_seam(desk)
    assert mosaic is not None
    drawn = gesture_from_message("s", {"kind": "seam", "photo": "", "places": places})
    assert isinstance(drawn, SeamDrawn)
    outside = replace(mosaic, outside="waiting")
    now = replace(desk, state=replace(desk.state, mosaic=outside))
    assert not now.state.written
    assert mosaic_part(now)["outside"] == "waiting"
    refused = outcome_of(drawn, Seat("s", "anna"), now)
    assert not refused.decisions
    assert refused.notice == Notice("notice.seam.outside", grave=True)
    (edit,) = outcome_of(drawn, Seat("s", "anna"), desk).decisions
    assert isinstance(edit, SeamLine)
    assert with_seam_edits(outside, (edit,)).seams == mosaic.product.seams


def test_what_is_drawn_beside_the_mosaic_is_refused_with_a_reason__truth(
    desk: DeskSnapshot,
) -> None:
    beside = SeamDrawn("s", "", ((1.0, 2.0), (3.0, 4.0)))
    assert outcome_of(beside, Seat("s", "anna"), desk).notice == Notice("notice.seam.none")
    outline = SeamDrawn("s", EAST, ((1.0, 2.0), (3.0, 4.0), (0.0, 9.0)))
    outcome = outcome_of(outline, Seat("s", "anna"), desk)
    assert not outcome.decisions
    assert outcome.notice is not None
    assert outcome.notice.grave
    none = replace(desk, state=replace(desk.state, mosaic=None))
    assert outcome_of(beside, Seat("s", "anna"), none).notice == Notice("notice.seam.none")
    for places in ([[1, 2]], [[1, 2]] * 3000, "x"):
        message = {"kind": "seam", "photo": "", "places": places}
        assert gesture_from_message("s", message) is None


def test_a_photo_is_chosen_only_where_it_shows_the_ground__truth(desk: DeskSnapshot) -> None:
    mosaic = desk.state.mosaic
    assert mosaic is not None
    west, south, seam, north = mosaic.seams[0].area.bounds
    # The eastern photo shows 100 m beyond the seam.
    shown = {
        WEST: mosaic.seams[0].area,
        EAST: mosaic.seams[1].area.union(shapely.box(seam - 100, south, seam, north)),
    }
    product = replace(mosaic.product, shown=shown)
    state = replace(desk.state, mosaic=replace(mosaic, product=product))
    now, seat = replace(desk, state=state), Seat("s", "anna")

    def drawn(west: float, east: float) -> SeamDrawn:
        corners = ((west, south + 100), (east, south + 100), (east, south + 200))
        return SeamDrawn("s", EAST, (*corners, (west, south + 200)))

    refused = outcome_of(drawn(west + 50, west + 150), seat, now)
    assert not refused.decisions
    assert refused.notice is not None
    assert refused.notice.grave
    assert "shows nothing of that ground" in refused.notice.values["why"]
    half = outcome_of(drawn(seam - 200, seam), seat, now)
    assert half.decisions == (SeamArea(EAST, drawn(seam - 200, seam).places),)
    assert half.notice == Notice("notice.seam.part", {"area": "10000"})
    edited = with_seam_edits(replace(mosaic, product=product), half.decisions)
    assert edited.changed is not None
    assert edited.changed[0] == pytest.approx(seam - 100)
    whole = outcome_of(drawn(seam - 90, seam), seat, now)
    assert whole.notice is None
    assert whole.decisions


def test_edits_are_shown_until_the_file_follows_and_are_gone_when_withdrawn__law(
    desk: DeskSnapshot,
) -> None:
    mosaic = desk.state.mosaic
    assert mosaic is not None
    edit = SeamLine(WEST, EAST, tuple((x, y) for x, y in line_west_of_the_seam(desk)))
    edited = with_seam_edits(mosaic, (edit,))
    assert edited.edition > 0
    assert edited.changed is not None
    # What changes hands: the trapezium, 60 m wide at most, 180 m long.
    west, south, east, north = edited.changed
    assert (east - west, north - south) == pytest.approx((60, 180), abs=3)
    recorded = [Recorded(5, "2026-11-24T10:00:00.000", "ada", edit)]
    state = replace(desk.state, mosaic=edited)
    now = replace(desk, state=state, recorded=recorded)
    part = mosaic_part(now)
    (told,) = part["edits"]
    assert (told["id"], told["who"], told["what"]) == (5, "ada", f"{WEST} | {EAST}")
    assert (told["when"], told["area"]) == ("2026-11-24 10:00", False)
    assert not now.state.written
    # A place between the old seam and the new one has changed hands.
    assert picked_part(MosaicPicked("s", east - 20, (south + north) / 2, 1), now)["photo"] == EAST
    assert with_seam_edits(edited, ()).edition == 0
    assert with_seam_edits(edited, ()).seams == mosaic.product.seams
    # The next mosaic is made with the edit: nothing is pending then.
    made = replace(mosaic.product, seams=edited.seams)
    followed = replace(mosaic, product=made, seams=made.seams, edits=(edit,))
    assert with_seam_edits(followed, (edit,)).edition == 0
    assert with_seam_edits(followed, ()).edition > 0


def test_a_place_leads_to_the_photo_that_shows_it__truth(desk: DeskSnapshot) -> None:
    east, north = middle_of(desk)
    told = picked_part(MosaicPicked("s", east, north, 7), desk)
    photo = desk.state.oriented.photos[WEST]
    assert (told["number"], told["photo"], told["date"]) == (7, WEST, "1938-07-02")
    nadir = photo.ground_pixel_m(desk.state.oriented.camera_of(WEST))
    assert told["pixel"] == pytest.approx(nadir, rel=0.05)
    assert WEST in [name for name, _, _ in told["others"]]
    assert told["points"] == sum(key[1] == WEST for key in desk.rows)
    beside = picked_part(MosaicPicked("s", east - 5000, north, 8), desk)
    assert beside["photo"] is None


def test_the_sigma_of_a_place_is_what_the_covariances_scatter__oracle(desk: DeskSnapshot) -> None:
    """Photos drawn from the covariance of one photo, their rays met with the ground."""
    east, north = middle_of(desk)
    block = desk.state.oriented
    photo, camera = block.photos[WEST], block.camera_of(WEST)
    height = float(desk.dem.heights(np.array([[east, north]]))[0])
    position = np.array([east, north, height])
    told = ground_sigma_m(desk, WEST, position)
    assert told is not None
    pixel = photo.pixel_from_object(position[None], camera)
    rng = np.random.default_rng(3)
    covariance = desk.state.evidence.covariances[WEST][:6, :6]
    covariance = covariance * max(desk.state.report.sigma_nought, 1.0) ** 2
    places = []
    draws = rng.multivariate_normal(np.zeros(6), covariance, 4000)
    turns = photo.exterior.object_from_image @ rotations_from_increments(draws[:, 3:])
    for draw, turn in zip(draws, turns, strict=True):
        centre = photo.exterior.centre + draw[:3]
        exterior = ExteriorOrientation(centre, *angles_from_rotation(turn))
        moved = replace(photo, exterior=exterior)
        level = np.array([height + rng.normal(0, desk.height_sigma_m)])
        places.append(moved.object_from_pixel(pixel, level, camera)[0, :2])
    # Four thousand draws know a standard deviation to a ninetieth.
    assert np.std(places, axis=0) == pytest.approx(told, rel=0.05)


def test_of_a_photo_that_took_no_part_no_sigma_is_told__law(desk: DeskSnapshot) -> None:
    bare = replace(desk, state=replace(desk.state, evidence=Evidence()))
    assert picked_part(MosaicPicked("s", *middle_of(desk), 1), bare)["sigma"] is None


def test_the_queue_goes_to_the_photos_points_nearest_first__law(desk: DeskSnapshot) -> None:
    east, north = middle_of(desk)
    seat = near_place(NearAsked("s", WEST, east, north), Seat("s", "anna"), desk)
    shown = visible(desk.rows, seat)
    assert seat.current == shown[0]
    assert {key[1] for key in shown} == {WEST}
    places = [desk.state.block.surveyed[key[0]].position[:2] for key in shown]
    away = np.hypot(*(np.array(places) - (east, north)).T)
    assert np.all(np.diff(away) >= 0)
    assert nearest_keys(desk, WEST, east, north)[0] == (pytest.approx(away[0]), shown[0])
    assert near_place(NearAsked("s", "nobody", east, north), seat, desk) is seat


def test_asking_is_for_guests_too_and_answers_only_who_asked__law(desk: DeskSnapshot) -> None:
    asked = gesture_from_message("s", {"kind": "pick", "number": 3, "place": middle_of(desk)})
    assert isinstance(asked, LOOKING)
    outcome = outcome_of(asked, Seat("s", "anna"), desk)
    assert outcome.answer is not None
    assert outcome.answer[0] == "picked"
    assert outcome.answer[1]["photo"] == WEST
    near = gesture_from_message("s", {"kind": "near", "photo": WEST, "place": middle_of(desk)})
    assert isinstance(near, LOOKING)
    assert outcome_of(near, Seat("s", "anna"), desk).seat.filter.photo_id == WEST


@pytest.mark.parametrize("place", [[1e12, 0], [float("nan"), 0], ["x", 1], [1]])
def test_a_place_nowhere_is_no_gesture__truth(place: list[object]) -> None:
    for kind in ("pick", "near"):
        message = {"kind": kind, "number": 1, "photo": WEST, "place": place}
        assert gesture_from_message("s", message) is None


def test_places_that_are_likely_wrong_are_told_in_their_order__law(desk: DeskSnapshot) -> None:
    east, north = middle_of(desk)
    rows: tuple[tuple[Kind, tuple[str, ...], float], ...] = (
        ("seam", (WEST, EAST), 3.0), ("reference", (EAST,), 1.5), ("ties", (WEST,), 4.0),
    )  # fmt: skip
    places = tuple(
        FaultPlace(kind, east, north, photos, (length, 0.0), 0.3, (0.3, 0.4), length > 2)
        for kind, photos, length in rows
    )
    mosaic = desk.state.mosaic
    assert mosaic is not None
    shown = replace(desk, state=replace(desk.state, mosaic=replace(mosaic, misfit=places)))
    told = mosaic_part(shown)["misfits"]
    assert [one["significant"] for one in told] == [True, False, True]
    assert [one["photos"] for one in told] == [[WEST, EAST], [EAST], [WEST]]
    assert [one["kind"] for one in told] == ["seam", "reference", "ties"]
    assert [one["length"] for one in told] == [3.0, 1.5, 4.0]
    assert told[0]["predicted"] == 0.5


def test_a_place_may_be_asked_of_another_photo_that_shows_it__law(desk: DeskSnapshot) -> None:
    mosaic = desk.state.mosaic
    assert mosaic is not None
    east, south, _, north = mosaic.seams[1].area.bounds
    told = picked_part(MosaicPicked("s", east - 5, (south + north) / 2, 1, EAST), desk)
    assert (told["photo"], told["shown"]) == (EAST, WEST)
    strange = picked_part(MosaicPicked("s", east - 5, (south + north) / 2, 1, "strange"), desk)
    assert (strange["photo"], strange["shown"]) == (WEST, WEST)


def test_what_is_used_near_a_place_comes_before_what_is_not__law(desk: DeskSnapshot) -> None:
    east, north = middle_of(desk)
    _, nearest = nearest_keys(desk, WEST, east, north)[0]
    state = desk.state
    out = replace(state.block.measurements[nearest], status="rejected")
    state = replace(state, block=state.block.with_measurement(out))
    rejected = replace(desk, state=state, table=desk.table.renewed(state))
    told = picked_part(MosaicPicked("s", east, north, 1, WEST), rejected)
    assert nearest[0] not in {one["point"] for one in told["control"]}
    assert told["nearest"] == told["control"][0]["away"]


def test_a_reading_is_expected_within_photo_reference_and_hand__truth(desk: DeskSnapshot) -> None:
    east, north = middle_of(desk)
    place = CheckPlace("1-01", east, north)
    expected = expected_sigma_m(place, replace(desk, ortho_sigma_m=3.0), 0.5)
    assert expected is not None
    picked = picked_part(MosaicPicked("s", east, north, 1), desk)["sigma"]
    assert expected == pytest.approx(np.hypot(picked, np.hypot(3.0, 0.4 * 0.5)), abs=0.02)
    surveyed = expected_sigma_m(replace(place, sigma_m=9.0), desk, 0.5)
    assert surveyed is not None
    assert min(surveyed) > 9.0
    assert expected_sigma_m(replace(place, east=east + 1e5), desk, 0.5) is None


def test_a_place_leads_to_what_holds_its_photo__truth(desk: DeskSnapshot) -> None:
    """The nearest measurements with their residuals, and the ties about it."""
    east, north = middle_of(desk)
    told = picked_part(MosaicPicked("s", east, north, 1), desk)
    near = nearest_keys(desk, told["photo"], east, north)
    assert [one["point"] for one in told["control"]] == [key[0] for _, key in near[:6]]
    report = desk.state.report
    for one, (_, key) in zip(told["control"], near, strict=False):
        residual = report.residuals_px.get(key)
        expected = None if residual is None else pytest.approx(np.hypot(*residual), abs=0.06)
        assert one["residual"] == expected
    ties, number = report.block.ties, report.block.ties.photo_ids.index(told["photo"])
    in_use = (ties.photo == number) & np.isfinite(report.tie_residuals_px).all(axis=1)
    assert told["ties"]["count"] == min(20, int(in_use.sum()))
    assert told["ties"]["rms"] <= told["ties"]["largest"]
