"""The middle of a mark by its outline, for marks that have no symmetry.

Along every piece of the drawn outline the scan's own step of gray is looked for on the normal; the
shift (and the growth of the mark by exposure) that brings the outline onto the steps is solved for
with the influence of dirt bounded. It compares places of edges, where matching compares grays.

A step's place is that of its steepest part, or that at which the gray is half way between what lies
on its two sides: the first is blind to how bright the picture beside a notch is, the second to the
noise of single pixels.
"""

import numpy as np
from jaxtyping import Float64
from scipy.ndimage import map_coordinates

from core.doubts import Failure
from core.geometry.robust import robust_sigma
from core.scans.centring import Centre, Gray, Weights, softened

REACH_PX = 3.0
"""How far from the drawn outline a step is looked for, pixels."""
FAR_PX = 5.0
"""The same while the mark is still being approached."""
STEP_PX = 0.25
TIP_PX = 12.0
"""Outline this near to the tip of a notch is not used, pixels: there a narrow notch is no wider
than its two edges are blurred."""
STEP_HALF_PX = 2.5
"""Half width of a step under blur, pixels."""
SIDE_PX = 5.0
"""How far on either side of a step its gray is looked at, pixels."""
ROUNDS = 6
MIN_EDGES = 24
"""Fewer pieces of outline than this say nothing."""
STEEP = 0.5
"""Share of the steepest drawn slope from which a pixel belongs to the outline."""
Points = Float64[np.ndarray, "edges 2"]


def centre_by_edges(
    window: Gray,
    template: Weights,
    weights: Weights,
    start: tuple[float, float],
    limit_px: float,
    grows: bool = True,
    half_way: bool = False,
) -> Centre | Failure:
    """The place at which the drawn outline lies on the scan's steps of gray.

    Args:
        window: Part of the scan, without NaN.
        template: The drawn mark, 1 where the scan is brighter; its middle is that of its middle
            pixel.
        weights: Weight of each template pixel.
        start: Approximate middle (column, row) in the window, pixels.
        limit_px: How far from the start the middle may be.
        grows: Solve for growth too; impossible where all edges meet in one point, as in a notch.
        half_way: Take the place of half the step instead of its steepest part.
    """
    window, template = softened(window).astype(np.float32), softened(template)
    points, normals = _outline(template, weights, half_way)
    if not grows:
        # About the tip itself both edges run into each other.
        away = np.hypot(points[:, 0], points[:, 1]) > TIP_PX
        points, normals = points[away], normals[away]
    if len(points) < MIN_EDGES:
        return Failure("The mark has too little outline in the window.")
    place, sigma, share = np.array(start, dtype=np.float64), np.nan, 0.0
    for step_number in range(ROUNDS):
        reach = FAR_PX if step_number < 2 else REACH_PX
        offsets, height = _steps(window, points + place, normals, half_way, reach)
        sure = height > 0
        if sure.sum() < MIN_EDGES:
            return Failure("The mark's outline is not there.")
        design = np.column_stack([normals, np.full(len(normals), float(grows))])[sure]
        step, sigma = _robust(design, offsets[sure], height[sure])
        share = float(sure.mean())
        place = place + np.clip(step[:2], -1.0, 1.0)
        if np.linalg.norm(place - np.array(start)) > limit_px:
            return Failure("The outline lies elsewhere.")
        if np.abs(step[:2]).max() < 2e-3:
            break
    return Centre(float(place[0]), float(place[1]), sigma, share)


def _outline(template: Weights, weights: Weights, half_way: bool) -> tuple[Points, Points]:
    """Places (from the middle) and unit normals, towards the bright side, of the drawn outline."""
    half = template.shape[0] // 2
    right, down = np.gradient(template, axis=1), np.gradient(template, axis=0)
    steep = np.hypot(right, down)
    used = (steep > STEEP * steep.max()) & (weights > 0.5)
    margin = int(REACH_PX)
    used[:margin] = used[-margin:] = used[:, :margin] = used[:, -margin:] = False
    rows, columns = np.nonzero(used)
    normals = np.column_stack([right[used], down[used]]) / steep[used][:, None]
    points = np.column_stack([columns - half, rows - half]).astype(np.float64)
    # To the place on the normal where the drawn step itself is: the same measure on both sides.
    offsets, height = _steps(template.astype(np.float32), points + half + 0.5, normals, half_way)
    sure = height > 0
    return (points + offsets[:, None] * normals)[sure], normals[sure]


