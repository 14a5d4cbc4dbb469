"""Colours, shapes and rounded figures for states, on the pages and in 3D."""

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from jaxtyping import Int64, UInt8

from core.arrays import Scalars

ShownState = Literal["auto", "accepted", "rejected", "dubious", "unused", "predicted", "proposed"]
"""State of a measurement as the desk shows it; the last two of what is to be measured yet."""
CloudShape = Literal["square", "diamond", "circle", "rounded", "sparkle"]
"""Shapes a point of a point cloud can have on screen."""


Colours = UInt8[np.ndarray, "n 3"]
"""Red, green, blue, 0 to 255."""


@dataclass(frozen=True, slots=True)
class Look:
    """How one state looks, in the table, on the pictures and in 3D."""

    colour: str
    """CSS colour, from the palette of Okabe and Ito, lightened for a dark ground."""
    glyph: str
    """Shape on the pages: `circle`, `disc`, `cross`, `diamond`, `square`, `dashed`, `target`."""
    cloud_shape: CloudShape
    """Shape in the 3D scene."""
    cloud_size: float
    """Size in the 3D scene as a factor of the ordinary point size."""


LOOKS: dict[ShownState, Look] = {
    "auto": Look("#56b4e9", "circle", "circle", 1.0),
    "accepted": Look("#1fc79b", "disc", "rounded", 1.0),
    "rejected": Look("#ee6a2c", "cross", "sparkle", 1.3),
    "dubious": Look("#f0d34a", "diamond", "diamond", 1.25),
    "unused": Look("#8a93a0", "square", "square", 0.7),
    "predicted": Look("#e69fd0", "dashed", "circle", 0.7),
    "proposed": Look("#c3e88d", "target", "circle", 0.7),
}
"""Every state's look; shapes differ as well as colours."""

CURRENT = "#ffffff"
"""What is worked on now."""
CHECK = "#d9c2ff"
"""Check points, on pictures and in 3D."""
PREDICTED = "#e69fd0"
"""Where the orientation says a point should be."""
PEAK = "#f3b13c"
"""Other places where the point might lie."""
FOOTPRINT = "#7f8ea3"
"""Outlines of photos on the ground."""
STALE = "#f3b13c"
"""Photos whose ortho is older than their orientation."""
PHOTO = "#9fb4cc"
"""Frustums."""
SIZES = ("#4c6fd8", "#3fa7b0", "#7cc46b", "#e6d14a", "#ee6a2c")
"""Misfits from nothing to the largest usual one: one ramp, darker where less is told."""
FEWEST_RAYS = 2
RAYS = tuple(reversed(SIZES))
"""Tie points of two rays, three and so on; the last also those with more."""
CHOSEN = "#ff6fb0"
"""The photo chosen in the scene."""
LIGHT = {CURRENT: "#101820", STALE: "#8a5000", PHOTO: "#35526f", CHOSEN: "#b5186a"}
"""What stands against the ground of the scene, where that is light."""
ELLIPSE = "#e8d9a0"
"""Error ellipses of control points."""
SERVED, BARE = "#1fc79b", "#ee6a2c"
"""Gruber areas with a point and without one, which is crossed too."""
FADED = "#78828f"
"""Points that the chosen photo does not show."""


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green, blue (0 to 255) of a CSS colour written `#rrggbb`."""
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def against(colour: str, light: bool) -> str:
    """A colour as it is drawn against a light ground, or a dark one."""
    return LIGHT.get(colour, colour) if light else colour


def size_colours(sizes: Scalars, most: float) -> Colours:
    """Colour of each size on the ramp from nought to `most`; what is larger has the last one.

    Args:
        sizes: Sizes, in the unit of `most`.
        most: Where the ramp ends.
    """
    ramp = np.array([rgb(colour) for colour in SIZES], dtype=np.float64)
    place = np.clip(sizes / max(most, 1e-9), 0.0, 1.0) * (len(ramp) - 1)
    channels = [np.interp(place, np.arange(len(ramp)), ramp[:, channel]) for channel in range(3)]
    return np.rint(np.stack(channels, axis=1)).astype(np.uint8)


def ray_colours(rays: Int64[np.ndarray, " n"]) -> Colours:
    """Colour of tie points by their number of rays."""
    ramp = np.array([rgb(colour) for colour in RAYS], dtype=np.uint8)
    return ramp[np.clip(rays - FEWEST_RAYS, 0, len(ramp) - 1)]


def page_palette() -> dict[str, object]:
    """The palette as the pages receive it."""
    return {
        "states": {name: {"colour": k.colour, "glyph": k.glyph} for name, k in LOOKS.items()},
        "current": CURRENT,
        "check": CHECK,
        "predicted": PREDICTED,
        "peak": PEAK,
        "sizes": SIZES,
        "rays": RAYS,
        "ellipse": ELLIPSE,
        "bare": BARE,
        "chosen": {"dark": CHOSEN, "light": LIGHT[CHOSEN]},
    }


def short(value: float | None, digits: int) -> float | None:
    """A rounded number, None for what is not one."""
    if value is None or not math.isfinite(value):
        return None
    return round(float(value), digits)


def round_all(values: Any, digits: int) -> list[float | None] | None:
    """The same of several."""
    return None if values is None else [short(float(value), digits) for value in values]
