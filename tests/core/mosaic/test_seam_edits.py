"""Edits of seams: a partition stays one, nothing is lost, and the seam runs where it was drawn."""

import numpy as np
import pytest
import shapely
import shapely.affinity
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry import LineString, Point, box

from core.doubts import Failure
from core.mosaic.seam_edits import (
    SeamArea,
    SeamLine,
    apply_edit,
    changed_ground,
    follow_line,
    give_area,
    photos_along,
    refused_ground_m2,
    with_edits,
)
from core.mosaic.seams import Seam

EAST, NORTH = -577000.0, -1193000.0
# Coordinates of a CRS of seven digits leave some nanometres of rounding along a kilometre of seam.
ROUNDING_M2 = 1e-3


def seam(name: str, *bounds: float) -> Seam:
    west, south, east, north = bounds
    return Seam(name, "", box(EAST + west, NORTH + south, EAST + east, NORTH + north))


def at(*places: tuple[float, float]) -> tuple[tuple[float, float], ...]:
    return tuple((EAST + x, NORTH + y) for x, y in places)


def four() -> tuple[Seam, ...]:
    """a | b over c | d, each 100 m a side."""
    return (
        seam("a", 0, 100, 100, 200), seam("b", 100, 100, 200, 200),
        seam("c", 0, 0, 100, 100), seam("d", 100, 0, 200, 100),
    )  # fmt: skip


def is_partition(before: tuple[Seam, ...], after: tuple[Seam, ...]) -> bool:
    whole = shapely.union_all([one.area for one in before])
    again = shapely.union_all([one.area for one in after])
    overlap = sum(one.area.area for one in after) - again.area
    lost = whole.symmetric_difference(again).area
    return overlap < ROUNDING_M2 and lost < ROUNDING_M2


def owner(seams: tuple[Seam, ...], x: float, y: float) -> str:
    place = Point(EAST + x, NORTH + y)
    return next(one.photo_id for one in seams if one.area.contains(place))


def test_what_a_line_gives_is_one_with_the_photo_on_a_slanted_seam__truth() -> None:
    """Picometres between them kept the old seam there, drawn twice, round an island."""
    corners = at((0, 0), (0, 300), (130, 300), (170, 0))
    left = Seam("a", "", shapely.Polygon(corners))
    right = Seam("b", "", shapely.Polygon((*corners[2:][::-1], *at((330, 300), (330, 0)))))
    for shift in range(20):
        line = at((150, 60 + shift), (110, 90), (115, 150), (140, 200 + shift))
        after = apply_edit((left, right), SeamLine("a", "b", line))
        assert not isinstance(after, Failure)
        assert [len(shapely.get_parts(one.area)) for one in after] == [1, 1], shift
        assert [len(shapely.get_rings(one.area)) for one in after] == [1, 1], shift
        assert is_partition((left, right), after)


def test_a_line_from_seam_to_seam_carries_the_seam_along__truth() -> None:
    after = follow_line(four(), "a", "b", at((99, 130), (80, 140), (80, 170), (99, 180)))
    assert not isinstance(after, Failure)
    assert is_partition(four(), after)
    assert owner(after, 90, 150) == "b"
    assert owner(after, 70, 150) == "a"
    # Elsewhere the seam is where it was.
    assert (owner(after, 95, 110), owner(after, 95, 190)) == ("a", "a")
    gained = changed_ground(four(), after)
    # The trapezium between line and seam.
    assert gained.area == pytest.approx(20 * (50 + 30) / 2, rel=0.03)


def test_a_line_across_both_photos_is_the_whole_seam__truth() -> None:
    line = at((60, 210), (60, 150), (130, 150), (130, 90))
    after = follow_line(four(), "a", "b", line)
    assert not isinstance(after, Failure)
    assert is_partition(four(), after)
    assert (owner(after, 80, 180), owner(after, 120, 120)) == ("b", "a")
    assert (owner(after, 30, 180), owner(after, 170, 120)) == ("a", "b")
    # Beside the two photos nothing has changed.
    assert (owner(after, 120, 95), owner(after, 95, 95)) == ("d", "c")


