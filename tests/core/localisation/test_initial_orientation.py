"""Which photos stand at first: on the reference by themselves, or carried by tie points."""

from dataclasses import replace

import numpy as np
import pytest

from core.adjustment.adjusted import AdjustmentOptions
from core.block import Block, Peak, TiePoints
from core.doubts import Failure
from core.errors import OrientationError
from core.geometry.resection import moved
from core.localisation.initial_orientation import (
    MIN_TIES,
    Site,
    WeakControl,
    carried_by_ties,
    join_photos,
    stand_up,
    weak_control,
)
from core.localisation.photo_orientation import OrientedPhoto
from core.matching.local_search import Found
from core.reference.stage import ReferencePoints
from core.synthetic.truth import judge_orientations
from tests.tiny import ground_over, true_ties

NONE = ReferencePoints((), np.zeros((0, 3)), np.zeros((0, 3)))
FALLEN = Failure("3 of 40 points agree, which chance alone could bring about")


@pytest.fixture(scope="module")
def site(tiny) -> Site:
    return Site(tiny.reference, tiny.scans, NONE, {})


@pytest.fixture(scope="module")
def tied(tiny) -> Block:
    """The tiny block with true ties, every photo where its archive would put it."""
    rng = np.random.default_rng(2)
    photos = {}
    for name, photo in tiny.photos.items():
        start = moved(photo.exterior, rng.normal(size=6) * [8, 8, 8, 0.01, 0.01, 0.004])
        photos[name] = replace(photo, exterior=start, approximate=start, oriented=False)
    return replace(tiny.block.with_photos(photos), ties=true_ties(tiny))


def standing(tiny, *fallen: str):
    """What single photos found: the truth, but for those that did not stand."""
    return {
        name: FALLEN
        if name in fallen
        else OrientedPhoto(
            tiny.photos[name].exterior, np.eye(6) * 1e-4, (), np.zeros(0, np.int64), (), -9.0
        )
        for name in tiny.names
    }


def test_a_photo_that_did_not_stand_is_carried_by_its_ties__truth(tiny, tied, site):
    name = tiny.names[1]
    block, doubts = stand_up(tied, site, standing(tiny, name), np.random.default_rng(0))
    assert all(photo.oriented for photo in block.photos.values())
    astray = judge_orientations(tiny.truth, block)
    assert astray.ground_m[astray.photo_ids.index(name)] < 0.5
    (doubt,) = doubts
    assert (doubt.kind, doubt.subject, doubt.gravity) == ("photo-orientation", name, 0.5)
    assert "carried by tie points" in doubt.message
    assert FALLEN.reason in doubt.message


def test_one_photo_carries_the_next__truth(tiny, tied, site):
    """A photo that ties reach only through one that was carried itself."""
    outer, inner = tiny.names[0], tiny.names[1]
    block, doubts = stand_up(tied, site, standing(tiny, outer, inner), np.random.default_rng(0))
    assert all(photo.oriented for photo in block.photos.values())
    assert {doubt.subject for doubt in doubts} == {outer, inner}


