"""What an adjustment is asked for, and what it says when it is done."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from core.arrays import Position
from core.block.block import Block


@dataclass(frozen=True, slots=True)
class AdjustmentOptions:
    """A-priori standard deviations and what is estimated; one unit of weight is 1."""

    estimate_cameras: bool = True
    """Estimate principal distance, principal point and k1, k2 of each camera, with priors."""
    sigma_principal_distance_mm: float = 0.05
    """Prior of the principal distance about the certificate, millimetres."""
    sigma_principal_point_mm: float = 0.1
    """Prior of each coordinate of the principal point, millimetres."""
    sigma_distortion_um: float = 50.0
    """Prior of each radial term's displacement at the corner of the frame, micrometres."""
    robust: bool = True
    """Reweight large residuals (Huber, then data snooping of tie points and automatic control)."""
    max_iterations: int = 50
    """Gauss-Newton steps at most."""


@dataclass(frozen=True, slots=True, eq=False)
class ExteriorSigmas:
    """Standard deviations of one photo's exterior orientation."""

    centre_m: Position
    """Easting, northing, height, metres."""
    angles: Position
    """omega, phi, kappa, radians."""


@dataclass(frozen=True, slots=True, eq=False)
class CheckResult:
    """One check point, intersected from the photos that show it; it never took part."""

    point_id: str
    """The surveyed point."""
    position: Position
    """Known coordinates, metres."""
    difference_m: Position
    """Computed minus known, metres; with one photo the height is the known one."""
    used_scans: int
    """Number of photos it was intersected from."""


@dataclass(frozen=True, slots=True, eq=False)
class AdjustmentReport:
    """The adjusted block and every figure about it."""

    block: Block
    """The block with adjusted exterior orientations and camera constants."""
    sigma_nought: float
    """A-posteriori standard deviation of unit weight (1 when residuals are as expected)."""
    redundancy: int
    """Observations minus unknowns."""
    iterations: int
    """Steps taken."""
    converged: bool
    """False when the steps did not become small: the orientations are then the last sound ones."""
    exterior_sigmas: Mapping[str, ExteriorSigmas]
    """By photo."""
    residuals_px: Mapping[tuple[str, str], tuple[float, float]]
    """Residual (column, row) of EVERY measurement of a surveyed point, used or not, pixels,
    computed minus measured; for those not used, the prediction minus the measurement."""
    surveyed_positions: Mapping[str, Position]
    """Adjusted coordinates of the control points that took part, metres."""
    surveyed_sigmas_m: Mapping[str, Position]
    """Their standard deviations, metres."""
    redundancy_numbers: Mapping[tuple[str, str], float]
    """Redundancy number (0 to 1, mean of column and row) of each used control measurement:
    below 0.1 the measurement cannot be checked by any other."""
    tie_positions: Float64[np.ndarray, "points 3"]
    """Adjusted tie points, metres; NaN for those left out."""
    tie_sigmas_m: Float64[np.ndarray, "points 3"]
    """Their standard deviations, metres."""
    tie_residuals_px: Float64[np.ndarray, "rays 2"]
    """Residual of each ray of `block.ties`, pixels; NaN for rays left out."""
    checks: tuple[CheckResult, ...]
    """Check points."""
    rms_px: Mapping[str, float]
    """RMS residual per coordinate by class: `tie`, `control`, `check`, pixels."""
    rms_m: Mapping[str, float]
    """RMS of control and check by coordinate: `control_X`, `check_X` and so on, metres."""
    rejected: Mapping[tuple[str, str], str]
    """Control measurements the adjustment itself left out (gross errors), with the reason."""
