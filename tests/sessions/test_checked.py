"""Readings of a mosaic beside what the adjustment lets expect of them."""

from dataclasses import replace

import numpy as np
import shapely

from core.adjustment.influence import influence_of
from core.mosaic.seams import Seam
from core.progress import SILENT
from core.quality.check_plan import CheckPlace
from core.quality.rules import relative_sigma_m
from sessions.checked import Predicted, checked_by_hand
from sessions.checks import new_plan
from sessions.decisions import Decision, ReadCheck, Recorded
from tests.sessions.test_checks import REPORT


def test_readings_are_judged_against_what_the_equations_let_expect__law() -> None:
    """Thirty readings as large as predicted, and four times as large."""
    influence = influence_of(REPORT, REPORT.options, SILENT)
    assert influence is not None
    relative_m = relative_sigma_m(REPORT, influence)
    name, photo = next(iter(REPORT.block.photos.items()))
    middle = photo.exterior.centre[:2]
    seams = (Seam(name, "1938", shapely.Point(middle).buffer(500.0)),)
    predicted = Predicted(relative_m, 0.0, influence, seams)
    rng = np.random.default_rng(4)
    spread = rng.uniform(-200, 200, (30, 2)) + middle
    places = [CheckPlace(f"{n:02d}", *place) for n, place in enumerate(spread.tolist())]
    plan = new_plan(places, (6, 5), 1, "", beforehand=True, decisions=())
    errors = rng.normal(0, relative_m / 2**0.5, (30, 2))

    def judged(times: float, by: Predicted) -> set[str]:
        said: list[Decision] = [plan]
        for place, error in zip(plan.places, times * errors, strict=True):
            east, north = place.east, place.north
            seen = (east + float(error[0]), north + float(error[1]))
            said.append(ReadCheck(place.place_id, seen, (east, north), "m1"))
        recorded = [Recorded(n, "2026-11-27T10:00:00", "ada", one) for n, one in enumerate(said, 1)]
        found = checked_by_hand(REPORT, recorded, "m1", by)
        assert found is not None
        assert found.figures.read == 30
        return {one.kind for one in found.findings}

    assert "read-as-predicted" in judged(1.0, predicted)
    assert "read-worse" in judged(4.0, predicted)
    unknown = replace(predicted, relative_m=float("nan"), influence=None)
    assert not {"read-as-predicted", "read-worse", "read-better"} & judged(4.0, unknown)
    assert checked_by_hand(REPORT, [], "m1", predicted) is None
