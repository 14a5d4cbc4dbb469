"""Whatever is handed in ends in a named error or a sensible result; the long run is `fuzz.py`."""

from pathlib import Path

import pytest

from tests.journeys.fuzz import NAMED, run_cases
from tests.journeys.fuzz_targets import all_targets

SEED, CASES = 0, 120
SLOW = ("run",)
"""Targets for the long run alone."""


@pytest.mark.slow
def test_spoilt_inputs_are_named_and_leave_nothing_behind__law(
    tiny_block: Path, tmp_path: Path
) -> None:
    targets = [one for one in all_targets(tmp_path / "samples", tiny_block) if one.name not in SLOW]
    cases = list(run_cases(targets, tmp_path, SEED, range(CASES)))
    assert not [str(case) for case in cases if case.wrong]
    assert sum(case.outcome == NAMED for case in cases) > CASES / 3, "spoilt too little"
