"""Tests of shared unknowns: which are significant, and which cannot be separated."""

import numpy as np
from jaxtyping import Float64

from core.adjustment.adjusted import SharedParameter
from core.adjustment.network import CONSTANTS, Network, State
from core.adjustment.reliability import Precision
from core.geometry.robust import TINY

# design: one in 370 by chance, of a dozen parameters.
SIGNIFICANT = 3.0
"""An additional parameter stays when it is at least this many standard deviations from nought."""
# design: one takes up 80 % of the other's variance.
SAME = 0.9
"""Two parameters that are correlated more closely than this cannot be told apart."""
FLYING_HEIGHT = "flying height"
"""Partner of a principal distance that is exchanged for it."""
CONSTANT_NAMES = ("principal_distance_mm", "x0_mm", "y0_mm", "k1_um", "k2_um")
"""Names of a camera's constants; k1 and k2 as displacement at the corner of the frame."""


def insignificant(
    network: Network, state: State, precision: Precision, held: tuple[int, ...]
) -> tuple[int, ...]:
    """Additional parameters to hold at nought next: of each camera the least significant half.

    Of two that cannot be told apart the less significant goes.
    """
    values, sigmas, correlations = _figures(network, state, precision)
    scale = sigma_for_tests(network, sigmas)
    test = np.abs(values) / scale
    drop: list[int] = []
    for camera in range(len(network.cameras)):
        first = camera * network.lens
        own = [n for n in range(first + CONSTANTS, first + network.lens) if n not in held]
        weak = sorted((n for n in own if test[n] < SIGNIFICANT), key=lambda n: test[n])
        drop += weak[: max(1, len(weak) // 2)] if weak else _doubles(own, test, correlations)
    return tuple(drop)


def sigma_for_tests(
    network: Network, sigmas: Float64[np.ndarray, "shared"]
) -> Float64[np.ndarray, "shared"]:
    """Standard deviations the parameters would show if their true values were nought."""
    prior = 1 / network.priors.constant_weights.ravel()[: network.lensed]
    own = sigmas[: network.lensed]
    # An estimate with a prior of deviation p about nought is drawn to nought by K = 1 - (own/p)^2;
    # where its true value is nought its deviation is own sqrt(K). K of nought: nothing is known.
    drawn = np.maximum(1 - (own / prior) ** 2, 0.0)
    # design: less than a percent of the prior's variance says nothing.
    told = np.where(drawn > 0.01, own * np.sqrt(drawn), np.inf)
    return np.append(told, sigmas[network.lensed :])


def _doubles(
    own: list[int],
    test: Float64[np.ndarray, "shared"],
    correlations: Float64[np.ndarray, "shared shared"],
) -> list[int]:
    """The weaker of the two most closely correlated, if they are too close."""
    close = [
        (abs(float(correlations[one, other])), one, other)
        for one in own
        for other in range(len(test))
        if one != other and abs(correlations[one, other]) > SAME
    ]
    if not close:
        return []
    _, one, other = max(close)
    return [min((n for n in (one, other) if n in own), key=lambda n: test[n])]


def shared_parameters(
    network: Network,
    state: State,
    precision: Precision,
    held: tuple[int, ...],
    *,
    sigma_nought: float,
) -> tuple[SharedParameter, ...]:
    """Every shared unknown with its standard deviation, test and largest correlation."""
    values, sigmas, correlations = _figures(network, state, precision)
    owners, names, units = _names(network)
    parameters: list[SharedParameter] = []
    off = np.abs(correlations - np.eye(len(names)))
    heights = _with_heights(network, precision, sigmas)
    for row, (owner, name, unit) in enumerate(zip(owners, names, units, strict=True)):
        partner = int(np.argmax(off[row])) if len(names) > 1 else row
        sigma = sigma_nought * float(sigmas[row])
        correlation = float(correlations[row, partner]) if partner != row else 0.0
        other = (
            names[partner] if owners[partner] == owner else f"{names[partner]} {owners[partner]}"
        )
        if abs(heights.get(row, 0.0)) > abs(correlation):
            correlation, other = heights[row], FLYING_HEIGHT
        parameters.append(
            SharedParameter(
                owner,
                name,
                float(values[row]) * unit,
                sigma * unit,
                0.0 if row in held else float(values[row]) / max(sigma, TINY),
                correlation,
                other,
                row in held,
            )
        )
    return tuple(parameters)


def _with_heights(
    network: Network, precision: Precision, sigmas: Float64[np.ndarray, "shared"]
) -> dict[int, float]:
    """Largest correlation of each principal distance with the flying height of one of its photos.

    Over level ground, or in one photo, they are exchanged for one another.
    """
    found: dict[int, float] = {}
    for camera in range(len(network.cameras) if network.lensed else 0):
        row, photos = camera * network.lens, np.flatnonzero(network.camera == camera)
        own = np.sqrt(precision.photos[photos, 2, 2]) * sigmas[row]
        # design: keeps a division from failing.
        every = precision.mixed[photos, 2, row] / np.maximum(own, TINY)
        found[row] = float(every[np.argmax(np.abs(every))])
    return found


def _figures(
    network: Network, state: State, precision: Precision
) -> tuple[
    Float64[np.ndarray, "shared"],
    Float64[np.ndarray, "shared"],
    Float64[np.ndarray, "shared shared"],
]:
    """Values (millimetres at the corner, metres, radians), cofactors' roots and correlations."""
    known = (state.constants - network.priors.constants)[:, :CONSTANTS]
    lens = np.concatenate([known, state.additional], axis=1) * network.scale
    values = np.concatenate([lens.ravel()[: network.lensed], state.shifts, state.positioning])
    sigmas = np.sqrt(np.diag(precision.constants))
    scale = np.outer(sigmas, sigmas)
    return values, sigmas, precision.constants / np.where(scale > 0, scale, 1.0)


def _names(network: Network) -> tuple[list[str], list[str], list[float]]:
    """Owner, name with unit, and factor to that unit of every shared unknown."""
    owners: list[str] = []
    names: list[str] = []
    units: list[float] = []
    if network.lensed:
        more = [f"{name}_um" for name in network.additional.names]
        for camera in network.camera_names:
            owners += [camera] * network.lens
            names += [*CONSTANT_NAMES, *more]
            units += [1.0, 1.0, 1.0, 1000.0, 1000.0] + [1000.0] * len(more)
    for more in (network.points.shifts, network.positioning):
        owners += more.owners
        names += more.names
        units += [float(np.degrees(1.0)) if n.endswith("_deg") else 1.0 for n in more.names]
    return owners, names, units