def test_wrong_ties_carry_nobody_astray__truth(tiny, tied, site):
    """A third of its rays anywhere in the photo."""
    name = tiny.names[1]
    ties, rng = tied.ties, np.random.default_rng(1)
    mine = np.flatnonzero(ties.photo == ties.photo_ids.index(name))
    gross = rng.choice(mine, len(mine) // 3, replace=False)
    pixels = ties.pixels.copy()
    pixels[gross] = rng.uniform(80, 1000, (len(gross), 2))
    block, _ = stand_up(
        replace(tied, ties=replace(ties, pixels=pixels)),
        site,
        standing(tiny, name),
        np.random.default_rng(0),
    )
    astray = judge_orientations(tiny.truth, block)
    assert astray.ground_m[astray.photo_ids.index(name)] < 1.0


def test_a_photo_with_neither_is_left_out_with_a_doubt__truth(tiny, tied, site):
    name = tiny.names[2]
    ties = tied.ties
    others = ties.photo != ties.photo_ids.index(name)
    alone = replace(
        ties,
        point=np.unique(ties.point[others], return_inverse=True)[1],
        photo=ties.photo[others],
        pixels=ties.pixels[others],
        sigma_px=ties.sigma_px[others],
    )
    block, doubts = stand_up(
        replace(tied, ties=alone), site, standing(tiny, name), np.random.default_rng(0)
    )
    assert not block.photos[name].oriented
    assert sum(photo.oriented for photo in block.photos.values()) == 5
    (doubt,) = doubts
    assert doubt.gravity > 0.8
    assert "left out: only 0 tie points" in doubt.message
    untied, (doubt,) = stand_up(
        replace(tied, ties=TiePoints.none()), site, standing(tiny, name), np.random.default_rng(0)
    )
    assert not untied.photos[name].oriented
    assert "no tie points" in doubt.message


def test_a_block_of_which_nothing_stands_is_an_error_with_a_remedy__truth(tiny, tied, site):
    with pytest.raises(OrientationError, match="neither this photo") as told:
        stand_up(tied, site, standing(tiny, *tiny.names), np.random.default_rng(0))
    assert "principal distance" in told.value.remedy


def test_too_few_ties_carry_nothing__law(tiny, tied, site):
    name = tiny.names[0]
    ties = tied.ties
    mine = np.flatnonzero(ties.photo == ties.photo_ids.index(name))[MIN_TIES - 1 :]
    keep = np.setdiff1d(np.arange(len(ties.point)), mine)
    few = replace(
        ties,
        point=ties.point[keep],
        photo=ties.photo[keep],
        pixels=ties.pixels[keep],
        sigma_px=ties.sigma_px[keep],
    )
    block, _ = stand_up(
        replace(tied, ties=few), site, standing(tiny, name), np.random.default_rng(0)
    )
    assert not block.photos[name].oriented
    assert isinstance(carried_by_ties(block, name, site, np.random.default_rng(0)), Failure)


def test_a_photo_that_its_ties_contradict_steps_back__truth(tiny, tied, site):
    """It stood on the reference, a hundred metres from where its neighbours see the same ground."""
    name = tiny.names[4]
    found = standing(tiny)
    wrong = moved(tiny.photos[name].exterior, np.array([100.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    found[name] = replace(found[name], exterior=wrong, log10_e_value=4.0)
    block, doubts = stand_up(tied, site, found, np.random.default_rng(0))
    (doubt,) = doubts
    assert doubt.subject == name
    assert "contradict" in doubt.message
    assert judge_orientations(tiny.truth, block).ground_m.max() < 0.5


def test_ties_pull_a_leaning_photo_into_line__truth(tiny):
    """Woods moved all that one photo agreed on; the others hold it by their ties."""
    name = tiny.names[1]
    photos = {n: replace(p, oriented=True) for n, p in tiny.photos.items()}
    photos[name] = photos[name].with_exterior(
        moved(photos[name].exterior, np.array([6.0, -4.0, 0.0, 0.0, 0.0, 0.0])), True
    )
    block = replace(tiny.block.with_photos(photos), ties=true_ties(tiny))
    ground = ground_over(tiny, 9)
    ids = tuple(f"P{i}" for i in range(len(ground)))
    points = ReferencePoints(ids, ground, np.full(ground.shape, 0.4))
    oriented = {}
    for n, photo in photos.items():
        pixels = photo.pixel_from_object(ground, tiny.truth.camera)
        seen = np.flatnonzero(((pixels > 60) & (pixels < 1018)).all(axis=1))
        peaks = tuple(Peak(*map(float, pixels[i]), 0.5, 9.0, "gradient") for i in seen)
        # The best candidate of every point lies elsewhere; it is the second that agreed.
        best = Peak(300.0, 300.0, 0.5, 20.0, "ncc")
        found = tuple(
            Found(int(i), (best, peak), 400.0) for i, peak in zip(seen, peaks, strict=True)
        )
        oriented[n] = OrientedPhoto(photo.exterior, np.eye(6) * 1e-4, found, seen, peaks, -9.0)
    weak = weak_control(block, oriented, points, dict.fromkeys(ids, "salient"))
    before = judge_orientations(tiny.truth, block).ground_m
    after = judge_orientations(tiny.truth, join_photos(block, weak, AdjustmentOptions()))
    assert before.max() > 5
    # The six carry the one: its error is shared out.
    assert after.ground_m.max() < 0.5 * before.max()


def test_without_ties_photos_stay_as_they_are__law(tiny):
    block = tiny.block
    assert join_photos(block, WeakControl.none(), AdjustmentOptions()) is block
