"""What counts as found of a planted fault."""

import pytest

from tests.benchmarks.prove_faults import Found, Planted, clicks_to, is_near, tell

FAULT = Planted(("seam",), frozenset(["a", "b"]), (1000.0, 2000.0), 150.0)


def place(kind="seam", photos=("a", "b"), at=(1050.0, 2050.0)):
    return {"kind": kind, "photos": list(photos), "place": list(at)}


@pytest.mark.parametrize(
    ("one", "near", "clicks"),
    [
        (place(), True, 1),
        (place(kind="reference"), True, 0),
        (place(at=(1200.0, 2000.0)), False, 1),
        (place(photos=("c", "d")), False, 0),
        (place(photos=("c", "b")), True, 2),
    ],
)
def test_a_place_counts_by_distance_photos_and_kind__law(one, near, clicks):
    assert (is_near(one, FAULT), clicks_to(one, FAULT)) == (near, clicks)


def test_what_is_not_told_of_by_the_click_does_not_count__law(capsys):
    every = [Found(1, 2, 1, ()), Found(3, 0, 2, ()), Found(0, 0, 4, ())]
    tell({"fault": every}, [0, 2])
    lines = capsys.readouterr().out.splitlines()
    assert lines[2] == "| fault | 3 | 1 | 1 | 1, 3, – | 1 |"
    assert lines[3] == "| none: places called off | 0 | 2 in 2 blocks | | | |"
