"""What is found of the block on the desk."""

from dataclasses import replace

import numpy as np

from tests.ui.desk_block import outlines, tiny_snapshot
from ui.review.judgement import judge_desk


def test_a_block_is_judged_by_its_outlines_on_the_terrain__truth():
    desk = tiny_snapshot()
    desk = replace(desk, outlines=outlines(desk.state))
    assert judge_desk(desk).measured.overlaps
    unknown = replace(desk, outlines=np.full_like(desk.outlines, np.nan))
    assert judge_desk(unknown).measured.overlaps == ()


def test_the_gravest_finding_comes_first__law():
    grave = [finding.grave for finding in judge_desk(tiny_snapshot()).findings]
    assert grave == sorted(grave, reverse=True)
    assert grave[0] == 2