def test_most_of_a_photo_goes_to_the_other_where_the_line_says_so__truth() -> None:
    after = follow_line(four(), "a", "b", at((20, 210), (20, 90)))
    assert not isinstance(after, Failure)
    assert (owner(after, 30, 150), owner(after, 10, 150)) == ("b", "a")
    back = follow_line(after, "b", "a", at((100, 210), (100, 90)))
    assert not isinstance(back, Failure)
    assert changed_ground(four(), back).area < ROUNDING_M2


def test_both_directions_of_a_line_and_both_orders_of_photos_are_one_edit__law() -> None:
    line = at((99, 130), (80, 150), (101, 180))
    made = [
        follow_line(four(), *names, way)
        for names in (("a", "b"), ("b", "a"))
        for way in (line, line[::-1])
    ]
    for other in made[1:]:
        assert not isinstance(made[0], Failure)
        assert not isinstance(other, Failure)
        assert changed_ground(made[0], other).area < ROUNDING_M2


PLACE = st.tuples(st.floats(-30, 230), st.floats(-30, 230))


@given(st.lists(PLACE, min_size=2, max_size=7), st.sampled_from(["ab", "ac", "bd", "ad"]))
@settings(max_examples=150)
def test_whatever_is_drawn_seams_stay_a_partition__law(
    places: list[tuple[float, float]], names: str
) -> None:
    before = four()
    after = follow_line(before, names[0], names[1], at(*places))
    if isinstance(after, Failure):
        return
    assert is_partition(before, after)
    for one, other in zip(before, after, strict=True):
        assert one.photo_id == other.photo_id
        assert one.photo_id in names or one.area.equals(other.area)
    if len(places) > 2 and LineString(at(*places)).is_valid:
        given_area = give_area(after, names[0], at(*places))
        assert isinstance(given_area, Failure) or is_partition(before, given_area)


def test_a_polygon_is_shown_by_the_chosen_photo_and_nothing_beside_it_changes__truth() -> None:
    outline = at((80, 80), (120, 80), (120, 120), (80, 120))
    after = give_area(four(), "d", outline)
    assert not isinstance(after, Failure)
    assert is_partition(four(), after)
    assert {owner(after, x, y) for x in (85, 115) for y in (85, 115)} == {"d"}
    assert changed_ground(four(), after).area == pytest.approx(40 * 40 * 3 / 4)
    assert owner(after, 75, 115) == "a"


def test_a_polygon_reaches_no_further_than_the_mosaic__law() -> None:
    after = give_area(four(), "a", at((-50, 90), (250, 90), (250, 400), (-50, 400)))
    assert not isinstance(after, Failure)
    assert is_partition(four(), after)


# What each photo shows: a, c and d their own squares and 20 m about them, b all.
SHOWN = {one.photo_id: one.area.buffer(20, join_style="mitre") for one in four()} | {
    "b": shapely.union_all([one.area for one in four()])
}


def test_a_photo_is_given_only_ground_that_it_shows__truth() -> None:
    beyond = SeamArea("a", at((130, 120), (180, 120), (180, 180), (130, 180)))
    before = four()
    refused = apply_edit(before, beyond, SHOWN)
    assert isinstance(refused, Failure)
    assert "shows nothing" in refused.reason
    assert with_edits(before, [beyond], SHOWN) == before
    # 20 m of it are shown; the other 30 m stay with b and, below, with d.
    across = SeamArea("a", at((90, 60), (150, 60), (150, 160), (90, 160)))
    after = with_edits(four(), [across], SHOWN)
    assert is_partition(four(), after)
    assert owner(after, 110, 150) == owner(after, 95, 90) == owner(after, 110, 90) == "a"
    assert (owner(after, 130, 150), owner(after, 130, 90), owner(after, 95, 70)) == ("b", "d", "c")
    assert after[0].area.area == pytest.approx(100 * 100 + 20 * 60 + 30 * 20)
    # Below what a shows lie 30 x 20 m, beside it 30 x 100 m less that corner's share.
    assert refused_ground_m2(four(), across, SHOWN) == pytest.approx(60 * 20 + 30 * 80)
    assert refused_ground_m2(four(), SeamArea("b", across.outline), SHOWN) == 0.0


