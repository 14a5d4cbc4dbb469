"""A block that holds together, laid on the reference as one body."""

from dataclasses import replace

import numpy as np
import pytest

from core.block import Block
from core.control import datum
from core.control.datum import (
    LEAST_SHIFT_PX,
    SHIFT_M,
    ballot,
    join_ballots,
    lay_on_reference,
    prior,
)
from core.doubts import Failure
from core.geometry.exterior import SimilarityInSpace
from core.localisation.photo_orientation import OrientationOptions
from core.matching.patches import object_on_ground
from core.reference.stage import ReferencePoints
from core.synthetic.truth import judge_orientations

ORIENTATION = OrientationOptions(template_half_px=30)


@pytest.fixture(scope="module")
def points(tiny) -> ReferencePoints:
    """True ground under lattices over three photos."""
    grounds = []
    for name in tiny.names[::2]:
        photo = tiny.photos[name]
        share = np.stack(np.meshgrid(*[np.linspace(0.25, 0.75, 4)] * 2), axis=-1).reshape(-1, 2)
        pixels = share * np.array(photo.size_px)
        ground = object_on_ground(photo, tiny.truth.camera, pixels, tiny.reference.dem)
        grounds.append(ground)
    positions = np.vstack(grounds)
    ids = tuple(f"P{number}" for number in range(len(positions)))
    return ReferencePoints(ids, positions, np.full(positions.shape, 0.4))


def carried(tiny, step) -> Block:
    """Three true photos, moved as one body."""
    block = tiny.block.with_photos({name: tiny.photos[name] for name in tiny.names[::2]})
    about = np.mean([photo.exterior.centre for photo in block.photos.values()], axis=0)
    similarity = SimilarityInSpace(about, np.array(step))
    return block.with_photos(
        {
            name: photo.with_exterior(similarity.moved(photo.exterior), True)
            for name, photo in block.photos.items()
        }
    )


def laid(tiny, block, points, reference, seed=0):
    return lay_on_reference(
        block, tiny.scans, reference, points, ORIENTATION, np.random.default_rng(seed)
    )


@pytest.mark.parametrize(
    "step",
    [
        (6.0, -5.0, 4.0, 0.001, -0.001, 0.003, 0.002),
        (-9.0, 8.0, -6.0, 0.0, 0.002, -0.004, -0.003),
    ],
)
def test_a_block_moved_by_a_similarity_goes_back__truth(tiny, points, step):
    block = carried(tiny, step)
    before = judge_orientations(tiny.truth, block).ground_m
    back = laid(tiny, block, points, tiny.archival())
    assert isinstance(back, Block)
    after = judge_orientations(tiny.truth, back).ground_m
    assert before.min() > 4
    assert after.max() < 0.4


def test_todays_reference_brings_it_back_too__truth(tiny, features):
    """With what has remained since 1938: to a pixel or so."""
    block = carried(tiny, (6.0, -5.0, 4.0, 0.001, -0.001, 0.003, 0.002))
    back = laid(tiny, block, features.points, tiny.reference)
    assert isinstance(back, Block)
    assert judge_orientations(tiny.truth, back).ground_m.max() < 1.8


def test_photos_keep_their_place_in_the_block__law(tiny, points):
    """Distances between perspective centres change by one common factor."""
    block = carried(tiny, (6.0, -5.0, 4.0, 0.001, -0.001, 0.003, 0.002))
    back = laid(tiny, block, points, tiny.archival())
    was = np.array([photo.exterior.centre for photo in block.photos.values()])
    now = np.array([photo.exterior.centre for photo in back.photos.values()])
    ratio = np.linalg.norm(now - np.roll(now, 1, axis=0), axis=1) / np.linalg.norm(
        was - np.roll(was, 1, axis=0), axis=1
    )
    np.testing.assert_allclose(ratio, ratio[0], rtol=1e-9)


def test_what_does_not_stand_does_not_move__law(tiny, points):
    block = carried(tiny, (4.0, 4.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    name = tiny.names[0]
    fallen = replace(block.photos[name], oriented=False)
    back = laid(tiny, block.with_photos({**block.photos, name: fallen}), points, tiny.archival())
    assert isinstance(back, Block)
    assert back.photos[name] is fallen


def test_agreement_that_chance_could_bring_about_is_refused__truth(tiny, points):
    """Points that lie tens of metres from what they name: nothing to agree with."""
    rng = np.random.default_rng(3)
    shift = np.zeros(points.positions.shape)
    shift[:, :2] = rng.uniform(60, 200, (len(shift), 2)) * rng.choice([-1, 1], (len(shift), 2))
    wrong = replace(points, positions=points.positions + shift)
    astray = carried(tiny, (300.0, -200.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    found = laid(tiny, astray, wrong, tiny.archival())
    assert isinstance(found, Failure)
    assert found.evidence["log10_e_value"] < 3


def test_the_window_has_room_for_every_photo__law(tiny, points, monkeypatch):
    """It was that of the photo whose name comes first, whatever the scale of the others."""
    block = carried(tiny, np.zeros(7))
    asked: list[float] = []
    monkeypatch.setattr(datum, "ballot", lambda *given: asked.append(given[4]))
    for coarse in block.photos:
        monkeypatch.setattr(
            datum,
            "finest_gsd_m",
            lambda opened, *_, coarse=coarse: 5.0 if opened.photo.photo_id == coarse else 0.5,
        )
        assert isinstance(laid(tiny, block, points, tiny.reference), Failure)
    assert asked == [LEAST_SHIFT_PX * 5.0] * 9


def test_no_points_at_all_are_a_failure__law(tiny, points):
    nobody = ReferencePoints((), np.zeros((0, 3)), np.zeros((0, 3)))
    assert isinstance(laid(tiny, carried(tiny, np.zeros(7)), nobody, tiny.reference), Failure)


def test_the_same_seed_gives_the_same_place__law(tiny, points):
    block = carried(tiny, (3.0, -2.0, 1.0, 0.0, 0.0, 0.001, 0.0))
    one, other = (laid(tiny, block, points, tiny.archival(), seed=4) for _ in range(2))
    for name in block.photos:
        assert (
            one.photos[name].exterior.centre.tobytes()
            == other.photos[name].exterior.centre.tobytes()
        )


def test_the_edge_of_the_block_may_move_as_far_as_its_middle__law(tiny):
    block = carried(tiny, np.zeros(7))
    photos = list(block.photos.values())
    sigma = np.sqrt(np.diag(prior(block, photos, SHIFT_M)))
    np.testing.assert_allclose(sigma[:3], SHIFT_M)
    centres = np.array([photo.exterior.centre for photo in photos])
    radius = np.hypot(*(centres - centres.mean(axis=0))[:, :2].T).max()
    above = float(np.mean([p.exterior.centre[2] - p.ground_height_m for p in photos]))
    np.testing.assert_allclose(sigma[3:], SHIFT_M / max(radius, above / 2))
    alone = prior(block, photos[:1], SHIFT_M)
    assert np.isfinite(alone).all()


def test_a_point_in_two_photos_has_two_voices__law(tiny, points):
    about = tiny.photos[tiny.names[0]].exterior.centre
    ballots = [
        ballot(tiny.opened(name), tiny.archival(), points, ORIENTATION, SHIFT_M, about)
        for name in tiny.names[:2]
    ]
    seen = [set(one.candidates.point.tolist()) for one in ballots]
    assert seen[0] & seen[1]
    vote = join_ballots(ballots, np.eye(7))
    assert len(vote.first) == len(seen[0]) + len(seen[1])
    assert (np.diff(vote.candidates.point) >= 0).all()
