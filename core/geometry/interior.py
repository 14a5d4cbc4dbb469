"""Interior orientation: pixel <-> film of one scan, with the residual of every fiducial."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from jaxtyping import Float64
from scipy.special import chdtrc, fdtrc

from core.arrays import Affine2, FilmPoints, Matrix, PixelPoints, Scalars, locked
from core.doubts import Failure
from core.geometry.camera import Camera
from core.geometry.interior_models import (
    FilmFit,
    Warp,
    film_slopes,
    fit_film,
    unwarp_film,
    warp_film,
)
from core.geometry.robust import TINY
from core.geometry.transforms import PARAMETERS, PlaneTransform, fit_similarity
from core.said import say

InteriorModel = Literal["similarity", "affine", "projective", "bilinear", "nominal"]
FittedModel = Literal["auto", "similarity", "affine", "projective", "bilinear"]


def _none() -> Warp:
    return np.zeros(2)


def _unknown() -> Matrix:
    return np.full((8, 8), np.nan)


@dataclass(frozen=True, slots=True, eq=False)
class InteriorOrientation:
    """The transform of one scan; nothing is resampled or cropped, measurements stay in pixels."""

    model: InteriorModel
    """`nominal` where no fiducials are known: scan middle and scan pixel size."""
    film_from_pixel_matrix: Affine2
    """2 x 3: film mm from pixel (column, row); the affine part of a projective or bilinear one."""
    names: tuple[str, ...]
    """Names of the fiducials that were used, in the order of the arrays below."""
    pixels: PixelPoints
    """Where the fiducials were measured, pixels."""
    residuals_um: FilmPoints
    """Residual of each fiducial on the film (x, y), computed minus certified, micrometres."""
    sigma_um: float
    """A-posteriori sigma of one film coordinate, micrometres; NaN without redundancy."""
    warp: Warp = field(default_factory=_none)
    """The two parameters beyond the affine part, per millimetre; see `interior_models`."""
    covariance: Matrix = field(default_factory=_unknown)
    """8 x 8, of the matrix (row by row) and the warp, mm; NaN where nothing was fitted."""
    redundancy: int = 0
    """Equations of the fiducials minus parameters of the model."""
    variance_factor: float = float("nan")
    """Weighted square sum over redundancy, against the sigmas the marks were measured with."""

    def __post_init__(self) -> None:
        for name in ("film_from_pixel_matrix", "pixels", "residuals_um", "warp", "covariance"):
            object.__setattr__(self, name, locked(getattr(self, name)))

    def film_from_pixel(self, pixels: PixelPoints) -> FilmPoints:
        """Film points in millimetres of scan pixels."""
        matrix = self.film_from_pixel_matrix
        return warp_film(pixels @ matrix[:, :2].T + matrix[:, 2], self.warp, self.model)

    def pixel_from_film(self, film: FilmPoints) -> PixelPoints:
        """Scan pixels of film points in millimetres."""
        matrix = self.film_from_pixel_matrix
        flat = unwarp_film(film, self.warp, self.model)
        return np.linalg.solve(matrix[:, :2], (flat - matrix[:, 2]).T).T

    def film_by_pixel(self, pixels: PixelPoints) -> Float64[np.ndarray, "n 2 2"]:
        """Derivatives of the film point (rows) by the scan pixel (columns), millimetres."""
        matrix = self.film_from_pixel_matrix
        slopes = film_slopes(pixels, matrix, self.warp, self.model).reshape(-1, 2, 8)
        return slopes[:, :, [2, 5]] @ matrix[:, :2]

    def film_sigmas(self, pixels: PixelPoints) -> FilmPoints:
        """Standard deviation (x, y) of film points that follows from the fit alone, mm."""
        slopes = film_slopes(pixels, self.film_from_pixel_matrix, self.warp, self.model)
        variance = np.einsum("ij,jk,ik->i", slopes, self.covariance, slopes)
        return np.sqrt(variance).reshape(-1, 2)

    @property
    def pixel_size_mm(self) -> float:
        """Mean size of a scan pixel on the film, millimetres."""
        return float(np.sqrt(abs(np.linalg.det(self.film_from_pixel_matrix[:, :2]))))

    @property
    def mirrored(self) -> bool:
        """True when the film was scanned from its back."""
        return bool(np.linalg.det(self.film_from_pixel_matrix[:, :2]) > 0)

    @property
    def rms_um(self) -> float:
        """Root mean square of the fiducial residuals per coordinate, micrometres (0 if none)."""
        return float(np.sqrt(np.mean(self.residuals_um**2))) if len(self.names) else 0.0

    @property
    def chance(self) -> float:
        """Probability of residuals as large by the marks' own sigmas (chi-square); 1 if untested.

        Film is never quite as its camera was: a small chance tells of film, not of a mistake.
        """
        if not self.redundancy:
            return 1.0
        return float(chdtrc(self.redundancy, self.variance_factor * self.redundancy))

    def with_variance_factor(self, factor: float) -> "InteriorOrientation":
        """The same with sigmas from a factor that was pooled over all photos of a camera."""
        own = self.variance_factor if self.redundancy else 1.0
        change = max(factor, 1.0) / max(own, 1.0)
        return replace(self, covariance=self.covariance * change)


def plain_similarity(interior: InteriorOrientation) -> PlaneTransform | Failure:
    """Film mm from pixel by shift, turn and one scale on the same marks.

    What the interior orientation adds to it, and what it leaves, is the film's own shape.
    """
    certified = interior.film_from_pixel(interior.pixels) - interior.residuals_um / 1000
    return fit_similarity(interior.pixels, certified, mirrored=not interior.mirrored)


@dataclass(frozen=True, slots=True)
class FilmShape:
    """How a film differs from its camera's certificate and the scanner's nominal pixel."""

    scale_x: float
    """Length of the film along x over the certified one."""
    scale_y: float
    """Length along y over the certified one."""
    shear_mrad: float
    """How much less than a right angle lies between the two, milliradians."""


def film_shape(interior: InteriorOrientation, scan_pixel_mm: float) -> FilmShape:
    """Shrinkage and shear of the film that the interior orientation took up (METHODS 2).

    Args:
        interior: A fitted interior orientation.
        scan_pixel_mm: Nominal size of a scan pixel, millimetres: a scanner's own scale error
            cannot be told from the film's.
    """
    pixel_from_film = np.linalg.inv(interior.film_from_pixel_matrix[:, :2]) * scan_pixel_mm
    along_x, along_y = pixel_from_film.T
    length_x, length_y = float(np.linalg.norm(along_x)), float(np.linalg.norm(along_y))
    slant = float(along_x @ along_y) / (length_x * length_y)
    return FilmShape(length_x, length_y, 1000 * float(np.arcsin(slant)))


# design: film shrunk evenly fits to 10 um, two pixels of a usual scan are 30.
LIMIT_UM = 30.0
"""A fit whose residuals have a greater RMS (scan pixels up to 15 um) does not stand, METHODS 2."""
# design: a mark is measured to a tenth; two pixels are another place.
LIMIT_PX = 2.0
"""The same limit in scan pixels, for coarser scans."""
# design: a wrong mark makes the most of the RMS, two thirds of it go with it.
CLEARED = 0.35
"""Leaving a mark out must bring the RMS down to this share before the mark counts as wrong."""
# design: what a symmetric mark is measured to.
USUAL_SIGMA_PX = 0.1
"""A-priori sigma of a mark whose own is not known, pixels."""
# design: to a ten millionth of the first interval.
FILM_STEPS = 24
"""Halvings in the search for how much film and scanner are bent."""
# design: in the words below.
BENT_CHANCE = 0.1
"""Chance below which residuals are laid to bends of film and scanner: those of good marks alone
exceed what is expected of them in every second film."""
# source: as Baarda's risk.
WARP_CHANCE = 0.001
"""Chance below which eight marks or more call for a warp beyond an affine film."""


def fit_interior(
    names: Sequence[str],
    pixels: PixelPoints,
    certified_mm: FilmPoints,
    model: FittedModel = "auto",
    *,
    sigmas_px: Scalars | None = None,
    mirrored: bool = False,
) -> InteriorOrientation | Failure:
    """Interior orientation from measured fiducials; wrong marks are left out while enough remain.

    A similarity, which has redundancy enough, finds the wrong mark; then an affine is fitted where
    four marks or more remain, and a projective or bilinear one where eight show that the film is
    bent beyond it (unless `model` says otherwise). `names` of the result tells who was used.

    Args:
        names: Names of the measured fiducials.
        pixels: Where they were measured.
        certified_mm: Where the certificate puts them on the film.
        model: `auto`, or the model to fit.
        sigmas_px: Standard deviation of each per axis, pixels.
        mirrored: True when the film was scanned from its back.

    Returns:
        The interior orientation; a failure when the residuals exceed max(30 um, 2 pixels) RMS.
    """
    similarity = fit_similarity(pixels, certified_mm, mirrored=not mirrored)
    if isinstance(similarity, Failure):
        return similarity
    own = np.full(len(pixels), USUAL_SIGMA_PX) if sigmas_px is None else sigmas_px
    sigmas = own * similarity.scale
    keep = _keep_marks(pixels, certified_mm, similarity, mirrored)
    fit = _fit(pixels[keep], certified_mm[keep], sigmas[keep], model, mirrored)
    if isinstance(fit, Failure):
        return fit
    factor = fit.weighted_square_sum / fit.redundancy if fit.redundancy else float("nan")
    fit = _with_film(fit, pixels[keep], certified_mm[keep], sigmas[keep], mirrored=mirrored)
    interior = _interior(fit, factor, tuple(np.array(names)[keep].tolist()), pixels[keep])
    if interior.rms_um > limit_um(interior.pixel_size_mm):
        return Failure(
            say(
                "The fiducials do not fit their certificate: RMS {rms_um:.0f} µm.",
                rms_um=interior.rms_um,
            ),
            {
                "rms_um": interior.rms_um,
                "residuals_um": dict(
                    zip(interior.names, interior.residuals_um.tolist(), strict=True)
                ),
            },
        )
    return interior


def limit_um(pixel_mm: float) -> float:
    """Greatest RMS of fiducial residuals that stands, micrometres, for a scan pixel size in mm."""
    return max(LIMIT_UM, LIMIT_PX * pixel_mm * 1000)


def nominal_interior(
    size_px: tuple[int, int],
    camera: Camera,
    scan_pixel_mm: float,
    frame_px: PixelPoints | None = None,
) -> InteriorOrientation:
    """Interior orientation without fiducials: scan pixel size, and the frame or the scan's middle.

    Args:
        size_px: Columns and rows of the scan.
        camera: Camera with the size of its frame.
        scan_pixel_mm: Nominal size of a scan pixel, millimetres.
        frame_px: The four corners of the picture area where its border was seen, in the order of
            `camera.frame_corners_mm`; they then give position and rotation, never the scale.
    """
    turn, middle = 0.0, np.array(size_px, dtype=np.float64) / 2
    if frame_px is not None:
        middle = frame_px.mean(axis=0)
        fit = fit_similarity(frame_px, camera.frame_corners_mm, mirrored=True)
        if isinstance(fit, PlaneTransform):
            turn = float(np.arctan2(fit.matrix[1, 0], fit.matrix[0, 0]))
    elif _stands_upright(size_px, camera.frame_mm) is False:
        turn = np.pi / 2
    linear = scan_pixel_mm * np.array([[np.cos(turn), np.sin(turn)], [np.sin(turn), -np.cos(turn)]])
    nobody = np.zeros((0, 2))
    matrix = np.column_stack([linear, -linear @ middle])
    return InteriorOrientation("nominal", matrix, (), nobody, nobody, float("nan"))


def _stands_upright(size_px: tuple[int, int], frame_mm: tuple[float, float]) -> bool:
    """False when an oblong frame lies across an oblong scan."""
    across = (size_px[0] - size_px[1]) * (frame_mm[0] - frame_mm[1])
    # design: frames nominally square differ by a twentieth in a scan.
    return across >= -0.05 * min(size_px) * min(frame_mm)


def _fit(
    pixels: PixelPoints, film: FilmPoints, sigmas_mm: Scalars, model: FittedModel, mirrored: bool
) -> FilmFit | Failure:
    """The model asked for, or the largest that the marks' number and residuals call for."""
    if model != "auto":
        return fit_film(model, pixels, film, sigmas_mm, mirrored=mirrored)
    plain = "affine" if len(pixels) >= 4 else "similarity"
    best = fit_film(plain, pixels, film, sigmas_mm, mirrored=mirrored)
    # As many marks as parameters leave as many equations to judge them by.
    if isinstance(best, Failure) or len(pixels) < PARAMETERS["projective"]:
        return best
    affine = best
    for larger in ("projective", "bilinear"):
        fit = fit_film(larger, pixels, film, sigmas_mm, mirrored=mirrored)
        if isinstance(fit, FilmFit) and _calls_for(affine, fit):
            best = fit if fit.rms < best.rms else best
    return best


