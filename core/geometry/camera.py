"""The camera: its constants, and what lens and film do beyond the radial terms.

Constants are those of the certificate, in the film frame (mm). Additional parameters are
polynomials of the ideal image coordinates.

With xi = x / h and eta = y / h (h half the longer side of the frame, x and y ideal image
coordinates from the principal point) every set of additional parameters is a linear combination of
the monomials xi^i eta^j, i and j from 0 to 4, in either film coordinate: 50 coefficients, in
millimetres at the edge of the frame.

Sources: Brown 1971, Photogrammetric Engineering 37(8) (tangential terms); Ebner 1976, Bildmessung
und Luftbildwesen 44 (twelve parameters, orthogonal on nine Gruber points); Gruen 1978,
International Archives 22-3 (forty-four, orthogonal on 5 x 5 points).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float64, Int

from core.arrays import FilmPoints, Scalars, locked
from core.doubts import Failure
from core.said import say

# source: Gruen 1978 takes powers 0 to 4.
DEGREES = 5
"""Powers 0 to 4 of each coordinate."""
TERMS = DEGREES * DEGREES
COEFFICIENTS = 2 * TERMS
# source: 2 (1 - 0.6) of half the side.
BASE = 0.8
"""Image base in units of h, at 60 % overlap."""

SetName = Literal["tangential", "affinity", "ebner12", "gruen44"]
"""Sets of additional parameters a block may be adjusted with."""
SETS: tuple[str, ...] = get_args(SetName)

Basis = Float64[np.ndarray, "parameters 2 terms"]
"""Each parameter's share in the monomials of x and of y, millimetres per unit."""
Coefficients = Float64[np.ndarray, "groups 2 terms"]
"""Monomials of x and of y of several cameras, millimetres."""


@dataclass(frozen=True, slots=True)
class Camera:
    """A frame camera with central projection and radial lens distortion."""

    name: str
    """Key of the `[camera.NAME]` table."""
    principal_distance_mm: float
    """Principal distance (camera constant), millimetres."""
    frame_mm: tuple[float, float]
    """Picture area, width and height, millimetres."""
    principal_point_mm: tuple[float, float] = (0.0, 0.0)
    """Principal point in the film frame, millimetres."""
    radial_distortion: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """k1, k2, k3 of imaged = ideal * (1 + k1 r^2 + k2 r^4 + k3 r^6), r in millimetres from the
    principal point: positive moves the image outwards, as certificates count it."""
    fiducials_mm: Mapping[str, tuple[float, float]] = field(
        default_factory=dict[str, tuple[float, float]]
    )
    """Certified fiducials by name, film frame, millimetres; empty when there are none."""
    data_strip: str = ""
    """Side of the picture on which the camera writes, in the film frame: `left`, `right`, `top`,
    `bottom`; empty when nobody said."""
    fiducial_marks: int = 0
    """How many marks the camera has where `fiducials_mm` is empty: 4 or 8; 0 when nobody said."""
    digital: bool = False
    """True where the scan is the frame itself: there is no film, no border and no mark."""
    deformation_mm: tuple[float, ...] = ()
    """The 50 coefficients of `core.geometry.camera`, those of x first; empty means none."""
    sigma_principal_distance_mm: float = 0.0
    """What a proposed principal distance is known to, millimetres; nought where a certificate
    states it."""
    distances_mm: tuple[tuple[float, float], ...] = ()
    """What a principal distance that nobody knows may be, with its standard deviation, likeliest
    first, millimetres; the first is taken until the photos tell."""
    certified: "Camera | None" = None
    """The camera as it stood before its constants were adjusted; None as long as they are not."""

    @property
    def certificate(self) -> "Camera":
        """The camera as its certificate has it: the mean of every prior on its constants."""
        return self.certified or self

    def with_constants(
        self,
        principal_distance_mm: float,
        principal_point_mm: tuple[float, float],
        radial_distortion: tuple[float, float, float],
        deformation_mm: tuple[float, ...] = (),
    ) -> "Camera":
        """The same camera with adjusted constants."""
        return replace(
            self,
            principal_distance_mm=principal_distance_mm,
            principal_point_mm=principal_point_mm,
            radial_distortion=radial_distortion,
            deformation_mm=deformation_mm,
            certified=self.certificate,
        )

    def at_distance(self, distance_mm: float, sigma_mm: float) -> "Camera":
        """The same camera, of which no more is known than this about its principal distance."""
        return replace(
            self, principal_distance_mm=distance_mm, sigma_principal_distance_mm=sigma_mm
        )

    @property
    def half_mm(self) -> float:
        """Half the longer side of the frame: what the deformation's coordinates are counted in."""
        return max(self.frame_mm) / 2

    @property
    def frame_corners_mm(self) -> FilmPoints:
        """The four corners of the picture area, counter-clockwise from lower left, film frame."""
        half = np.array(self.frame_mm, dtype=np.float64) / 2
        return half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=np.float64)


