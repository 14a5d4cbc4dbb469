"""Refraction and Earth curvature, as corrections of the image of a near-vertical photo."""

from dataclasses import dataclass

# source: mean radius of GRS 80.
EARTH_RADIUS_M = 6_371_000.0


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
    # source: Bertram 1966, formula and constants as in the docstring.
    upper = 2410.0 * high / (high * high - 6.0 * high + 250.0)
    # source: as above.
    lower = 2410.0 * low / (low * low - 6.0 * low + 250.0)
    # source: as above, microradians.
    return (upper - lower * low / high) * 1e-6 if high > 0 else 0.0


def atmosphere_of(flying_height_m: float, ground_height_m: float) -> Atmosphere:
    """Both corrections for a photo taken at a height over mean ground, above sea level, metres."""
    return Atmosphere(
        refraction=refraction_constant(flying_height_m, ground_height_m),
        curvature_per_m=1.0 / (2.0 * EARTH_RADIUS_M),
    )
