"""Options and report of an adjustment."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Float64

from core.arrays import Position
from core.block import Block, Measurement, Status
from core.doubts import Doubt
from core.said import say

OUT = say("The photo takes no part in the adjustment.")
"""Why what is measured in such a photo is not used."""
# design: a tenth adds half a per cent to the error of a photo.
SETTLED = 0.1
"""A block has settled when its photos move less than this share of their standard deviations."""


@dataclass(frozen=True, slots=True)
class AdjustmentOptions:
    """A-priori standard deviations and what is estimated; one unit of weight is 1."""

    estimate_cameras: bool = True
    """Estimate principal distance, principal point and k1, k2 of each camera, with priors."""
    # design: what a certificate of an old camera is trusted to; the user can set it.
    sigma_principal_distance_mm: float = 0.05
    """Prior of the principal distance about the certificate, millimetres."""
    # design: as sigma_principal_distance_mm.
    sigma_principal_point_mm: float = 0.1
    """Prior of each coordinate of the principal point, millimetres."""
    # design: lenses of the thirties distort by tens of micrometres.
    sigma_distortion_um: float = 50.0
    """Prior of each radial term's displacement at the corner of the frame, micrometres."""
    robust: bool = True
    """Reweight large residuals (Huber, then data snooping of tie points and automatic control)."""
    # design: ten times the rule.
    max_iterations: int = 50
    """Gauss-Newton steps at most."""
    self_calibration: tuple[str, ...] = ()
    """Additional parameters, sets of `core.geometry.camera.SETS`; none by default."""
    per_photo: bool = False
    """Camera constants and additional parameters of each photo by itself, not of each camera."""
    # design: film bends by ten micrometres, some more by twenty.
    sigma_additional_um: float = 20.0
    """Prior of each additional parameter about nought, micrometres at the edge of the frame."""
    only_significant: bool = True
    """Hold additional parameters at nought that do not stand out or cannot be told apart."""
    gnss_shift: Literal["none", "block", "strip"] = "none"
    """Common shift of the measured perspective centres, of the block or of each strip."""
    gnss_drift: bool = False
    """The shift grows evenly along the block or strip."""
    misalignment: bool = False
    """Common turn between the measured angles and the photos (boresight)."""
    # design: nought leaves the terrain out.
    dem_sigma_m: float = 0.0
    """Standard deviation of the terrain's height as an observation of tie points; 0 leaves it."""
    free_network: bool = False
    """Ties alone decide the block's shape; control only says where it lies (inner constraints)."""
    variance_components: bool = False
    """Estimate the weight of each class of observations from the residuals."""
    test: Literal["w", "tau"] = "w"
    """Test of residuals: against their stated sigmas (Baarda), or estimated ones (Pope)."""
    # source: Baarda 1968.
    risk: float = 0.001
    """Probability that a good coordinate is taken for a gross error."""
    compare_methods: bool = False
    """Whether the protocol has strips and independent models beside the bundle."""

    @property
    def of_cameras(self) -> "AdjustmentOptions":
        """What is said of the cameras alone: control is judged by them as it is adjusted."""
        return AdjustmentOptions(
            estimate_cameras=self.estimate_cameras,
            sigma_principal_distance_mm=self.sigma_principal_distance_mm,
            sigma_principal_point_mm=self.sigma_principal_point_mm,
            sigma_distortion_um=self.sigma_distortion_um,
        )


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
    """Computed coordinates, metres."""
    difference_m: Position
    """Computed minus known, metres; with one photo the height is the known one."""
    used_scans: int
    """Number of photos it was intersected from."""
    sigma_m: Position | None = None
    """Standard deviations the adjustment predicts for the computed coordinates, metres; the known
    ones' own error is not in it. None where it was not computed."""


@dataclass(frozen=True, slots=True, eq=False)
class NewPoint:
    """A point that photos alone determine: an unknown of the adjustment."""

    point_id: str
    """Its name."""
    position: Position
    """Adjusted coordinates, metres."""
    sigma_m: Position
    """Their standard deviations with all that the orientations are unsure of, metres."""
    rays: int
    """Photos whose measurement took part."""
    largest_residual_px: float
    """Length of its largest residual, pixels."""


