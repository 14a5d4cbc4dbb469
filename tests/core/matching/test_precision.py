"""How well places are known: errors of peaks are those that are stated, whatever brings them."""

import cv2
import numpy as np
import pytest

from core.matching.operators import doubled_angle_field
from core.matching.peaks import detect_peaks
from core.matching.precision import place_covariance, sharpness_of
from core.matching.template_search import correlation_scores, cosine_scores

SIDE, HALF = 141, 20
MIDDLE = SIDE // 2
TEMPLATE = np.s_[MIDDLE - HALF : MIDDLE + HALF + 1, MIDDLE - HALF : MIDDLE + HALF + 1]
NEAR = np.s_[MIDDLE - HALF - 10 : MIDDLE - HALF + 11, MIDDLE - HALF - 10 : MIDDLE - HALF + 11]


def textured(rng, blur_px):
    field = cv2.GaussianBlur(rng.normal(size=(SIDE, SIDE)).astype(np.float32), (0, 0), blur_px)
    return field / field.std()


def found(rng, noise, changed, gradients):
    """Error of one peak, and the stated standard deviation of both coordinates, pixels."""
    ground, shift = textured(rng, 1.5), rng.uniform(-0.5, 0.5, 2)
    scan = cv2.warpAffine(
        ground, np.array([[1, 0, shift[0]], [0, 1, shift[1]]]), (SIDE, SIDE), flags=cv2.INTER_CUBIC
    )
    if changed:
        scan = np.where(textured(rng, 12.0) > 0.7, textured(rng, 1.5), scan)
    scan = (scan + noise * textured(rng, 0.8)).astype(np.float32)
    shown, template = (
        (doubled_angle_field(scan), doubled_angle_field(ground))
        if gradients
        else (scan, ground - ground[TEMPLATE].mean())
    )
    template = np.ascontiguousarray(template[TEMPLATE])
    scores = (cosine_scores if gradients else correlation_scores)(shown, template)
    peak = detect_peaks(np.ascontiguousarray(scores[NEAR]), 1, 3)[0]
    row, column = (round(value) + MIDDLE - HALF - 10 for value in (peak.row, peak.column))
    window = shown[row : row + 2 * HALF + 1, column : column + 2 * HALF + 1]
    sharpness = sharpness_of((template,))
    assert sharpness is not None
    stated = np.sqrt(np.diag(place_covariance(sharpness, (window,))))
    return np.array([peak.column, peak.row]) - 10 - shift, stated


@pytest.mark.parametrize("gradients", [False, True])
@pytest.mark.parametrize(("noise", "changed"), [(0.5, False), (1.5, False), (0.3, True)])
def test_errors_are_as_large_as_is_stated__truth(noise, changed, gradients):
    rng = np.random.default_rng(19)
    pairs = [found(rng, noise, changed, gradients) for _ in range(60)]
    near = [pair for pair in pairs if np.hypot(*pair[0]) < 3]
    assert len(near) > 50
    error, stated = (np.sqrt(np.mean(np.square([pair[i] for pair in near]))) for i in (0, 1))
    assert 0.6 < stated / error < 1.6


def test_along_an_edge_a_place_is_known_badly__law():
    rng = np.random.default_rng(3)
    edge = np.tile(textured(rng, 1.5)[:1], (SIDE, 1)) + 0.05 * textured(rng, 1.5)
    window = (edge + 0.2 * textured(rng, 0.8)).astype(np.float32)[TEMPLATE]
    sharpness = sharpness_of((edge[TEMPLATE].astype(np.float32),))
    assert sharpness is not None
    across, along = np.sqrt(np.diag(place_covariance(sharpness, (window,))))
    assert along > 5 * across


def test_flat_ground_fixes_no_place__law():
    assert sharpness_of((np.ones((41, 41), np.float32),)) is None


def test_a_picture_without_the_template_says_nothing__law():
    template = textured(np.random.default_rng(4), 1.5)[TEMPLATE]
    sharpness = sharpness_of((template,))
    assert sharpness is not None
    assert np.isinf(place_covariance(sharpness, (-template,))).all()