def radial_factor(radius_squared: Scalars, camera: Camera) -> Scalars:
    """Factor by which the lens moves an ideal image point away from the principal point."""
    k1, k2, k3 = camera.radial_distortion
    return 1 + radius_squared * (k1 + radius_squared * (k2 + radius_squared * k3))


@dataclass(frozen=True, slots=True, eq=False)
class AdditionalSet:
    """Additional parameters with their names."""

    names: tuple[str, ...]
    """What the protocol calls them."""
    basis: Basis
    """What they do; one millimetre of a parameter moves an image point at the edge by about one."""


def additional_set(names: tuple[str, ...]) -> AdditionalSet:
    """The parameters of one set or of several together; none of no set."""
    parts = [_SETS[name]() for name in names]
    words = tuple(word for part in parts for word in part.names)
    basis = np.concatenate([np.zeros((0, 2, TERMS)), *(part.basis for part in parts)])
    return AdditionalSet(words, basis)


def deformation_of(
    ideal: FilmPoints, coefficients: Float64[np.ndarray, "50"], half_mm: float
) -> FilmPoints:
    """Shift (mm) of ideal film points (n, 2) about the principal point."""
    terms = coefficients.reshape(1, 2, TERMS)
    group = np.zeros(len(ideal), dtype=np.int64)
    return shifts(ideal[:, 0] / half_mm, ideal[:, 1] / half_mm, terms, group).T


def shifts(
    xi: Scalars, eta: Scalars, coefficients: Coefficients, group: Int[np.ndarray, "rays"]
) -> Float64[np.ndarray, "2 rays"]:
    """Shift (mm) of rays by the polynomials of their group, at normalised coordinates."""
    powers = _powers(xi), _powers(eta)
    total = np.zeros((2, len(xi)))
    for term in np.flatnonzero(np.any(coefficients != 0, axis=(0, 1))).tolist():
        i, j = divmod(term, DEGREES)
        total += coefficients[group, :, term].T * (powers[0][i] * powers[1][j])
    return total


def slopes(
    xi: Scalars, eta: Scalars, coefficients: Coefficients, group: Int[np.ndarray, "rays"]
) -> Float64[np.ndarray, "2 2 rays"]:
    """Derivatives of `shifts` by xi and eta (second axis), millimetres."""
    powers = _powers(xi), _powers(eta)
    total = np.zeros((2, 2, len(xi)))
    for term in np.flatnonzero(np.any(coefficients != 0, axis=(0, 1))).tolist():
        i, j = divmod(term, DEGREES)
        own = coefficients[group, :, term].T
        if i:
            total[:, 0] += own * (i * powers[0][i - 1] * powers[1][j])
        if j:
            total[:, 1] += own * (j * powers[0][i] * powers[1][j - 1])
    return total


def by_parameters(
    xi: Scalars, eta: Scalars, basis: Basis
) -> Float64[np.ndarray, "2 parameters rays"]:
    """Derivatives of the film point by the additional parameters."""
    powers = _powers(xi), _powers(eta)
    found = np.zeros((2, len(basis), len(xi)))
    for term in np.flatnonzero(np.any(basis != 0, axis=(0, 1))).tolist():
        i, j = divmod(term, DEGREES)
        monomial = powers[0][i] * powers[1][j]
        for parameter, axis in zip(*np.nonzero(basis[:, :, term]), strict=True):
            found[axis, parameter] += basis[parameter, axis, term] * monomial
    return found


def _powers(values: Scalars) -> list[Scalars]:
    """Powers 0 to 4."""
    powers = [np.ones_like(values)]
    for _ in range(DEGREES - 1):
        powers.append(powers[-1] * values)
    return powers


def _polynomial(*terms: tuple[float, int, int]) -> Float64[np.ndarray, "terms"]:
    """Coefficients of a sum of value xi^i eta^j."""
    flat = np.zeros(TERMS)
    for value, i, j in terms:
        flat[i * DEGREES + j] += value
    return flat


NOTHING = _polynomial()


def _tangential() -> AdditionalSet:
    """Brown's decentring terms: dx = p1 (r^2 + 2 x^2) + 2 p2 x y, dy = p2 (r^2 + 2 y^2) + ..."""
    p1 = [_polynomial((3, 2, 0), (1, 0, 2)), _polynomial((2, 1, 1))]
    p2 = [_polynomial((2, 1, 1)), _polynomial((1, 2, 0), (3, 0, 2))]
    return AdditionalSet(("p1", "p2"), np.array([p1, p2]) / 4)


def _affinity() -> AdditionalSet:
    """Scale of x against y, and shear: what film does when it dries."""
    scale = [_polynomial((1, 1, 0)), _polynomial((-1, 0, 1))]
    shear = [_polynomial((1, 0, 1)), _polynomial((1, 1, 0))]
    return AdditionalSet(("affinity_scale", "affinity_shear"), np.array([scale, shear]))