def _steps(
    window: Gray, points: Points, normals: Points, half_way: bool, reach: float = REACH_PX
) -> tuple[Float64[np.ndarray, "edges"], Float64[np.ndarray, "edges"]]:
    """How far along its normal each step lies, and its height over the usual; 0 if not seen."""
    along = np.arange(-reach - 2.0, reach + 2.0 + STEP_PX / 2, STEP_PX)
    columns = points[:, :1] + normals[:, :1] * along - 0.5
    rows = points[:, 1:] + normals[:, 1:] * along - 0.5
    # `cv2.remap` knows only 32 places within a pixel.
    profile = map_coordinates(window, [rows, columns], np.float64, order=3, mode="nearest")
    slope = np.maximum(np.diff(profile, axis=1), 0.0)
    middle = (along[1:] + along[:-1]) / 2
    # Nearness decides between the two sides of a thin line.
    near = slope * np.exp(-0.5 * (middle / (0.45 * reach)) ** 2)
    place = middle[near.argmax(axis=1)]
    total = np.zeros(len(points))
    for _ in range(3):
        # The window pulls the centroid towards its own middle: until both are the same.
        around = np.exp(-0.5 * ((middle[None, :] - place[:, None]) / 0.7) ** 2) * slope
        total = around.sum(axis=1)
        place = (around * middle).sum(axis=1) / np.maximum(total, 1e-9)
    height = total / max(float(np.median(total)), 1e-9) if len(total) else total
    if half_way:
        # The stretch that is looked at has its middle where the step was taken to be.
        for _ in range(2):
            place = _half_way(profile, along, place)
    return place, np.where((height > 0.3) & (np.abs(place) < reach - 0.5), height, 0.0)


def _half_way(
    profile: Float64[np.ndarray, "edges samples"],
    along: Float64[np.ndarray, "samples"],
    place: Float64[np.ndarray, "edges"],
) -> Float64[np.ndarray, "edges"]:
    """Where each profile is half way between the grays on both sides of its step.

    The gray of each side is continued to the step as a straight line: beside a notch the picture
    brightens or darkens, which moves the steepest place and would move the half way too.
    """
    apart = along[None, :] - place[:, None]
    low = _continued(profile, apart, (apart < -STEP_HALF_PX) & (apart > -SIDE_PX))
    high = _continued(profile, apart, (apart > STEP_HALF_PX) & (apart < SIDE_PX))
    share = (profile - low) / np.maximum(high - low, 1e-3)
    # The share of the samples about the step that is still dark is where the step lies.
    about = np.abs(apart) <= STEP_HALF_PX
    dark = np.where(about, np.clip(1 - share, -0.2, 1.2), 0.0).sum(axis=1)
    left = np.where(about, along[None, :], np.inf).min(axis=1)
    return left + (dark - 0.5) * (along[1] - along[0])


def _continued(
    profile: Float64[np.ndarray, "edges samples"],
    apart: Float64[np.ndarray, "edges samples"],
    side: np.ndarray,
) -> Float64[np.ndarray, "edges samples"]:
    """The straight line through the samples of one side, at all samples."""
    count = np.maximum(side.sum(axis=1, keepdims=True), 1)
    middle = np.where(side, apart, 0.0).sum(axis=1, keepdims=True) / count
    level = np.where(side, profile, 0.0).sum(axis=1, keepdims=True) / count
    spread = np.where(side, (apart - middle) ** 2, 0.0).sum(axis=1, keepdims=True)
    slope = np.where(side, (apart - middle) * (profile - level), 0.0).sum(axis=1, keepdims=True)
    return level + slope / np.maximum(spread, 1e-9) * (apart - middle)


def _robust(
    design: Float64[np.ndarray, "edges 3"],
    offsets: Float64[np.ndarray, "edges"],
    height: Float64[np.ndarray, "edges"],
) -> tuple[Float64[np.ndarray, "3"], float]:
    """Shift and growth with Huber's bound; sigma of the shift per axis.

    Neighbouring pixels share their blur and grain: about two of them make one independent edge.
    """
    solution = np.zeros(3)
    # Noise and texture move a low step more than a high one.
    base = np.clip(height, 0.3, 2.0) ** 2
    weight = base
    for _ in range(8):
        normal = (design * weight[:, None]).T @ design + 1e-9 * np.eye(3)
        solution = np.linalg.solve(normal, (design * weight[:, None]).T @ offsets)
        residual = offsets - design @ solution
        spread = robust_sigma(residual) + 0.01
        weight = base / (1 + (residual / (3 * spread)) ** 2) ** 2
    residual = offsets - design @ solution
    freedom = max(weight.sum() / 2 - 3, 1.0)
    variance = float(np.sum(weight * residual**2)) / 2 / freedom
    cofactor = np.linalg.inv((design * weight[:, None]).T @ design + 1e-9 * np.eye(3)) * 2
    return solution, float(np.sqrt(variance * np.trace(cofactor[:2, :2]) / 2))
