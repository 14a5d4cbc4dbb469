"""Interior orientation: pixel <-> film of one scan, with the residual of every fiducial."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from core.arrays import Affine2, FilmPoints, PixelPoints, locked
from core.doubts import Failure
from core.geometry.camera import Camera
from core.geometry.transforms import PlaneTransform, fit_affine, fit_similarity

InteriorModel = Literal["similarity", "affine", "nominal"]


@dataclass(frozen=True, slots=True, eq=False)
class InteriorOrientation:
    """The transform of one scan; nothing is resampled or cropped, measurements stay in pixels."""

    model: InteriorModel
    """`nominal` where no fiducials are known: scan middle and scan pixel size."""
    film_from_pixel_matrix: Affine2
    """2 x 3: film mm from pixel (column, row)."""
    names: tuple[str, ...]
    """Names of the fiducials that were used, in the order of the arrays below."""
    pixels: PixelPoints
    """Where the fiducials were measured, pixels."""
    residuals_um: FilmPoints
    """Residual of each fiducial on the film (x, y), computed minus certified, micrometres."""
    sigma_um: float
    """A-posteriori sigma of one film coordinate, micrometres; NaN without redundancy."""

    def __post_init__(self) -> None:
        for name in ("film_from_pixel_matrix", "pixels", "residuals_um"):
            object.__setattr__(self, name, locked(getattr(self, name)))

    def film_from_pixel(self, pixels: PixelPoints) -> FilmPoints:
        """Film points in millimetres of scan pixels."""
        matrix = self.film_from_pixel_matrix
        return pixels @ matrix[:, :2].T + matrix[:, 2]

    def pixel_from_film(self, film: FilmPoints) -> PixelPoints:
        """Scan pixels of film points in millimetres."""
        matrix = self.film_from_pixel_matrix
        return np.linalg.solve(matrix[:, :2], (film - matrix[:, 2]).T).T

    @property
    def pixel_size_mm(self) -> float:
        """Mean size of a scan pixel on the film, millimetres."""
        return float(np.sqrt(abs(np.linalg.det(self.film_from_pixel_matrix[:, :2]))))

    @property
    def rms_um(self) -> float:
        """Root mean square of the fiducial residuals per coordinate, micrometres (0 if none)."""
        return float(np.sqrt(np.mean(self.residuals_um**2))) if len(self.names) else 0.0


LIMIT_UM = 30.0
"""A fit whose residuals have a greater RMS (scan pixels up to 15 um) does not stand, METHODS 2."""
LIMIT_PX = 2.0
"""The same limit in scan pixels, for coarser scans."""
CLEARED = 0.35
"""Leaving a mark out must bring the RMS down to this share before the mark counts as wrong."""


def fit_interior(
    names: Sequence[str],
    pixels: PixelPoints,
    certified_mm: FilmPoints,
    model: Literal["auto", "similarity", "affine"] = "auto",
) -> InteriorOrientation | Failure:
    """Interior orientation from measured fiducials; a single wrong mark is left out.

    A similarity, which has redundancy enough, finds the wrong mark; then an affine is fitted where
    four marks or more remain (unless `model` says otherwise). `names` of the result tells who was
    used.

    Args:
        names: Names of the measured fiducials.
        pixels: Where they were measured.
        certified_mm: Where the certificate puts them on the film.
        model: `auto`, or the model to fit.

    Returns:
        The interior orientation; a failure when the residuals exceed max(30 um, 2 pixels) RMS.
    """
    similarity = fit_similarity(pixels, certified_mm, mirrored=True)
    if isinstance(similarity, Failure):
        return similarity
    keep = _kept(pixels, certified_mm, similarity)
    fit = _fit(pixels[keep], certified_mm[keep], _chosen_model(model, int(keep.sum())))
    if isinstance(fit, Failure):
        return fit
    interior = _interior(fit, tuple(np.array(names)[keep].tolist()), pixels[keep])
    if interior.rms_um > limit_um(interior.pixel_size_mm):
        return Failure(
            f"The fiducials do not fit their certificate: RMS {interior.rms_um:.0f} um.",
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
    return across >= -0.05 * min(size_px) * min(frame_mm)


def _chosen_model(
    model: Literal["auto", "similarity", "affine"], marks: int
) -> Literal["similarity", "affine"]:
    """Affine by default where it leaves redundancy."""
    if model == "auto":
        return "affine" if marks >= 4 else "similarity"
    return model


def _fit(
    pixels: PixelPoints, film: FilmPoints, model: Literal["similarity", "affine"]
) -> PlaneTransform | Failure:
    """One of the two models, from pixels to film."""
    if model == "affine":
        return fit_affine(pixels, film)
    return fit_similarity(pixels, film, mirrored=True)


def _kept(pixels: PixelPoints, film: FilmPoints, similarity: PlaneTransform) -> np.ndarray:
    """Flags of the marks to use: all, or all but the one whose absence heals the similarity."""
    everyone = np.ones(len(pixels), dtype=bool)
    rms_um = similarity.rms * 1000
    if len(pixels) < 4 or rms_um <= limit_um(similarity.scale):
        return everyone
    without: list[float] = []
    for left_out in range(len(pixels)):
        keep = np.arange(len(pixels)) != left_out
        fit = fit_similarity(pixels[keep], film[keep], mirrored=True)
        without.append(np.inf if isinstance(fit, Failure) else fit.rms * 1000)
    wrong = int(np.argmin(without))
    if without[wrong] < CLEARED * rms_um:
        everyone[wrong] = False
    return everyone


def _interior(
    fit: PlaneTransform, names: tuple[str, ...], pixels: PixelPoints
) -> InteriorOrientation:
    """The fit as an interior orientation, residuals in micrometres."""
    return InteriorOrientation(
        fit.model, fit.matrix, names, pixels, fit.residuals * 1000, fit.sigma * 1000
    )
