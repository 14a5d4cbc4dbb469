"""How well places are known: errors of peaks are those that are stated, whatever brings them."""

import cv2
import numpy as np
import pytest

from core.matching.operators import doubled_angle_field
from core.matching.peaks import (
    correlation_scores,
    cosine_scores,
    detect_peaks,
    level_and_spread,
)
from core.matching.precision import (
    likely_covariance,
    paired_covariance,
    place_covariance,
    sharpness_of,
)
from core.ties.refinement import PatchSize, refine_rays

SIDE, HALF = 141, 20
MIDDLE = SIDE // 2
TEMPLATE = np.s_[MIDDLE - HALF : MIDDLE + HALF + 1, MIDDLE - HALF : MIDDLE + HALF + 1]
NEAR = np.s_[MIDDLE - HALF - 10 : MIDDLE - HALF + 11, MIDDLE - HALF - 10 : MIDDLE - HALF + 11]


def textured(rng, blur_px):
    field = cv2.GaussianBlur(rng.normal(size=(SIDE, SIDE)).astype(np.float32), (0, 0), blur_px)
    return field / field.std()


def edges(rng, down, every):
    """A picture of edges that all go down, and of others."""
    return down * np.tile(textured(rng, 1.5)[:1], (SIDE, 1)) + every * textured(rng, 1.5)


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


@pytest.mark.parametrize("changed", [4.0, 6.0])
@pytest.mark.parametrize("along", [1.0, 0.5])
def test_where_much_has_changed_all_scores_tell_how_far_a_place_may_be_off__truth(along, changed):
    """Edges of one direction, and others that came since: the peak slides, or is another's."""
    rng = np.random.default_rng(31)
    errors, stated = [], []
    for _ in range(150):
        ground = edges(rng, 1.0, along)
        scan = (ground + changed * edges(rng, 0.5, 1.0)).astype(np.float32)
        template = ground[TEMPLATE].astype(np.float32)
        scores = correlation_scores(scan, np.ascontiguousarray(template - template.mean()))
        near = np.zeros(scores.shape, dtype=bool)
        near[NEAR] = True
        level, spread = level_and_spread(scores[~near])
        heights = (scores[NEAR] - level) / spread
        row, column = np.unravel_index(int(np.argmax(heights)), heights.shape)
        errors.append((column - 10, row - 10))
        stated.append(np.diag(likely_covariance(heights, (float(column), float(row)))))
    error, told = (np.sqrt(np.mean(each, axis=0)) for each in (np.square(errors), stated))
    # Chance holds the picture's own clutter, too: it is told rather too far.
    assert (told > error).all()
    assert (told < 1.8 * error).all()


def test_flat_ground_fixes_no_place__law():
    assert sharpness_of((np.ones((41, 41), np.float32),)) is None


def test_a_picture_without_the_template_says_nothing__law():
    template = textured(np.random.default_rng(4), 1.5)[TEMPLATE]
    sharpness = sharpness_of((template,))
    assert sharpness is not None
    assert np.isinf(place_covariance(sharpness, (-template,))).all()


def grainy_pair(rng, quality):
    """Two grainy pictures of one ground, and by how much the second is displaced."""
    # Faint beside its grain, and smooth, as a field is: little of the gradients is ground.
    ground = 12 * textured(rng, 4.0)
    shift = rng.uniform(-0.5, 0.5, 2)
    affinity = np.array([[1, 0, shift[0]], [0, 1, shift[1]]])
    moved = cv2.warpAffine(ground, affinity, (SIDE, SIDE), flags=cv2.INTER_CUBIC)
    pictures = []
    for grey in (ground, moved):
        scan = np.clip(np.rint(120 + grey + 6 * textured(rng, 0.7)), 0, 255).astype(np.uint8)
        packed = cv2.imencode(".jpg", scan, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        pictures.append(cv2.imdecode(packed, cv2.IMREAD_GRAYSCALE).astype(np.float32))
    return *pictures, shift


@pytest.mark.parametrize("quality", [100, 12])
@pytest.mark.parametrize("reduction", [7, 14])
def test_a_place_between_two_grainy_scans_is_known_as_well_as_is_stated__truth(quality, reduction):
    """Grain and blocks have gradients as well: taken for ground, they halve what is stated."""
    rng, size, bend = np.random.default_rng(23), PatchSize.at_reduction(reduction), 0.1
    inner, wide = (
        np.s_[MIDDLE - half : MIDDLE + half + 1, MIDDLE - half : MIDDLE + half + 1]
        for half in (size.radius_px, size.searched_radius_px)
    )
    errors, stated, alone = [], [], []
    start = np.eye(2, 3)[None]
    for _ in range(60):
        first, second, shift = grainy_pair(rng, quality)
        rays = (first[inner][None], second[wide][None], start)
        found = refine_rays(*rays, max_shift_px=3.0, size=size, bend_sigma=bend)
        if not found.good[0]:
            continue
        smooth = [cv2.GaussianBlur(grey, (0, 0), size.smooth_px) for grey in (first, second)]
        place = (MIDDLE + found.pixels[0]).tolist()
        shown = cv2.getRectSubPix(smooth[1], (2 * size.radius_px + 1,) * 2, place)
        pair = [np.ascontiguousarray(grey - grey.mean()) for grey in (smooth[0][inner], shown)]
        errors.append(found.pixels[0] - shift)
        stated.append(np.diag(paired_covariance(pair[0], pair[1], size.smooth_px, bend)))
        sharpness = sharpness_of((pair[0],))
        assert sharpness is not None
        alone.append(np.diag(place_covariance(sharpness, (pair[1],))))
    assert len(errors) > 30
    error = np.sqrt(np.median(np.square(errors)))
    assert 0.6 < np.sqrt(np.median(stated)) * 0.674 / error < 1.6
    assert np.median(alone) < 0.6 * np.median(stated)
