"""Weights found from residuals: variances of classes of observations, and the terrain.

sigma_k^2 = v_k^T P_k v_k / r_k with r_k the sum of the class's redundancy numbers (Foerstner 1979,
Zeitschrift fuer Vermessungswesen 104; METHODS 7.5). The terrain is an observation too: tie points
lie on it, softly, for forests and changes do not.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from jaxtyping import Float64

from core.adjustment.adjusted import ClassFigures
from core.adjustment.factorisation import SIZE
from core.adjustment.gauss_newton import Fit
from core.adjustment.linearised import Linearised
from core.adjustment.network import Network
from core.adjustment.positioning import MEASURED_M, MEASURED_RAD
from core.adjustment.reliability import Precision
from core.arrays import ObjectPoints, Scalars
from core.geometry.robust import robust_sigma

OBSERVED = ("tie", "control_image", "control_plan", "control_height", "dem")
"""Classes sigma nought is taken from: weak priors would only dilute it."""
# design: a variance from six redundant observations is known to about 60 %.
ENOUGH = 6.0
"""A class with less redundancy keeps its weight: its residuals say too little."""
# design: iterated, so that a larger change only takes another round.
MOST_CHANGE = 5.0
"""A weight is never changed by more than this factor at once."""
Terrain = Callable[[ObjectPoints], Scalars]
"""Heights (metres) of the ground at object points, whatever height these have; NaN outside."""
# design: ground within two standard deviations is terrain as a rule, forest is beyond.
LIMIT = 2.0
"""At this many standard deviations off the terrain a point has a quarter of its weight."""


def classes_of(network: Network, fit: Fit, precision: Precision) -> dict[str, ClassFigures]:
    """Figures of every class that has observations."""
    found = {**_rays(network, fit, precision), **_ground(network, fit, precision)}
    return {**found, **_positions(network, fit.lin, precision)}


def _rays(network: Network, fit: Fit, precision: Precision) -> dict[str, ClassFigures]:
    """Rays of tie points and of control points."""
    control = network.rays.measurement >= 0
    squares = np.sum(fit.lin.residuals**2, axis=0) * fit.weights
    checked = np.sum(1 - fit.weights * precision.rays, axis=0)
    classes: dict[str, ClassFigures] = {}
    for name, members in (("tie", ~control), ("control_image", control)):
        used = members & fit.taking_part
        if used.any():
            classes[name] = ClassFigures(
                2 * int(used.sum()), float(checked[used].sum()), float(squares[used].sum())
            )
    return classes


def _ground(network: Network, fit: Fit, precision: Precision) -> dict[str, ClassFigures]:
    """Known coordinates of control points, and of tie points on the terrain."""
    points = network.points
    alive = np.bincount(network.rays.point[fit.taking_part], minlength=points.count) > 0
    known = (points.known_weight > 0) & alive[:, None]
    # A point that lost all its rays may have no variance: it does not count.
    checked = 1 - np.where(known, precision.known, 0.0) * points.known_weight**2
    control = np.arange(points.count) >= len(points.tie)
    plan = np.array([True, True, False])
    classes: dict[str, ClassFigures] = {}
    for name, rows, columns in (
        ("control_plan", control, plan),
        ("control_height", control, ~plan),
        ("dem", ~control, ~plan),
    ):
        used = known & rows[:, None] & columns
        if used.any():
            classes[name] = ClassFigures(
                int(used.sum()),
                float(checked[used].sum()),
                float(np.sum(fit.lin.ground[used] ** 2)),
            )
    return classes


def _positions(network: Network, lin: Linearised, precision: Precision) -> dict[str, ClassFigures]:
    """Perspective centres and angles that were measured in flight."""
    priors, first = network.priors, network.pointed
    identity = np.broadcast_to(np.eye(3), (len(network.photos), 3, 3))
    classes: dict[str, ClassFigures] = {}
    # Three coordinates, then three angles.
    for name, own, by_own, by_shared, residuals, measured in (
        (
            "centre",
            slice(0, 3),
            identity * priors.centre_weights[:, :, None],
            lin.centres_by_positioning,
            lin.centres,
            (priors.centre_weights >= 1 / MEASURED_M).all(axis=1),
        ),
        (
            "angles",
            slice(3, SIZE),
            lin.angles_by_rotation,
            lin.angles_by_positioning,
            lin.angles,
            (priors.angle_weights >= 1 / MEASURED_RAD).all(axis=1),
        ),
    ):
        if measured.any():
            mixed = precision.mixed[:, own, first:]
            cofactors = _quadratic(by_own, precision.photos[:, own, own])
            cofactors += 2 * np.einsum("pij,pjk,pik->pi", by_own, mixed, by_shared)
            cofactors += _quadratic(by_shared, precision.constants[None, first:, first:])
            classes[name] = ClassFigures(
                3 * int(measured.sum()),
                float(np.sum((1 - cofactors)[measured])),
                float(np.sum(residuals[measured] ** 2)),
            )
    return classes


def _quadratic(
    design: Float64[np.ndarray, "photos 3 n"], cofactors: Float64[np.ndarray, "many n n"]
) -> Float64[np.ndarray, "photos 3"]:
    """Diagonals of design x cofactors x design^T."""
    return np.sum((design @ cofactors) * design, axis=2)


def reweight(network: Network, factors: Mapping[str, float]) -> Network:
    """The network with every class's standard deviations multiplied by its factor."""
    rays, points, priors = network.rays, network.points, network.priors
    control = rays.measurement >= 0
    of_ray = np.where(control, factors.get("control_image", 1.0), factors.get("tie", 1.0))
    weight = points.known_weight.copy()
    first = len(points.tie)
    weight[first:, :2] /= factors.get("control_plan", 1.0)
    weight[first:, 2] /= factors.get("control_height", 1.0)
    weight[:first, 2] /= factors.get("dem", 1.0)
    centres, angles = priors.centre_weights.copy(), priors.angle_weights.copy()
    centres[(centres >= 1 / MEASURED_M).all(axis=1)] /= factors.get("centre", 1.0)
    angles[(angles >= 1 / MEASURED_RAD).all(axis=1)] /= factors.get("angles", 1.0)
    return replace(
        network,
        rays=replace(rays, sigma_mm=rays.sigma_mm * of_ray),
        points=replace(points, known_weight=weight),
        priors=replace(priors, centre_weights=centres, angle_weights=angles),
    )


