"""Height of the sun by date, time and place, and whether it is enough."""

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest

from core.quality.job_rules import USUAL_RULES
from core.quality.rules import DOUBTFUL, SOUND
from core.quality.sun import _equatorial, sun_findings, sun_height_deg
from tests.flights import FlightPlan, fly

BRNO = 16.6, 49.2
PLAN = FlightPlan(ties=60, control=6, check=0, camera_errors=False)


def test_the_sun_stands_where_the_example_of_meeus_has_it__paper() -> None:
    """Astronomical Algorithms, 2nd edition, example 25.a: 1992 October 13 at 0 h."""
    declination, right_ascension = _equatorial(datetime(1992, 10, 13, tzinfo=UTC))
    assert np.degrees(declination) == pytest.approx(-7.78507, abs=0.01)
    assert np.degrees(right_ascension) % 360 == pytest.approx(198.38083, abs=0.01)


def test_its_height_is_that_of_the_worked_example_of_spa__paper() -> None:
    """Reda and Andreas (NREL/TP-560-34302, 2008), table A5.1: without refraction 39.872 degrees."""
    height = sun_height_deg("2003-10-17T12:30:30-07:00", -105.1786, 39.742476)
    assert height == pytest.approx(39.872, abs=0.02)


@pytest.mark.parametrize(("day", "tilt"), [("1938-06-22", 23.44), ("1938-12-22", -23.44)])
def test_at_noon_of_a_solstice_latitude_and_tilt_of_the_earth_tell_it__law(
    day: str, tilt: float
) -> None:
    assert sun_height_deg(day, *BRNO) == pytest.approx(90 - BRNO[1] + tilt, abs=0.02)
    # South of the equator the seasons change places, and the sun stands in the north.
    assert sun_height_deg(day, 16.6, -BRNO[1]) == pytest.approx(90 - BRNO[1] - tilt, abs=0.02)


def test_noon_is_the_highest_of_a_day_and_a_month_as_high_as_its_best_day__law() -> None:
    hours = [f"1938-09-03T{hour:02d}:{minute:02d}:00+01:00" for hour in range(24)
             for minute in range(0, 60, 10)]  # fmt: skip
    heights = [sun_height_deg(moment, *BRNO) for moment in hours]
    assert max(heights) == pytest.approx(sun_height_deg("1938-09-03", *BRNO), abs=0.05)
    assert min(heights) < 0
    days = [sun_height_deg(f"1938-09-{day:02d}", *BRNO) for day in range(1, 31)]
    assert sun_height_deg("1938-09", *BRNO) == max(days)
    assert sun_height_deg("1938", *BRNO) == pytest.approx(sun_height_deg("1938-06", *BRNO))


def test_a_low_sun_is_doubted_and_a_noon_below_the_limit_too__truth() -> None:
    block = fly(PLAN, np.random.default_rng(4)).block
    names = list(block.photos)

    def kinds(exposed: str, limit: float = 30.0) -> list[tuple[str, int]]:
        rules = replace(USUAL_RULES, sun_deg=limit)
        found = sun_findings(block, dict.fromkeys(names, exposed), rules)
        return [(one.kind, one.grave) for one in found]

    assert kinds("1938-06-21") == kinds("1938") == [("sun-noon", SOUND)]
    assert kinds("1938-12-21") == [("sun-low", DOUBTFUL)]
    assert kinds("1938-12-21", limit=10.0) == [("sun-noon", SOUND)]
    assert kinds("1938-06-21T12:00:00+01:00") == [("sun", SOUND)]
    assert kinds("1938-06-21T05:00:00+01:00") == [("sun-low", DOUBTFUL)]
    assert kinds("") == []
    assert sun_findings(block, {}) == ()