def _with_film(
    fit: FilmFit, pixels: PixelPoints, film: FilmPoints, sigmas_mm: Scalars, *, mirrored: bool
) -> FilmFit:
    """The fit with what the marks' own sigmas do not explain laid to film and scanner.

    Their bends are the same for a mark that was measured well and one that was measured less well,
    so they are added to all variances alike, as large as makes the weighted square sum what chance
    would give; a factor on the variances would have the best measured marks carry the fit.
    """
    best = fit
    if fit.redundancy < 1:
        return best
    if chdtrc(fit.redundancy, fit.weighted_square_sum) > BENT_CHANCE:
        return best
    least, most = 0.0, 2 * fit.sigma + float(sigmas_mm.max())
    for _ in range(FILM_STEPS):
        bends = (least + most) / 2
        trial = fit_film(fit.model, pixels, film, np.hypot(sigmas_mm, bends), mirrored=mirrored)
        if isinstance(trial, Failure):
            return best
        best = trial
        if trial.weighted_square_sum > trial.redundancy:
            least = bends
        else:
            most = bends
    return best


def _calls_for(affine: FilmFit, larger: FilmFit) -> bool:
    """F-test of two more parameters."""
    left, gained = larger.weighted_square_sum, affine.weighted_square_sum
    ratio = (gained - left) / 2 / max(left / larger.redundancy, TINY)
    return bool(fdtrc(2, larger.redundancy, ratio) < WARP_CHANCE)