def next_factors(classes: Mapping[str, ClassFigures]) -> dict[str, float]:
    """Factors by which each class's standard deviations are to change."""
    return {
        name: float(np.clip(figures.sigma_ratio, 1 / MOST_CHANGE, MOST_CHANGE))
        if figures.redundancy >= ENOUGH and figures.weighted_squares > 0
        else 1.0
        for name, figures in classes.items()
    }


def observe_terrain(network: Network, fit: Fit, terrain: Terrain, sigma_m: float) -> Network:
    """The network with the terrain's heights at the tie points as observations.

    Heights are those under the present positions; the adjustment repeats this until they no
    longer move.

    Args:
        network: The network.
        fit: Where the points are now.
        terrain: Heights of the ground.
        sigma_m: Standard deviation of the difference between a tie point and the terrain, metres.
    """
    ties = len(network.points.tie)
    known, weight = network.points.known.copy(), network.points.known_weight.copy()
    heights = terrain(fit.state.points[:ties])
    off = np.abs(fit.state.points[:ties, 2] - heights) / sigma_m
    # Geman and McClure: what stands far off, as a forest does, has no say at all; but the limit is
    # wide as long as the block as a whole is off.
    limit = LIMIT * max(1.0, robust_sigma(off))
    soft = 1 / (1 + (np.nan_to_num(off, nan=np.inf) / limit) ** 2)
    known[:ties, 2] = np.nan_to_num(heights)
    weight[:ties, 2] = np.where(np.isfinite(heights), soft / sigma_m, 0.0)
    return replace(network, points=replace(network.points, known=known, known_weight=weight))
