"""The classical methods beside the bundle."""

from dataclasses import replace

import numpy as np
import pytest

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block
from core.block import TiePoints
from core.doubts import Failure
from core.literature.independent_models import (
    Sights,
    Triangulated,
    form_models,
    triangulate_models,
)
from core.literature.methods import compare_methods, triangulate_strips
from tests.core.literature.test_independent_models import PLAN
from tests.flights import fly

OPTIONS = AdjustmentOptions(estimate_cameras=False)


@pytest.mark.slow
def test_methods_stand_behind_the_bundle_as_the_books_say__paper():
    """Bundle before models before strips in the mean; none far behind where control is dense."""
    rms = {"strips": [], "models": [], "bundle": []}
    for seed in range(8):
        flight = fly(PLAN, np.random.default_rng(seed))
        for result in compare_methods(adjust_block(flight.block, OPTIONS)):
            assert result.reason == ""
            rms[result.method].append(np.sum(result.check_m**2))
    strips, models, bundle = (np.sqrt(np.mean(rms[name])) for name in rms)
    assert bundle < models < strips < 4 * bundle


def test_what_cannot_be_done_is_said__law():
    flight = fly(replace(PLAN, strips=1, photos_per_strip=3), np.random.default_rng(3))
    report = adjust_block(flight.block, OPTIONS)
    block = report.block
    alone = replace(report, block=replace(block, ties=TiePoints.none(), measurements={}))
    assert [bool(result.reason) for result in compare_methods(alone)] == [True, True, False]
    few = dict(list(block.surveyed.items())[:2])
    kept = {key: m for key, m in block.measurements.items() if key[0] in few}
    loose = replace(block, surveyed=few, measurements=kept)
    models = form_models(loose, np.random.default_rng(0))
    assert isinstance(triangulate_strips(loose, models, Sights.of(loose)), Failure)
    assert isinstance(triangulate_models(loose, models, Sights.of(loose)), Triangulated)
