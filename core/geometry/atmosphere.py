"""Refraction and Earth curvature, as corrections of the image of a near-vertical photo."""

from dataclasses import dataclass

# source: mean radius of GRS 80.
EARTH_RADIUS_M = 6_371_000.0
BERTRAM = (2410.0, 6.0, 250.0)  # source: Bertram 1966, for heights in kilometres.
"""Constants of `refraction_constant`, in the order of its formula."""


@dataclass(frozen=True, slots=True)
class Atmosphere:
    """The two physical corrections of one photo, both nought by default."""

    refraction: float = 0.0
    """K of dr = K (r + r^3 / c^2), dimensionless; moves image points outwards."""
    curvature_per_m: float = 0.0
    """1 / (2 R) per metre: a point at distance d from the nadir appears d^2 / (2 R) lower."""


def refraction_constant(flying_height_m: float, ground_height_m: float) -> float:
    """K of the standard atmosphere for heights above sea level in metres.

    K = [2410 H / (H^2 - 6 H + 250) - 2410 h / (h^2 - 6 h + 250) h / H] 1e-6 with H, h in
    kilometres; with r = 130 mm it reproduces Table 4.1 of the notes on image coordinates.
    """
    high, low = flying_height_m / 1000.0, ground_height_m / 1000.0
    if high <= 0:
        return 0.0
    # source: Bertram 1966, microradians.
    return (_bertram(high) - _bertram(low) * low / high) * 1e-6


def _bertram(height_km: float) -> float:
    """Refraction of the air below a height, microradians."""
    factor, linear, constant = BERTRAM
    return factor * height_km / (height_km * height_km - linear * height_km + constant)


def atmosphere_of(flying_height_m: float, ground_height_m: float) -> Atmosphere:
    """Both corrections for a photo taken at a height over mean ground, above sea level, metres."""
    return Atmosphere(
        refraction=refraction_constant(flying_height_m, ground_height_m),
        curvature_per_m=1.0 / (2.0 * EARTH_RADIUS_M),
    )