def _ebner() -> AdditionalSet:
    """Ebner's twelve, with k = x^2 - 2 b^2 / 3 and l = y^2 - 2 b^2 / 3."""
    c = 2 * BASE**2 / 3
    k, el = _polynomial((1, 2, 0), (-c, 0, 0)), _polynomial((1, 0, 2), (-c, 0, 0))
    x, y, xy = _polynomial((1, 1, 0)), _polynomial((1, 0, 1)), _polynomial((1, 1, 1))
    xl = _polynomial((1, 1, 2), (-c, 1, 0))
    yk = _polynomial((1, 2, 1), (-c, 0, 1))
    kl = _polynomial((1, 2, 2), (-c, 2, 0), (-c, 0, 2), (c * c, 0, 0))
    pairs = (
        (x, -y), (y, x), (-2 * k, xy), (xy, -2 * el), (el, NOTHING), (NOTHING, k),
        (xl, NOTHING), (NOTHING, yk), (yk, NOTHING), (NOTHING, xl), (kl, NOTHING), (NOTHING, kl),
    )  # fmt: skip
    return AdditionalSet(tuple(f"ebner_{n}" for n in range(1, 13)), _normed(np.array(pairs)))


def _gruen() -> AdditionalSet:
    """All products of polynomials orthogonal on five places, less what the orientation does.

    Of the 50 products six are an exterior or interior orientation: the two shifts, scale and
    turn, and the two tilts; scale and turn leave the affinity, the tilts two bends at right angles
    to them. So 44 are left.
    """
    places = BASE * np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
    lines = _orthogonal(places)
    products = {
        (i, j): np.outer(lines[i], lines[j]).ravel() for i in range(DEGREES) for j in range(DEGREES)
    }
    x, y, xy, k, el = (products[ij] for ij in ((1, 0), (0, 1), (1, 1), (2, 0), (0, 2)))
    square = float(np.sum(np.polynomial.polynomial.polyval(places, lines[2]) ** 2) * len(places))
    mixed = float(np.sum(places**2) ** 2)
    pairs = [(x, -y), (y, x), (-mixed / square * k, xy), (xy, -mixed / square * el)]
    pairs += [(el, NOTHING), (NOTHING, k)]
    for ij, product in products.items():
        if ij not in {(0, 0), (1, 0), (0, 1), (1, 1), (2, 0), (0, 2)}:
            pairs += [(product, NOTHING), (NOTHING, product)]
    return AdditionalSet(tuple(f"gruen_{n}" for n in range(1, 45)), _normed(np.array(pairs)))


def _normed(basis: Basis) -> Basis:
    """The same, so that a parameter of one moves some point of the 5 x 5 grid by one."""
    places = BASE * np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
    x, y = (axis.ravel() for axis in np.meshgrid(places, places))
    return basis / np.abs(by_parameters(x, y, basis)).max(axis=(0, 2))[:, None, None]


def _orthogonal(places: Scalars) -> Float64[np.ndarray, "degrees degrees"]:
    """Coefficients (rows, from the constant up) of monic polynomials orthogonal on some places."""
    lines = np.eye(DEGREES)
    powers = places[:, None] ** np.arange(DEGREES)
    for row in range(DEGREES):
        for lower in range(row):
            one, other = powers @ lines[row], powers @ lines[lower]
            lines[row] -= (one @ other) / (other @ other) * lines[lower]
    return lines


def polynomial_from_table(
    table: Sequence[tuple[float, float]], terms: int = 3
) -> tuple[float, tuple[float, float, float], float] | Failure:
    """k1, k2, k3 of dr = r (k1 r^2 + k2 r^4 + k3 r^6) that fit a certificate's table.

    Certificates balance their table about a calibrated principal distance c, so dr = k0 r is fitted
    too. It becomes a part of the distance, c (1 + k0), for whose radii the coefficients then are.

    Args:
        table: Radius (mm) and radial distortion (um, outwards positive), from the certificate.
        terms: How many of k1 to k3 are fitted; the others are nought.

    Returns:
        1 + k0, the coefficients for r in millimetres, and the RMS of what they leave of the table
        (um).
    """
    radii, shifts = locked([row for row in table if row[0] > 0]).reshape(-1, 2).T
    if len(radii) < terms + 1:
        return Failure(
            say(
                "{count} radii are too few for {terms} coefficients.", count=len(radii), terms=terms
            )
        )
    unit = float(radii.max())
    scaled = radii / unit
    design = np.column_stack([scaled ** (2 * k + 1) for k in range(terms + 1)])
    solution = np.linalg.lstsq(design, shifts / 1000.0, rcond=None)[0]
    left = design @ solution - shifts / 1000.0
    longer = 1 + float(solution[0] / unit)
    powers = (unit * longer) ** (2 * np.arange(terms + 1) + 1)
    k1, k2, k3, *_ = [*(solution / powers)[1:].tolist(), 0.0, 0.0, 0.0]
    return longer, (k1, k2, k3), float(np.sqrt(np.mean(left**2)) * 1000)


_SETS = {
    "tangential": _tangential,
    "affinity": _affinity,
    "ebner12": _ebner,
    "gruen44": _gruen,
}
