"""Height systems: recognise one by its name or CRS, and compare a list of heights with the ground.

No height is changed here. Normal heights of Czechia and ellipsoidal ones differ by about 45 m,
and a transformation without its grid would silently leave them unchanged.
"""

from dataclasses import dataclass

import numpy as np
from pyproj import CRS
from pyproj.exceptions import CRSError

from core.arrays import Scalars
from core.geometry.robust import robust_sigma
from core.said import Said, say

ELLIPSOIDAL = "ellipsoidal"
"""Heights above the ellipsoid, which no vertical CRS names."""
# source: the EPSG register, by the names in use.
WORDS = {
    "bpv": "EPSG:8357", "baltic 1957": "EPSG:8357", "balt po vyrovnání": "EPSG:8357",
    "evrf2007": "EPSG:5621", "dhhn2016": "EPSG:7837", "dhhn92": "EPSG:5783",
    "egm2008": "EPSG:3855", "egm96": "EPSG:5773", "navd88": "EPSG:5703",
    "ellipsoidal": ELLIPSOIDAL, "elipsoidické": ELLIPSOIDAL,
}  # fmt: skip
"""Height systems by what people call them, small letters."""
# design: heights of archives and lists are off by metres; ellipsoid and geoid by tens in Europe.
FAR_M = 10.0
"""An offset below this is an error of the list or of the ground, not another height system."""
# design: one chance in a thousand and less for an offset that the scatter explains.
SHARP = 5.0
"""The offset is so many times the scatter of single heights about it at least."""
# design: of one point nobody can say that all are off alike.
LEAST = 2
"""Fewer heights are not judged."""


def height_system(text: str) -> str | None:
    """A code such as `EPSG:8357`, or `ellipsoidal`, for a word or a code of a height system.

    Returns:
        Nothing for an empty text; None where the word is not known.
    """
    word = " ".join(text.lower().split())
    if not word or word in WORDS:
        return WORDS.get(word, "")
    try:
        return vertical_of(CRS.from_user_input(text)) or None
    except CRSError:
        return None


def vertical_of(crs: CRS) -> str:
    """The height system of a CRS: its code or name, `ellipsoidal`, or nothing where it has none."""
    if crs.is_compound:
        return next((found for part in crs.sub_crs_list if (found := vertical_of(part))), "")
    if crs.is_vertical:
        authority = crs.to_authority()
        return ":".join(authority) if authority else crs.name
    # source: three axes of a geographic CRS end with the height above its ellipsoid.
    return ELLIPSOIDAL if crs.is_geographic and len(crs.axis_info) == 3 else ""


@dataclass(frozen=True, slots=True)
class HeightOffset:
    """Heights of a list that lie off the ground all alike, as those of another system do."""

    offset_m: float
    """Median of listed height less ground, metres."""
    scatter_m: float
    """Robust standard deviation of single heights about it, metres."""
    count: int
    """Heights that were compared."""


def height_offset(heights: Scalars, ground: Scalars, sigma_m: Scalars) -> HeightOffset | None:
    """Whether listed heights lie above or below the ground by a constant of tens of metres.

    Args:
        heights: Heights of a list, metres.
        ground: Height of the ground at each place, metres; NaN where it is not known.
        sigma_m: What each difference may be off by the list and the ground, metres.

    Returns:
        The offset; None where the heights agree, scatter, or are too few.
    """
    known = np.isfinite(heights) & np.isfinite(ground) & np.isfinite(sigma_m)
    off = heights[known] - ground[known]
    if len(off) < LEAST:
        return None
    offset = float(np.median(off))
    scatter = robust_sigma(off - offset)
    allowed = SHARP * max(scatter, float(np.median(sigma_m[known])))
    if abs(offset) < max(FAR_M, allowed):
        return None
    return HeightOffset(offset, scatter, len(off))


def told_offset(name: str, heights: Scalars, ground: Scalars, sigma_m: Scalars) -> Said | None:
    """The question about a list whose heights lie off the DEM all alike; None where they fit.

    Args:
        name: The list, as the user knows it.
        heights: Its heights, metres.
        ground: Height of the DEM at each place, metres; NaN where it is not known.
        sigma_m: What each difference may be off by the list and the DEM, metres.
    """
    found = height_offset(heights, ground, sigma_m)
    if found is None:
        return None
    return say(
        "{name}: heights of {count} points lie {offset:+.1f} m off the DEM, all alike (scatter "
        "{scatter:.1f} m). Ellipsoidal heights lie about 45 m above normal heights in Czechia. Are "
        "they of another system than the DEM? If so, bring the list to that of the DEM, or take "
        "{offset:.1f} m off its heights.",
        name=name,
        count=found.count,
        offset=found.offset_m,
        scatter=found.scatter_m,
    )
