"""SIFT, ORB and AKAZE as operators: described at every place, compared by distance.

This is variant VD of the thesis's Table 2: no detection; a junction's patch is described at its
middle, and so is every place of the search window. They are blind to what changed; AKAZE, place by
place in OpenCV, is slow as well.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any, cast

import cv2
import numpy as np
from jaxtyping import Float32, Int, UInt8

from core.matching.operators import without_means
from core.matching.peaks import Description, Field, Image, ScoreMap, Template, TemplateField

# source: Lowe 2004, section 6.1.
ORIENTATIONS, BINS = 8, 4
"""Orientations and bins a side of a SIFT descriptor."""
# source: Lowe 2004, section 3.3: smoothed to 1.6 px, a picture being sharp to 0.5 px.
SIFT_SMOOTHED_PX = float(np.sqrt(1.6**2 - 0.5**2))
# source: Lowe 2004, section 6.1.
MOST = np.float32(0.2)
"""No value of a descriptor of unit length counts for more, so that no single edge rules it."""
# design: keeps the division finite where nothing has a gradient.
DULL = np.float32(1e-6)
# source: Rublee et al. 2011, section 4: patches of 31 pixels.
ORB_SIDE_PX = 31
"""The pattern of ORB spans so many pixels; it is stretched over the template."""
# source: OpenCV's ORB, which smooths so before it compares pixels.
ORB_SMOOTHED_SIDE_PX, ORB_SMOOTHED_PX = 7, 2.0
"""Smoothing of ORB: side and standard deviation of its Gaussian, stretched with the pattern."""
# source: Rublee et al. 2011, section 4: 256 comparisons.
BITS = 256
# design: twice half of ORB_SIDE_PX and a little, so that no pixel of the pattern is missed.
REACH_PX = 32
"""No pixel of the pattern lies so far along the lines it is asked along."""
# source: the full descriptor of AKAZE in OpenCV.
AKAZE_BITS = 486.0
# source: OpenCV's AKAZE; 2 * 10 * 0.75 * 2.67 = 40.
AKAZE_SIDE_PX, AKAZE_SIZE = 40, 2.67
"""Template and window are brought to a scale at which AKAZE spans so many pixels, its pattern
reaching ten steps of 0.75 sizes to either side."""
# design: beyond any distance of two descriptors.
FAR = 1e6

Gray8 = UInt8[np.ndarray, "rows columns"]
"""What OpenCV describes."""
Filters = Float32[np.ndarray, "filtered places"]
"""One row for each bin and place: what it takes of a line of pixels."""
Histograms = Float32[np.ndarray, "8 4 shifts_down 4 shifts_right"]
"""Orientation, bin downwards, place downwards, bin to the right, place to the right."""
OrientationMaps = Float32[np.ndarray, "8 rows columns"]
Pairs = Int[np.ndarray, "256 2 2"]
"""Offsets (right, down) of the first and the second value of each comparison, pixels."""


@dataclass(frozen=True, slots=True)
class SiftOperator:
    """Distance of SIFT descriptors, upright, over the whole template, at every place at once.

    A keypoint's histogram sums gradient magnitudes, shared out between neighbouring orientations
    and neighbouring bins in place, under a Gaussian about the keypoint (Lowe 2004,
    doi:10.1023/B:VISI.0000029664.99615.94, section 6). Upright, of one size and at every place,
    each bin is a filter that is the same everywhere and separable: two products of matrices take
    the place of a loop over keypoints.
    """

    name: str = "sift"

    def of_scan(self, scan: Image, template_half_px: int) -> Description:
        """Gradients of smoothed grey values."""
        return (smoothed_gradients(scan),)

    def of_reference(self, reference: Image, roads: Image, template_half_px: int) -> Description:
        """The same of the ortho."""
        return (smoothed_gradients(reference),)

    def scores(self, around: Description, patch: Description) -> ScoreMap:
        """Less the distance of descriptors of unit length, so that the highest is the nearest."""
        return sift_scores(around[0], patch[0])

    def correlated(self, shown: Description, patch: Description) -> tuple[Description, Description]:
        """The gradients: distances of descriptors are no sums of products."""
        return shown, patch


@dataclass(frozen=True, slots=True)
class OrbOperator:
    """Hamming distance of ORB descriptors, upright, at the scale that fills the template.

    256 pairs of smoothed grey values about a place are compared, and the comparisons that differ
    are counted (Rublee et al. 2011, doi:10.1109/ICCV.2011.6126544). Where the pairs lie is
    OpenCV's; it is asked for them once. At every place of a window each pair is two shifted copies
    of the whole window, compared in one stroke.
    """

    name: str = "orb"

    def of_scan(self, scan: Image, template_half_px: int) -> Description:
        """Grey values, smoothed to the scale of the pattern."""
        return (smoothed_for_orb(scan, template_half_px),)

    def of_reference(self, reference: Image, roads: Image, template_half_px: int) -> Description:
        """The same of the ortho."""
        return (smoothed_for_orb(reference, template_half_px),)

    def scores(self, around: Description, patch: Description) -> ScoreMap:
        """Less the share of differing bits."""
        return orb_scores(around[0], patch[0])

    def correlated(self, shown: Description, patch: Description) -> tuple[Description, Description]:
        """Grey values less their means: shares of bits are no sums of products."""
        return without_means(shown, patch)


@dataclass(frozen=True, slots=True)
class AkazeOperator:
    """Hamming distance of AKAZE descriptors, upright, over the whole template."""

    name: str = "akaze"

    def of_scan(self, scan: Image, template_half_px: int) -> Description:
        """Grey values."""
        return (scan,)

    def of_reference(self, reference: Image, roads: Image, template_half_px: int) -> Description:
        """Grey values."""
        return (reference,)

    def scores(self, around: Description, patch: Description) -> ScoreMap:
        """Less the share of differing bits; OpenCV 5 keeps AKAZE elsewhere: see `has_akaze`."""
        library = cast("Any", cv2)
        akaze = library.AKAZE_create(descriptor_type=library.AKAZE_DESCRIPTOR_MLDB_UPRIGHT)
        scale = max(len(patch[0]) / AKAZE_SIDE_PX, 1.0)
        found = described_scores(akaze, around[0], patch[0], AKAZE_SIZE, scale)
        return found / np.float32(AKAZE_BITS)

    def correlated(self, shown: Description, patch: Description) -> tuple[Description, Description]:
        """Grey values less their means: shares of bits are no sums of products."""
        return without_means(shown, patch)


def smoothed_gradients(image: Image) -> Field:
    """Gradients to the right and upwards of smoothed grey values."""
    smooth = cv2.GaussianBlur(image, (0, 0), SIFT_SMOOTHED_PX)
    step = np.array([[-1, 0, 1]], np.float32)
    right = cv2.filter2D(smooth, cv2.CV_32F, step)
    up = cv2.filter2D(smooth, cv2.CV_32F, -step.T)
    return np.asarray(cv2.merge([right, up]), dtype=np.float32)


def sift_scores(window: Field, template: TemplateField) -> ScoreMap:
    """Less the distance between a template's descriptor and that of every place of a window.

    Args:
        window: Gradients of the scan.
        template: Gradients of the reference, square, with an odd number of rows.

    Returns:
        From -sqrt(2) for descriptors that share nothing to 0 for the same one.
    """
    side = template.shape[0]
    wanted = sift_histograms(template, side // 2, side / BINS)
    offered = sift_histograms(window, side // 2, side / BINS)
    likeness = np.einsum("kaibj,kab->ij", offered, wanted[:, :, 0, :, 0])
    return -np.sqrt(np.maximum(np.float32(2) - np.float32(2) * likeness, np.float32(0)))


def sift_histograms(gradients: Field | TemplateField, half_px: int, bin_px: float) -> Histograms:
    """Descriptors of unit length, of a square of 2 n + 1 pixels about every place.

    Args:
        gradients: To the right and upwards.
        half_px: n: no place closer to the rim is described, nothing further off is looked at.
        bin_px: Side of one of the four by four bins; their triangles reach two and a half of them
            from the place, less what the square cuts off.
    """
    rows, columns = (side - 2 * half_px for side in gradients.shape[:2])
    down, across = (bin_filters(places, half_px, bin_px) for places in (rows, columns))
    found = np.matmul(np.matmul(down, orientation_maps(gradients)), across.T)
    found = found.reshape(ORIENTATIONS, BINS, rows, BINS, columns)
    found = np.minimum(found, MOST * lengths(found))
    found /= lengths(found) + DULL
    return found


def lengths(found: Histograms) -> Float32[np.ndarray, "shifts_down 1 shifts_right"]:
    """Length of the descriptor of every place."""
    return np.sqrt(np.einsum("kaibj,kaibj->ij", found, found))[:, None]


def orientation_maps(gradients: Field | TemplateField) -> OrientationMaps:
    """Gradient magnitude, shared out between the two orientations it lies between."""
    right, up = (np.ascontiguousarray(gradients[:, :, axis]) for axis in (0, 1))
    magnitude, angle = cv2.cartToPolar(right, up)
    bins = angle * np.float32(ORIENTATIONS / (2 * np.pi))
    shared = np.empty((ORIENTATIONS, *right.shape), np.float32)
    for orientation in range(ORIENTATIONS):
        away = np.abs(bins - np.float32(orientation))
        away = np.minimum(away, np.float32(ORIENTATIONS) - away)
        shared[orientation] = np.maximum(np.float32(1) - away, np.float32(0)) * magnitude
    return shared


def bin_filters(places: int, half_px: int, bin_px: float) -> Filters:
    """What each bin of each place takes along a line: a triangle under the Gaussian.

    Args:
        places: How many places there are along the line.
        half_px: Half the square of a place.
        bin_px: Distance between the middles of two bins.
    """
    away = np.arange(-half_px, half_px + 1) / bin_px
    middles = np.arange(BINS) - (BINS - 1) / 2
    triangles = np.maximum(1 - np.abs(away - middles[:, None]), 0)
    taken = triangles * np.exp(-0.5 * (away / (BINS / 2)) ** 2)
    filters = np.zeros((BINS, places, places + 2 * half_px), np.float32)
    for place in range(places):
        filters[:, place, place : place + taken.shape[1]] = taken
    return filters.reshape(BINS * places, -1)


def smoothed_for_orb(image: Image, half_px: int) -> Image:
    """Grey values smoothed to the scale of a pattern that spans 2 n + 1 pixels."""
    scale = (2 * half_px + 1) / ORB_SIDE_PX
    side = 2 * round(ORB_SMOOTHED_SIDE_PX * scale / 2 - 0.5) + 1
    return np.asarray(cv2.GaussianBlur(image, (side, side), ORB_SMOOTHED_PX * scale), np.float32)


def orb_scores(window: Image, template: Template) -> ScoreMap:
    """Less the share of comparisons in which a template differs from every place of a window.

    Args:
        window: Smoothed grey values of the scan.
        template: Those of the reference, square, with an odd number of rows.
    """
    half_px = template.shape[0] // 2
    pairs = stretched_pairs(half_px) + half_px
    values = template[pairs[:, :, 1], pairs[:, :, 0]]
    return differing(window, half_px, pairs, values[:, 0] < values[:, 1]) / np.float32(-BITS)


def differing(
    window: Image, half_px: int, pairs: Pairs, wanted: np.ndarray
) -> Float32[np.ndarray, "shifts_down shifts_right"]:
    """In how many comparisons each place differs from the wanted ones.

    Args:
        window: Smoothed grey values.
        half_px: Half the square about each place.
        pairs: Columns and rows from the corner of the square.
        wanted: Which comparisons should be true.
    """
    columns = window.shape[1]
    rows, across = (side - 2 * half_px for side in window.shape)
    # One line for the whole window: a shift is then an offset, and nothing is copied.
    line = np.ascontiguousarray(window).reshape(-1)
    length = (rows - 1) * columns + across
    starts = (pairs[:, :, 1] * columns + pairs[:, :, 0]).tolist()
    counts = np.zeros((2, length), np.uint8)
    differs = np.empty(length, np.bool_)
    for bit, (first, second) in enumerate(starts):
        compare = np.greater_equal if wanted[bit] else np.less
        compare(line[first : first + length], line[second : second + length], out=differs)
        count = counts[2 * bit // BITS]
        np.add(count, differs.view(np.uint8), out=count)
    padded = np.zeros(rows * columns, np.float32)
    padded[:length] = counts.sum(axis=0, dtype=np.float32)
    return padded.reshape(rows, columns)[:, :across]


def stretched_pairs(half_px: int) -> Pairs:
    """The pattern laid over 2 n + 1 pixels."""
    scale = (2 * half_px + 1) / ORB_SIDE_PX
    return np.rint(orb_pairs() * scale).astype(np.int64)


@cache
def orb_pairs() -> Pairs:
    """Where OpenCV's pattern lies, read off steps of grey that are moved across a keypoint.

    A comparison of two pixels is true for just those steps whose smoothed edge lies between them:
    the first and the last that is seen tell where both are along the line. Pixels that are level
    with each other along one line are told by the diagonal.
    """
    line = np.arange(-2 * REACH_PX, 2 * REACH_PX + 1)
    right, down = np.meshgrid(line, line)
    edge = ORB_SMOOTHED_SIDE_PX // 2
    columns, upright = compared_pairs(right, edge)
    rows, level = compared_pairs(down, edge)
    sums, _ = compared_pairs(right + down, 2 * edge)
    columns = np.where(upright[:, None], sums - rows, columns)
    rows = np.where(level[:, None], sums - columns, rows)
    return np.stack([columns, rows], axis=2)


def compared_pairs(
    places: Int[np.ndarray, "rows columns"], edge: int
) -> tuple[Int[np.ndarray, "256 2"], np.ndarray]:
    """Where both pixels of each comparison lie along a line, and which of them are level.

    Args:
        places: Place of every pixel along the line.
        edge: Half-width of a smoothed step along it.
    """
    steps = range(-REACH_PX, REACH_PX + 1)
    rising = np.array([bits_of(places >= step) for step in steps])
    falling = np.array([bits_of(places < step) for step in steps])
    first_lower = rising.any(axis=0)
    level = np.asarray(~(first_lower | falling.any(axis=0)))
    seen = np.where(first_lower, rising, falling)
    low = np.argmax(seen, axis=0) - REACH_PX + edge - 1
    high = REACH_PX - np.argmax(seen[::-1], axis=0) - edge
    both = np.where(first_lower, (low, high), (high, low))
    return both.T.astype(np.int64), level


def bits_of(bright: np.ndarray) -> UInt8[np.ndarray, "256"]:
    """ORB of OpenCV in the middle of a picture."""
    made = cv2.ORB.create(edgeThreshold=0, nlevels=1, patchSize=ORB_SIDE_PX)
    middle = float(bright.shape[0] // 2)
    point = cv2.KeyPoint(middle, middle, ORB_SIDE_PX, 0.0, 0.0, 0, 0)
    _, found = made.compute((bright * np.uint8(255)).astype(np.uint8), [point])
    return np.unpackbits(np.asarray(found, np.uint8)[0], bitorder="little")


def has_akaze() -> bool:
    """Whether this OpenCV has AKAZE: version 5 has dropped it."""
    return hasattr(cv2, "AKAZE_create")


def described_scores(
    extractor: Any, around: Image, patch: Template, size: float, scale: float
) -> ScoreMap:
    """Less the distance between the patch's middle and every place of the window."""
    rows = around.shape[0] - patch.shape[0] + 1
    columns = around.shape[1] - patch.shape[1] + 1
    inner = patch.shape[0] // 2
    places = [
        (float(inner + column), float(inner + row))
        for row in range(rows)
        for column in range(columns)
    ]
    wanted = describe_places(extractor, patch, [(float(inner), float(inner))], size, scale)
    offered = describe_places(extractor, around, places, size, scale)
    scores = np.full(rows * columns, FAR, np.float32)
    if wanted and offered:
        template = next(iter(wanted.values()))
        order = list(offered)
        values = np.stack([offered[index] for index in order])
        differing = np.bitwise_xor(values.astype(np.uint8), template[None])
        scores[order] = np.unpackbits(np.asarray(differing, np.uint8), axis=1).sum(axis=1)
    told = scores < FAR
    scores[~told] = scores[told].max() if told.any() else 0.0
    return -scores.reshape(rows, columns)


