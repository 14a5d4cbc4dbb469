"""Matches: nearest of both sides, and as their neighbours."""

import cv2
import numpy as np

from core.ties.features import Features
from core.ties.matches import like_neighbours, match_features


def features(descriptors: np.ndarray) -> Features:
    count = len(descriptors)
    ones = np.ones(count)
    return Features((100, 100), 1, np.zeros((count, 2)), ones, ones, descriptors)


def test_matches_are_those_of_opencv__oracle():
    rng = np.random.default_rng(1)
    first = rng.integers(0, 90, (700, 128)).astype(np.uint8)
    second = rng.integers(0, 90, (900, 128)).astype(np.uint8)
    second[:400] = np.clip(first[200:600] + rng.integers(-25, 25, (400, 128)), 0, 255)
    ours = match_features(features(first), features(second), block_rows=128)
    matcher = cv2.BFMatcher(cv2.NORM_L2)
    chosen = []
    for one, other in ((first, second), (second, first)):
        pairs = matcher.knnMatch(one.astype(np.float32), other.astype(np.float32), k=2)
        chosen.append({(a.queryIdx, a.trainIdx) for a, b in pairs if a.distance < 0.8 * b.distance})
    expected = chosen[0] & {(there, here) for here, there in chosen[1]}
    assert len(expected) > 300
    assert set(zip(ours.first.tolist(), ours.second.tolist(), strict=True)) == expected


def test_no_features_no_matches__law():
    none, some = features(np.zeros((0, 128), np.uint8)), features(np.ones((5, 128), np.uint8))
    assert len(match_features(none, some).first) == 0
    assert len(match_features(some, none).first) == 0


def test_a_match_unlike_its_neighbours_is_dropped__truth():
    rng = np.random.default_rng(2)
    first = rng.uniform(0, 2000, (400, 2))
    relief = 30 * np.sin(first[:, 0] / 300) * np.cos(first[:, 1] / 400)
    second = 2000 - first
    second[:, 0] += relief + rng.normal(0, 0.5, 400)
    second[:15, 0] += rng.choice([-1, 1], 15) * rng.uniform(80, 400, 15)
    like = like_neighbours(first, second)
    assert not like[:15].any()
    assert like[15:].mean() > 0.98
