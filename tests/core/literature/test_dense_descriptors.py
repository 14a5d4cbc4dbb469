"""SIFT and ORB at every place at once, against OpenCV's at single keypoints."""

import cv2
import numpy as np
import pytest

from core.literature.dense_descriptors import (
    ORB_SIDE_PX,
    orb_pairs,
    orb_scores,
    sift_histograms,
    sift_scores,
    smoothed_for_orb,
    smoothed_gradients,
)
from tests.core.matching.test_operators import ground

SIDE = 260


def textured(seed):
    """Fields and clouds of whole grey values, from 0 to 255."""
    rng = np.random.default_rng(seed)
    clouds = cv2.GaussianBlur(rng.normal(0, 1, (SIDE, SIDE)).astype(np.float32), (0, 0), 3)
    image = ground(seed, SIDE) + clouds * np.float32(25 / clouds.std())
    image = (image - image.min()) * np.float32(255 / np.ptp(image))
    return np.rint(image).astype(np.float32)


def keypoints(count, rim, size):
    """Upright keypoints on whole pixels, and where they are."""
    places = np.random.default_rng(2).integers(rim, SIDE - rim, (count, 2)).tolist()
    return places, [cv2.KeyPoint(float(x), float(y), size, 0.0, 0.0, 0, 0) for x, y in places]


@pytest.mark.parametrize("bin_px", [5.25, 12.75])
def test_sift_is_that_of_opencv_at_its_keypoints__oracle(bin_px):
    """In a square as wide as OpenCV looks, so that nothing is cut off."""
    image, half_px = textured(1), int(2.5 * bin_px) + 1
    places, points = keypoints(60, half_px + 1, 2 * bin_px / 3)
    _, wanted = cv2.SIFT.create().compute(image.astype(np.uint8), points)
    own = sift_histograms(smoothed_gradients(image), half_px, bin_px)
    for (x, y), theirs in zip(places, wanted, strict=True):
        one = own[:, :, y - half_px, :, x - half_px].transpose(1, 2, 0).ravel()
        assert np.corrcoef(one, theirs)[0, 1] > 0.999
        # Of a length of 512, rounded to whole numbers.
        assert np.abs(512 * one - theirs).max() < 6


def test_the_nearest_by_sift_is_the_nearest_by_opencv__oracle():
    """Templates of changed ground, sought 16 pixels to either side."""
    scan = textured(3)
    reference = np.clip(0.7 * scan + 0.3 * textured(4), 0, 255).astype(np.float32)
    half_px, reach, same = 20, 16, 0
    fields = smoothed_gradients(scan), smoothed_gradients(reference)
    places, _ = keypoints(20, half_px + reach + 1, 1.0)
    sift = cv2.SIFT.create()
    for x, y in places:
        outer = half_px + reach
        window = np.ascontiguousarray(
            fields[0][y - outer : y + outer + 1, x - outer : x + outer + 1]
        )
        patch = np.ascontiguousarray(
            fields[1][y - half_px : y + half_px + 1, x - half_px : x + half_px + 1]
        )
        own = sift_scores(window, patch)
        points = [
            cv2.KeyPoint(float(x + right), float(y + down), 41 / 6, 0.0, 0.0, 0, 0)
            for down in range(-reach, reach + 1)
            for right in range(-reach, reach + 1)
        ]
        _, wanted = sift.compute(reference.astype(np.uint8), [points[len(points) // 2]])
        _, offered = sift.compute(scan.astype(np.uint8), points)
        theirs = np.linalg.norm(offered - wanted, axis=1).reshape(own.shape)
        best, best_theirs = (
            np.unravel_index(v, own.shape) for v in (own.argmax(), theirs.argmin())
        )
        same += bool(np.hypot(*np.subtract(best, best_theirs)) <= 1.5)
    assert same >= 18


def test_orb_is_that_of_opencv_at_its_keypoints__oracle():
    image = textured(5)
    smooth, pairs = smoothed_for_orb(image, ORB_SIDE_PX // 2), orb_pairs()
    orb = cv2.ORB.create(edgeThreshold=0, nlevels=1, patchSize=ORB_SIDE_PX)
    places, points = keypoints(120, 20, float(ORB_SIDE_PX))
    kept, wanted = orb.compute(image.astype(np.uint8), points)
    assert len(kept) == len(places)
    same, clear = [], []
    for (x, y), theirs in zip(places, wanted, strict=True):
        values = smooth[y + pairs[:, :, 1], x + pairs[:, :, 0]]
        told = np.unpackbits(theirs, bitorder="little").astype(bool)
        same.append((values[:, 0] < values[:, 1]) == told)
        # OpenCV rounds what it smoothed to whole grey values.
        clear.append(np.abs(values[:, 0] - values[:, 1]) > 1)
    assert np.mean(same) > 0.98
    assert np.all(np.array(same)[np.array(clear)])


def test_orb_counts_the_comparisons_that_differ__law():
    """As bit by bit, place by place."""
    rng = np.random.default_rng(6)
    window, template = (
        rng.normal(0, 1, (side, side)).astype(np.float32) for side in (ORB_SIDE_PX + 4, ORB_SIDE_PX)
    )
    pairs = orb_pairs() + ORB_SIDE_PX // 2

    def bits(image):
        values = image[pairs[:, :, 1], pairs[:, :, 0]]
        return values[:, 0] < values[:, 1]

    surface = orb_scores(window, template)
    assert surface.shape == (5, 5)
    for row in range(5):
        for column in range(5):
            here = window[row : row + ORB_SIDE_PX, column : column + ORB_SIDE_PX]
            assert surface[row, column] == -np.mean(bits(here) != bits(template))
