"""Parallaxes between two rectified photos: semi-global matching, then least squares.

OpenCV's semi-global matching finds whole courses of parallaxes and leaves out what the other photo
does not confirm. Least squares over a small window then measures each to a part of a pixel, and
says how well: from what remains of the difference, its likeness among neighbours, and the slopes
of the gray values.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from core.arrays import Mask
from core.surface.rectified import Picture, RectifiedPair

# design: grain averages out over it, and a house still spans several of them.
BLOCK_PX = 5
"""Side of the squares that semi-global matching compares."""
# source: OpenCV, the largest median of floating numbers
MEDIAN_PX = 5
"""Single parallaxes that leave their surroundings are taken out over this side."""
# source: OpenCV, StereoSGBM: 8 and 32 times the area of the square
SMOOTHNESS = (8, 32)
"""Cost of a change of the parallax by one pixel and by more, over the square's area."""
# source: OpenCV, StereoSGBM: usual values 5 to 15 per cent; least squares judges once more.
UNIQUENESS = 5
"""Margin in per cent by which the best parallax must win."""
# source: OpenCV, StereoSGBM: 50 to 200 and 1 or 2
SPECKLE = (100, 2)
"""Parts smaller than so many pixels that differ from all around by so many are left out."""
# design: slow changes of tone across a field are taken out, its furrows stay.
TONE_PX = 31
"""Side of the window whose mean and contrast each gray value is counted from."""
# design: of usual contrast, so that grain on bare ground is not made into texture.
LEAST_CONTRAST = 0.5
"""Contrast is taken to be at least this share of the median one."""
# design: no division by nought.
NOTHING = 1e-6
# design: less of a window says nothing of its middle.
LEAST_KNOWN = 0.1
"""Share of a window with parallaxes that are smoothed."""
# design: four standard deviations of contrast fill eight bits.
STEPS_PER_SIGMA = 32.0
"""Gray values of the pictures that are compared, per standard deviation of contrast."""
# design: wide enough for weak texture, narrower than a house at the pixel that is matched.
WINDOW_SIGMA_PX = 3.5
"""Width of the bell-shaped window of least squares."""
# design: some thousand pixels measure a parallax across to a fiftieth of a pixel.
PART_PX = 128
"""Side of the parts over which parallaxes across the rows are measured, pixels."""
# design: what moves further was not found by semi-global matching.
MOST_STEP_PX = 1.0
"""Least squares may move a parallax by this."""
# design: beyond, heights say less than the terrain around.
MOST_SIGMA_PX = 0.7
"""What is measured worse than this is left open."""
# design: where nearly all is grain, the estimate itself is no better known than this.
LEAST_TRUE = 0.1
"""Share of squared slopes that counts as the picture's own, at least."""
# design: grain of film is alike over two pixels.
LAGS_PX = 3
"""Likeness among neighbours is counted up to this distance."""


@dataclass(frozen=True, slots=True, eq=False)
class Parallaxes:
    """For every pixel of the left photo of a pair."""

    parallax_px: Picture
    """Column in the left photo minus column in the right one; positive above the start surface."""
    sigma_px: Picture
    """Its standard deviation by grain and orientations, each pair's own."""
    rounding_px: Picture
    """Standard deviation of what its window rounds off, the same in every pair."""
    found: Mask
    """Where there is one."""


def match_pair(pair: RectifiedPair, reach_px: int) -> Parallaxes:
    """Measure the parallaxes of a pair within a reach to either side."""
    left, right = (
        _normalised(pair.left.gray, pair.left.seen),
        _normalised(pair.right.gray, pair.right.seen),
    )
    coarse, found = _semi_global(left, right, reach_px)
    found &= pair.left.seen
    return _least_squares(left, right, coarse, found, pair.right.seen)