@dataclass(frozen=True, slots=True)
class Contradiction:
    """One measurement that a human accepted and the rest of the block contradicts."""

    point_id: str
    """The surveyed point."""
    photo_id: str
    """The photo it was measured in."""
    pixels: float
    """How far it lies from where all others put it, pixels of the scan."""
    metres: float
    """The same on the ground, metres."""
    test: float
    """Its length in standard deviations, as if it had been left out."""
    shift_m: float
    """Largest shift of a photo's ground that it brings about, metres; 0 for a check point."""

    @property
    def key(self) -> tuple[str, str]:
        """Point and photo."""
        return self.point_id, self.photo_id


@dataclass(frozen=True, slots=True)
class ClassFigures:
    """One class of observations: how many, how well checked, and how large its residuals are."""

    observations: int
    """Number of coordinates."""
    redundancy: float
    """Sum of their redundancy numbers."""
    weighted_squares: float
    """Sum of squared residuals over a-priori variances."""
    factor: float = 1.0
    """A-priori standard deviations were multiplied by this (variance components)."""

    @property
    def sigma_ratio(self) -> float:
        """Standard deviation its residuals show, over the one used; NaN where nothing checks it."""
        if self.redundancy < 0.5:
            return float("nan")
        return float(np.sqrt(self.weighted_squares / self.redundancy))


@dataclass(frozen=True, slots=True)
class SharedParameter:
    """A value many photos share: a camera constant, an additional parameter, a GNSS shift."""

    owner: str
    """Camera, strip or block it belongs to."""
    name: str
    """`principal_distance_mm`, `x0_mm`, `k1_um`, `ebner_3_um`, `gnss_shift_X_m` and so on."""
    value: float
    """Change against what was known, in the unit its name ends with."""
    sigma: float
    """Standard deviation."""
    test: float
    """Value over standard deviation."""
    correlation: float
    """Largest correlation (with sign) with another shared parameter."""
    partner: str
    """Which one that is."""
    held: bool = False
    """True when it was held at nought because it did not stand out or could not be told apart."""


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
    """Adjusted coordinates of the control points that took part, metres; of a reference that has a
    shift as they are there, shift included."""
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
    tie_reasons: Mapping[int, str] = field(default_factory=dict[int, str])
    """Rays of `block.ties` that were left out as gross errors, with the reason."""
    contradictions: tuple[Contradiction, ...] = ()
    """Measurements accepted by a human that the rest of the block contradicts, worst first."""
    classes: Mapping[str, ClassFigures] = field(default_factory=dict[str, ClassFigures])
    """`tie`, `control_image`, `control_plan`, `control_height`, `dem`, `centre`, `angles`."""
    parameters: tuple[SharedParameter, ...] = ()
    """What cameras and positions turned out to be."""
    doubts: tuple[Doubt, ...] = ()
    """What could not be used; `core/quality/rules.py` judges the block."""
    new_points: tuple[NewPoint, ...] = ()
    """Points from photos that two took part in or more."""
    check_freedom: float = 0.0
    """So many independent errors the independent check points' plan is worth together; at most two
    for each, less where they share what the block is off."""
    condition: float = float("nan")
    """By how much the photos' unknowns at most increase each other's variances; 1 is best."""
    options: AdjustmentOptions | None = None
    """What it was adjusted with; None where an earlier version kept the report."""

    @property
    def unit(self) -> float:
        """What its sigmas are scaled by: sigma nought, 1 where nothing is redundant."""
        return self.sigma_nought if np.isfinite(self.sigma_nought) else 1.0

    def final_status(self, measurement: Measurement) -> tuple[Status, str]:
        """Status and reason of a measurement: what the adjustment left out itself is `unused`."""
        reason = self.rejected.get(measurement.key, "")
        photo = self.block.photos.get(measurement.photo_id)
        if photo is None or not photo.oriented:
            reason = OUT
        if measurement.used and reason:
            return "unused", reason
        return measurement.status, measurement.reason