def _keep_marks(
    pixels: PixelPoints, film: FilmPoints, similarity: PlaneTransform, mirrored: bool
) -> np.ndarray:
    """Flags of the marks to use: without those whose absence heals the similarity."""
    keep = np.ones(len(pixels), dtype=bool)
    rms_um = similarity.rms * 1000
    while keep.sum() >= 4 and rms_um > limit_um(similarity.scale):
        without: dict[int, float] = {}
        for left_out in np.flatnonzero(keep).tolist():
            rest = keep & (np.arange(len(pixels)) != left_out)
            fit = fit_similarity(pixels[rest], film[rest], mirrored=not mirrored)
            without[left_out] = np.inf if isinstance(fit, Failure) else fit.rms * 1000
        wrong = min(without, key=without.__getitem__)
        # Two wrong marks of many only heal together: half the way counts where many remain.
        # design: words above; of seven one left out leaves twelve equations.
        needed = CLEARED if keep.sum() < 7 else 0.75
        if without[wrong] > needed * rms_um:
            break
        keep[wrong], rms_um = False, without[wrong]
    return keep


def _interior(
    fit: FilmFit, factor: float, names: tuple[str, ...], pixels: PixelPoints
) -> InteriorOrientation:
    """The fit as an interior orientation, residuals in micrometres."""
    return InteriorOrientation(
        fit.model, fit.matrix, names, pixels, fit.residuals * 1000, fit.sigma * 1000,
        fit.warp, fit.cofactor, fit.redundancy, factor,
    )  # fmt: skip