def _normalised(gray: Picture, seen: Mask) -> Picture:
    """Gray values counted from the mean around, in standard deviations around."""
    share = _mean(seen.astype(np.float32))
    share = np.maximum(share, np.float32(NOTHING))
    shown = np.where(seen, gray, np.float32(0))
    mean = _mean(shown) / share
    square = _mean(shown * shown) / share
    contrast = np.sqrt(np.maximum(square - mean * mean, np.float32(0)))
    usual = float(np.median(contrast[seen])) if seen.any() else 1.0
    least = max(LEAST_CONTRAST * usual, NOTHING)
    return np.where(seen, (gray - mean) / np.maximum(contrast, least), np.float32(0)).astype(
        np.float32
    )


def _mean(values: Picture) -> Picture:
    return np.asarray(cv2.blur(values, (TONE_PX, TONE_PX)))


def _semi_global(left: Picture, right: Picture, reach_px: int) -> tuple[Picture, Mask]:
    """Parallaxes to a sixteenth of a pixel, and which the other photo confirms."""
    reach = -(-reach_px // 8) * 8  # source: OpenCV, the number of parallaxes is one of sixteens
    area = BLOCK_PX * BLOCK_PX
    matcher = cv2.StereoSGBM.create(
        minDisparity=-reach,
        numDisparities=2 * reach,
        blockSize=BLOCK_PX,
        P1=SMOOTHNESS[0] * area,
        P2=SMOOTHNESS[1] * area,
        disp12MaxDiff=1,
        uniquenessRatio=UNIQUENESS,
        speckleWindowSize=SPECKLE[0],
        speckleRange=SPECKLE[1],
        mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )
    raw = matcher.compute(_bytes(left), _bytes(right))
    found = raw > -reach * 16  # source: OpenCV, sixteenths of a pixel; below is what is not found
    parallax = raw.astype(np.float32) / 16  # source: OpenCV, sixteenths of a pixel
    return np.where(found, parallax, np.float32(0)), found


def _bytes(normalised: Picture) -> UInt8[np.ndarray, "rows columns"]:
    # source: the middle of eight bits
    return np.clip(normalised * STEPS_PER_SIGMA + 128, 0, 255).astype(np.uint8)


def _least_squares(
    left: Picture, right: Picture, coarse: Picture, found: Mask, seen: Mask
) -> Parallaxes:
    """Parallaxes to a part of a pixel, with their standard deviations."""
    columns, rows = np.meshgrid(
        np.arange(left.shape[1], dtype=np.float32), np.arange(left.shape[0], dtype=np.float32)
    )
    smooth = _smooth(coarse, found)
    moved = _at(right, columns - smooth, rows)
    difference = left - moved
    slope = (_slope(left) + _slope(moved)) / 2
    step, sigma = _solve(difference, slope)
    found = found & (np.abs(step) <= MOST_STEP_PX)
    shown = _at(seen.astype(np.float32), columns - smooth, rows) > 0.5
    sigma = sigma * _likeness(difference, slope, found)
    across = _across(difference, _slope(left.T).T + _slope(moved.T).T, found & shown)
    parallax = smooth + np.where(found, step, np.float32(0))
    rounding = _rounding(parallax, sigma, found)
    sigma = np.hypot(sigma, np.float32(across))
    good = np.hypot(sigma, rounding) < MOST_SIGMA_PX
    return Parallaxes(parallax, sigma, rounding, found & shown & good)


def _rounding(parallax: Picture, sigma: Picture, found: Mask) -> Picture:
    """How far parallaxes scatter in each window about a plane, which it measures without bias.

    Their own errors, smooth over the same window, scatter in it by half of their variance, and half
    of that is a plane. What stands is widened by up to half of a square of semi-global matching,
    and by up to half of that of the median.
    """
    known = found.astype(np.float32)
    share = np.maximum(_window(known), np.float32(LEAST_KNOWN))
    mean = _window(parallax * known) / share
    scatter = _window(parallax**2 * known) / share - mean**2
    plane = WINDOW_SIGMA_PX**2 * (_slope(mean) ** 2 + _slope(mean.T).T ** 2)
    left = np.sqrt(np.maximum(scatter - plane - sigma**2 / 4, np.float32(0)))
    wide = np.ones((BLOCK_PX + MEDIAN_PX - 1,) * 2, dtype=np.uint8)
    return np.asarray(cv2.dilate(left, wide))


def _across(difference: Picture, slopes: Picture, found: Mask) -> float:
    """Parallax across the rows, RMS over parts of the tile, pixels.

    Orientations that fit leave none; what they leave along the rows, where it passes for height,
    is about as large.
    """
    size = tuple(max(1, side // PART_PX) for side in found.shape[::-1])
    both = cv2.resize(np.where(found, difference * slopes, 0), size, interpolation=cv2.INTER_AREA)
    square = cv2.resize(np.where(found, slopes**2, 0), size, interpolation=cv2.INTER_AREA)
    # The slopes are twice the mean of both photos'.
    total = max(float(square.sum()), NOTHING)
    return float(np.sqrt((4 * both**2 / np.maximum(square, NOTHING)).sum() / total))


def _smooth(parallax: Picture, found: Mask) -> Picture:
    """What the window of least squares is laid out by: no finer than it can measure."""
    known = found.astype(np.float32)
    share = _window(known)
    mean = _window(cv2.medianBlur(parallax, MEDIAN_PX) * known)
    return np.where(share > LEAST_KNOWN, mean / np.maximum(share, LEAST_KNOWN), parallax).astype(
        np.float32
    )


def _at(picture: Picture, columns: Picture, rows: Picture) -> Picture:
    return np.asarray(
        cv2.remap(picture, columns, rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    )


def _slope(picture: Picture) -> Picture:
    return np.asarray(cv2.Sobel(picture, cv2.CV_32F, 1, 0, ksize=1, scale=0.5))


def _window(values: Picture) -> Picture:
    return np.asarray(cv2.GaussianBlur(values, (0, 0), WINDOW_SIGMA_PX))


def _solve(difference: Picture, slope: Picture) -> tuple[Picture, Picture]:
    """Step of the parallax by least squares in each window, and its standard deviation.

    A photo of another tone all over the window is no parallax: means are taken out. The standard
    deviation is that of neighbours without likeness.
    """
    mean_d, mean_s = _window(difference), _window(slope)
    both = _window(difference * slope) - mean_d * mean_s
    slopes = np.maximum(_window(slope * slope) - mean_s * mean_s, np.float32(NOTHING))
    step = both / slopes
    # What is taken for slopes is grain in part; that of the difference is grain alone.
    grain = _window(_slope(difference) ** 2) / 4
    true = np.maximum(slopes - grain, LEAST_TRUE * slopes)
    left_over = np.maximum(_window(difference * difference) - mean_d * mean_d - step * both, 0)
    # source: the squared weights of a bell of this width add up to 1 / (4 pi sigma^2)
    pixels = 4 * np.pi * WINDOW_SIGMA_PX**2
    return -step, np.sqrt(left_over / true / pixels)


def _likeness(difference: Picture, slope: Picture, found: Mask) -> float:
    """Factor on standard deviations because neighbouring differences are alike."""
    if not found.any():
        return 1.0
    noise, rise = np.where(found, difference, 0), np.where(found, slope, 0)
    factor = 1.0
    for down in range(LAGS_PX + 1):
        for across in range(-LAGS_PX if down else 1, LAGS_PX + 1):
            # Each lag stands for its opposite, too.
            factor += 2 * _correlation(noise, down, across) * _correlation(rise, down, across)
    return float(np.sqrt(max(factor, 1.0)))


def _correlation(values: Float32[np.ndarray, "r c"], down: int, across: int) -> float:
    rows, columns = values.shape
    one = values[max(down, 0) : rows + min(down, 0), max(across, 0) : columns + min(across, 0)]
    other = values[max(-down, 0) : rows - max(down, 0), max(-across, 0) : columns - max(across, 0)]
    return float(np.vdot(one, other) / max(float(np.vdot(values, values)), NOTHING))