def test_a_line_moves_no_ground_to_a_photo_that_does_not_show_it__truth() -> None:
    line = SeamLine("a", "b", at((150, 210), (150, 90)))
    after = with_edits(four(), [line], SHOWN)
    assert is_partition(four(), after)
    assert (owner(after, 110, 150), owner(after, 130, 150)) == ("a", "b")


@pytest.mark.parametrize(
    ("edit", "why"),
    [
        (SeamLine("a", "d", at((50, 50), (150, 150))), "no seam"),
        (SeamLine("a", "a", at((50, 50), (150, 150))), "no seam"),
        (SeamLine("a", "x", at((50, 50), (150, 150))), "no seam"),
        (SeamLine("a", "b", at((20, 20), (30, 30))), "does not part"),
        (SeamArea("x", at((0, 0), (9, 0), (9, 9))), "no part"),
        (SeamArea("a", at((-90, 0), (-50, 0), (-50, 9))), "holds nothing"),
    ],
)
def test_what_cannot_be_done_is_told_and_changes_nothing__truth(
    edit: SeamLine | SeamArea, why: str
) -> None:
    before = four()
    done = apply_edit(before, edit)
    assert isinstance(done, Failure)
    assert why in done.reason
    assert with_edits(before, [edit]) == before


def test_edits_follow_one_another__law() -> None:
    edits = [
        SeamArea("b", at((60, 120), (100, 120), (100, 160), (60, 160))),
        SeamLine("a", "b", at((99, 165), (40, 140), (99, 115))),
    ]
    after = with_edits(four(), edits)
    assert is_partition(four(), after)
    assert owner(after, 55, 140) == "b"


def test_a_line_means_the_photos_that_it_runs_between__truth() -> None:
    assert photos_along(four(), at((95, 120), (85, 150), (105, 180))) == ("a", "b")
    assert photos_along(four(), at((60, 90), (90, 110), (60, 115))) == ("a", "c")
    assert photos_along(four(), at((500, 90), (590, 110))) is None


def test_a_line_on_one_side_of_the_seam_means_it_though_borders_are_rounded__law() -> None:
    """Borders that two parts have in common differ by what double precision leaves of them."""
    turned = tuple(
        Seam(one.photo_id, "", shapely.affinity.rotate(one.area, 0.7, (EAST, NORTH)))
        for one in four()
    )
    drawn = LineString(at((99, 120), (70, 150), (99, 180)))
    moved = shapely.affinity.rotate(drawn, 0.7, (EAST, NORTH))
    line = tuple((x, y) for x, y in moved.coords)
    assert photos_along(turned, line) == ("a", "b")
    assert not isinstance(follow_line(turned, "a", "b", line), Failure)


def test_a_multipolygon_is_cut_as_well__law() -> None:
    rng = np.random.default_rng(4)
    parts = give_area(four(), "b", at((20, 120), (40, 120), (40, 150), (20, 150)))
    assert not isinstance(parts, Failure)
    for _ in range(20):
        line = [tuple(place) for place in rng.uniform(0, 200, (5, 2)).tolist()]
        after = follow_line(parts, "a", "b", at(*line))
        assert isinstance(after, Failure) or is_partition(parts, after)


SHORT = st.tuples(st.floats(0, 3), st.floats(0, 2 * np.pi))
TURN = 17.0
STRAIGHT, SLANTED, RAGGED = "straight", "slanted", "ragged"


