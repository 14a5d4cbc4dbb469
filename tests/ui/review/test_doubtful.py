"""What is doubtful beside control is found, said why, and judged by the same keys."""

from dataclasses import replace

import numpy as np
import pytest

from core.block import TiePoints
from core.doubts import Doubt
from sessions.decisions import JudgeFiducial, JudgePhoto, JudgeTie, Recorded
from tests.ui.desk_block import adjust, tiny_block, tiny_snapshot
from ui.review.doubtful import extra_of, key_of_verdict, verdict_on, worst_ties
from ui.review.rows import queue_figures, queue_row
from ui.review.state import DeskState


def said(*decisions) -> tuple[Recorded, ...]:
    return tuple(
        Recorded(number, "2026-01-01T00:00:00", "anna", decision)
        for number, decision in enumerate(decisions, start=1)
    )


@pytest.fixture(scope="module")
def bent() -> tuple[DeskState, int]:
    """The block with one ray of one tie point forty pixels off; and that tie point."""
    ties = tiny_block().block.ties
    counts = np.bincount(ties.point)
    number = int(np.flatnonzero(counts >= 4)[0])
    pixels = ties.pixels.copy()
    pixels[np.flatnonzero(ties.point == number)[0]] += 40
    block = replace(tiny_block().block, ties=replace(ties, pixels=pixels))
    return replace(tiny_snapshot().state, block=block, report=adjust(block)), number


def test_the_tie_point_that_was_spoilt_is_the_worst__truth(bent):
    state, number = bent
    assert next(iter(worst_ties(state))) == number
    extra = extra_of(state, state.block, (), (), tiny_block().land.dem)
    keys = [key for key in extra.measurements if key[0] == f"tie {number}"]
    assert len(keys) == np.count_nonzero(state.block.ties.point == number)
    for key in keys:
        assert extra.kinds[key[0]] == "tie"
        assert extra.reasons[key].text == "doubt.tie"
        assert extra.reasons[key].value > 10


def test_the_queue_says_why_a_tie_point_is_doubtful__law(bent):
    state, number = bent
    extra = extra_of(state, state.block, (), (), tiny_block().land.dem)
    key = next(key for key in extra.measurements if key[0] == f"tie {number}")
    state = replace(state, extra=extra)
    row = queue_row(state, queue_figures(state), key)
    assert [ground.text for ground in row.grounds] == ["doubt.tie"]
    assert row.role == "tie"


def test_a_verdict_finds_its_row_again__law(bent):
    state, number = bent
    key = next(
        key
        for key in extra_of(state, state.block, (), (), tiny_block().land.dem).measurements
        if key[0] == f"tie {number}"
    )
    extra = extra_of(state, state.block, (), (), tiny_block().land.dem)
    verdict = verdict_on(extra, key, use=False)
    assert isinstance(verdict, JudgeTie)
    assert key_of_verdict(extra, verdict) == key
    again = extra_of(state, state.block, said(verdict), (), tiny_block().land.dem)
    assert again.measurements[key].status == "rejected"
    assert verdict_on(extra, ("none", "none"), use=True) is None


def test_photos_are_doubtful_by_a_remark_or_by_few_rays__truth():
    snapshot = tiny_snapshot()
    state, base, dem = snapshot.state, snapshot.base, snapshot.dem
    first, second = list(base.photos)[:2]
    doubt = Doubt("orientation", first, "It lies on its neighbour.", 0.5)
    ties = state.block.ties
    kept = (ties.photo != ties.photo_ids.index(second)) | (np.arange(len(ties.photo)) % 100 == 0)
    few = TiePoints(
        ties.photo_ids, ties.point[kept], ties.photo[kept], ties.pixels[kept], ties.sigma_px[kept]
    )
    state = replace(state, block=replace(state.block, ties=few))
    extra = extra_of(state, base, (), (doubt,), dem)
    photos = {key[1]: key for key in extra.measurements if extra.kinds[key[0]] == "photo"}
    assert set(photos) == {first, second}
    assert extra.measurements[photos[first]].reason == "It lies on its neighbour."
    assert photos[first] not in extra.reasons
    assert extra.reasons[photos[second]].text == "doubt.rays"
    verdict = verdict_on(extra, photos[first], use=True)
    assert verdict == JudgePhoto(first, use=True)
    assert key_of_verdict(extra, verdict) == photos[first]


def test_a_fiducial_far_from_its_certificate_is_doubtful__truth():
    snapshot = tiny_snapshot()
    name, photo = next(iter(snapshot.base.photos.items()))
    pixels = np.array([[100.0, 100.0], [1100.0, 100.0], [1100.0, 1100.0], [100.0, 1100.0]])
    residuals = np.array([[2.0, 0.0], [0.0, -2.0], [55.0, 0.0], [0.0, 2.0]])
    interior = replace(
        photo.interior, model="affine", names=("1", "2", "3", "4"), pixels=pixels,
        residuals_um=residuals, sigma_um=10.0,
    )  # fmt: skip
    base = snapshot.base.with_photos(
        {**snapshot.base.photos, name: replace(photo, interior=interior)}
    )
    state = replace(snapshot.state, block=base)
    extra = extra_of(state, base, (), (), snapshot.dem)
    marks = [key for key in extra.measurements if extra.kinds[key[0]] == "fiducial"]
    assert marks == [("fiducial 3", name)]
    assert extra.reasons[marks[0]].text == "doubt.fiducial"
    assert extra.reasons[marks[0]].value == pytest.approx(55.0)
    verdict = verdict_on(extra, marks[0], use=False)
    assert verdict == JudgeFiducial(name, "3", use=False)
    assert key_of_verdict(extra, verdict) == marks[0]