def describe_places(
    extractor: Any, image: Image, places: list[tuple[float, float]], size: float, scale: float
) -> dict[int, np.ndarray]:
    """Descriptors by index of the place; places that could not be described are missing."""
    gray = eight_bit(image)
    if scale > 1.0:
        # Averaging before a fixed pattern of points is laid over the whole template.
        smooth = cv2.GaussianBlur(gray, (0, 0), 0.5 * scale)
        shape = (round(gray.shape[1] / scale), round(gray.shape[0] / scale))
        gray = cv2.resize(smooth, shape, interpolation=cv2.INTER_AREA)
    keypoints = [
        cv2.KeyPoint(x / scale, y / scale, size, 0.0, float(index), 0, 0)
        for index, (x, y) in enumerate(places)
    ]
    kept, values = extractor.compute(gray, keypoints)
    if values is None:
        return {}
    return {round(point.response): value for point, value in zip(kept, values, strict=True)}


def eight_bit(image: Image) -> Gray8:
    """Grey values stretched over eight bits."""
    # design: one pixel in a hundred may be brighter or darker than film shows ground: dust and
    # scratches must not compress the rest.
    low, high = (float(v) for v in np.percentile(image[::2, ::2], (0.5, 99.5)))
    # design: keeps the division finite on flat ground.
    stretched = (image - low) * (255.0 / max(high - low, 1e-3))
    return np.clip(np.rint(stretched), 0, 255).astype(np.uint8)
