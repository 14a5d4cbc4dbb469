"""What kind of block is wanted, the scales it is made at, and seeds that follow from names."""

import hashlib
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

CRS = "EPSG:5514"
"""S-JTSK, in which all synthetic places lie."""
PRESENT_YEAR = 2022
"""Year of the reference."""
FINEST_M = 0.2  # design: memory; film seldom resolves more
"""No ground is painted finer, metres."""
Size = Literal["tiny", "small", "full"]
Georeference = Literal["world-file", "footprints", "points", "exterior", "none"]
Quality = Literal["good", "bad"]


@dataclass(frozen=True, slots=True)
class Scale:
    """The pixel sizes of one size of block."""

    scan_pixel_um: float
    """Scan pixel on the film, micrometres."""
    scan_ground_m: float
    """Scan pixel on the ground, metres: with the camera it decides the flying height."""
    texture_m: float
    """Pixel of the painted ground, metres."""
    ortho_m: tuple[float, float]
    """Ground sample distances of the ortho sheets: most sheets, and the odd one, metres."""
    dem_m: float
    """Ground sample distance of the DEM, metres."""


SCALES: dict[Size, Scale] = {
    "tiny": Scale(180.0, 1.2, 0.8, (1.0, 0.8), 5.0),
    "small": Scale(60.0, 0.6, 0.4, (0.5, 0.4), 2.0),
    "full": Scale(15.0, 0.4, 0.32, (0.5, 0.4), 2.0),
}


@dataclass(frozen=True, slots=True)
class FilmOptions:
    """How film and lens treat the light."""

    blur_px: float = 0.55
    """Blur of lens, motion and emulsion, scan pixels."""
    grain: float = 5.5
    """Standard deviation of the grain in the middle tones, gray values."""
    grain_px: float = 0.75
    """Blur that makes grain of neighbouring pixels alike, pixels."""
    vignetting: float = 1.1
    """Power of the cosine by which light falls off."""


FILM: dict[Size, FilmOptions] = {
    "tiny": FilmOptions(blur_px=0.5, grain=3.5, grain_px=0.6),
    "small": FilmOptions(blur_px=0.6, grain=5.5, grain_px=0.7),
    "full": FilmOptions(blur_px=1.1, grain=9.0, grain_px=1.1),
}


@dataclass(frozen=True, slots=True)
class SyntheticOptions:
    """Everything that decides a synthetic block; the same options give the same files."""

    size: Size = "small"
    """tiny: scans of 1078 pixels, for tests; small: 3233, for the demo; full: 12 933."""
    epoch: int = 1938
    """1938 (much has changed since) or 1984 (little has); years between count in proportion."""
    relief_m: float = 60.0
    """Highest minus lowest ground of the landscape, metres."""
    seed: int = 1
    """Any number; another seed is another place, flight and film."""
    georeference: Georeference = "world-file"
    """What the user's archive offers to begin from."""
    georeference_quality: Quality = "good"
    """good: 5 to 10 m off and 0.3 degrees; bad: 100 to 300 m, 1 degree and 2 per cent."""
    change: float | None = None
    """Share of the road length that changed between the epochs; None: a third since 1938."""
    strips: int = 2
    """Strips of the flight."""
    photos_per_strip: int = 3
    """Photos of each strip, at most thirty."""
    scan_pixel_um: float | None = None
    """Scan pixel on the film, 15 to 200 micrometres; None: as the size has it."""
    scan_ground_m: float | None = None
    """Scan pixel on the ground, metres; None: as the size has it."""
    film: FilmOptions | None = None
    """Lens, film and print; None: as the size has them."""

    @property
    def scale(self) -> Scale:
        """The pixel sizes of the block."""
        usual = SCALES[self.size]
        ground_m = self.scan_ground_m or usual.scan_ground_m
        # The ground is painted as finely, against what scans show of it, as usual.
        texture_m = usual.texture_m * min(1.0, ground_m / usual.scan_ground_m)
        return replace(
            usual,
            scan_pixel_um=self.scan_pixel_um or usual.scan_pixel_um,
            scan_ground_m=ground_m,
            texture_m=max(texture_m, min(FINEST_M, usual.texture_m)),
        )

    @property
    def developed(self) -> FilmOptions:
        """How film and lens treat the light."""
        return self.film or FILM[self.size]

    @property
    def road_change(self) -> float:
        """Share of the road length that changed, 0 to 1."""
        share = 0.33 - 0.23 * self.recency if self.change is None else self.change
        return float(np.clip(share, 0.0, 0.95))

    @property
    def parcel_change(self) -> float:
        """Share of the parcels that were drawn anew, 0 to 1: consolidation goes with the roads."""
        if self.change is None:
            return 0.85 - 0.6 * self.recency
        return float(np.clip(2.5 * self.change, 0.0, 0.95))

    @property
    def recency(self) -> float:
        """0 for 1938 and before, 1 for 1984 and after."""
        return float(np.clip((self.epoch - 1938) / 46.0, 0.0, 1.0))


def seeded(seed: int, *names: object) -> np.random.Generator:
    """A generator of its own for every part of the block, so that parts do not disturb others."""
    text = "/".join([str(seed), *(str(name) for name in names)])
    return np.random.default_rng(int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "big"))