def side_by_side(kind: str) -> tuple[Seam, ...]:
    """a | b, 600 m a side: the seam straight, slanted, or in steps of a metre or two."""
    along = np.arange(-300.0, 301.0, 2.0)
    steps = np.repeat(np.arange(along.size - 1) * 7 % 3 - 1.0, 2)
    ragged = np.column_stack([steps, np.repeat(along, 2)[1:-1]])
    seam_line = ragged if kind == RAGGED else np.array([(0.0, -300.0), (0.0, 300.0)])
    west, east = [(-300.0, 300.0), (-300.0, -300.0)], [(300.0, 300.0), (300.0, -300.0)]
    pair = [shapely.Polygon([*seam_line.tolist(), *side]) for side in (west, east)]
    turned = [shapely.affinity.rotate(one, TURN if kind == SLANTED else 0, (0, 0)) for one in pair]
    placed = [shapely.affinity.translate(one, EAST, NORTH) for one in turned]
    return tuple(Seam(name, "", one) for name, one in zip("ab", placed, strict=True))


def turned_at(kind: str, *places: tuple[float, float]) -> tuple[tuple[float, float], ...]:
    drawn = LineString(places)
    turned = shapely.affinity.rotate(drawn, TURN, (0, 0)) if kind == SLANTED else drawn
    return at(*((x, y) for x, y in turned.coords))


@given(st.sampled_from([STRAIGHT, SLANTED, RAGGED]), SHORT, SHORT, st.booleans(), st.booleans())
@settings(max_examples=120, deadline=None)
def test_a_line_round_a_house_moves_what_it_holds_wherever_its_ends_lie__law(
    kind: str, first: tuple[float, float], last: tuple[float, float], west: bool, back: bool
) -> None:
    """An end over the seam, led back into the loop, once gave the rest of a photo away."""
    turn = -1 if west else 1
    ends = [
        (far * np.cos(way), y + far * np.sin(way)) for y, (far, way) in ((-15, first), (15, last))
    ]
    places = [ends[0], (turn * 30.0, -15.0), (turn * 30.0, 15.0), ends[1]]
    before = side_by_side(kind)
    after = follow_line(before, "a", "b", turned_at(kind, *(places[::-1] if back else places)))
    assert not isinstance(after, Failure)
    assert is_partition(before, after)
    moved = changed_ground(before, after).area
    # An end 3 m off swings its side of the square: a triangle of 3 m by at most 33 m, and one
    # beyond the seam. Steps of the seam, a metre to either side, add 30 m2.
    assert moved == pytest.approx(30 * 30, abs=2 * (50 + 4.5) + (30 if kind == RAGGED else 0))


@given(SHORT, SHORT, st.booleans())
@settings(max_examples=80, deadline=None)
def test_round_a_house_where_three_photos_meet_no_more_than_it_moves__law(
    first: tuple[float, float], last: tuple[float, float], back: bool
) -> None:
    three = (
        seam("a", -300, 0, 0, 300),
        seam("b", 0, 0, 300, 300),
        seam("c", -300, -300, 300, 0),
    )
    ends = [
        (far * np.cos(way), y + far * np.sin(way)) for y, (far, way) in ((31, first), (1, last))
    ]
    places = [ends[0], (30.0, 31.0), (30.0, 1.0), ends[1]]
    after = follow_line(three, "a", "b", at(*(places[::-1] if back else places)))
    assert not isinstance(after, Failure)
    assert is_partition(three, after)
    moved = changed_ground(three, after).area
    assert moved == pytest.approx(30 * 30, abs=2 * (50 + 4.5))


def test_a_whole_lobe_beyond_the_seam_is_kept_though_its_end_is_far_from_it__truth() -> None:
    """Only an end that would turn the edit inside out is cut."""
    after = follow_line(
        four(), "a", "b", at((99, 110), (80, 110), (80, 140), (120, 140), (120, 170))
    )
    assert not isinstance(after, Failure)
    assert (owner(after, 90, 125), owner(after, 110, 155)) == ("b", "a")
    assert changed_ground(four(), after).area == pytest.approx(2 * 20 * 30, rel=0.01)
