"""Ties make one body of the photos; what single photos agreed on steers only weakly."""

from dataclasses import replace

import numpy as np

from core.adjustment.adjusted import AdjustmentOptions
from core.block import Peak
from core.geometry.resection import moved
from core.localisation.joined_block import WeakControl, join_photos, weak_control
from core.localisation.photo_orientation import OrientedPhoto
from core.matching.local_search import Found
from core.reference.stage import ReferencePoints
from core.synthetic.truth import judge_orientations
from tests.tiny import ground_over, true_ties


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
