"""What counts as found of a planted fault."""

import pytest

from tests.benchmarks.prove_faults import Found, Planted, is_near, leads, tell

FAULT = Planted(("seam",), frozenset(["a", "b"]), (1000.0, 2000.0), 150.0)
PHOTO = Planted(("reference", "seam"), frozenset(["b"]))


def place(kind="seam", photos=("a", "b"), at=(1050.0, 2050.0)):
    return {"kind": kind, "photos": list(photos), "place": list(at)}


@pytest.mark.parametrize(
    ("one", "near", "leading"),
    [
        (place(), True, True),
        (place(kind="reference"), True, False),
        (place(at=(1200.0, 2000.0)), False, True),
        (place(photos=("c", "d")), False, False),
        (place(photos=("c", "b")), True, False),
    ],
)
def test_a_place_counts_by_distance_photos_and_kind__law(one, near, leading):
    assert (is_near(one, FAULT), leads(one, FAULT)) == (near, leading)


def test_a_place_of_two_photos_leads_to_the_one_it_opens__law():
    assert leads(place(photos=("b", "a")), PHOTO)
    assert not leads(place(photos=("a", "b")), PHOTO)


def test_what_is_not_told_of_by_the_click_does_not_count__law(capsys):
    every = [Found(1, True, 1, ()), Found(3, False, 2, ()), Found(0, False, 4, ())]
    tell({"fault": every}, [0, 2])
    lines = capsys.readouterr().out.splitlines()
    assert lines[2] == "| fault | 3 | 1 | 1, 3, – | 1 |"
    assert lines[3] == "| none: places called off | 0 | 2 in 2 blocks | | |"
