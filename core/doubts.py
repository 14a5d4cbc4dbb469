"""Doubts: what the engine is unsure of, with its evidence, for the operator to decide."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

# design: five steps of urgency, which order what the operator reads; nothing is computed from them
GRAVITY: Mapping[str, float] = {
    # Nothing can be trusted before this is settled.
    "no-photo-oriented": 1.0,
    "datum": 0.9,
    "fiducials-not-found": 0.9,
    # A part of the block is lost or may be wrong.
    "control-far-away": 0.8,
    "fiducials-of-another-camera": 0.8,
    "impossible-number": 0.8,
    "point-behind-camera": 0.8,
    "scan-set-aside": 0.8,
    "control-flat": 0.7,
    "dem-noughts": 0.7,
    "fiducials-corrected": 0.7,
    "heights": 0.7,
    "same-photo": 0.7,
    "scan-mirrored": 0.7,
    "block-in-parts": 0.6,
    "block-placement": 0.6,
    "fiducial-names": 0.6,
    "fiducials-few": 0.6,
    "photo-not-tied": 0.6,
    # One look is worth while.
    "dem-coverage": 0.5,
    "dem-holes": 0.5,
    "few-ties": 0.5,
    "fiducial-left-out": 0.5,
    "georeference-unused": 0.5,
    "interior-nominal": 0.5,
    "map-scale": 0.5,
    "ortho-coverage": 0.5,
    "photo-orientation": 0.5,
    "common-shift": 0.4,
    "duplicate-points": 0.4,
    "fiducial-doubtful": 0.4,
    "fiducial-residual": 0.4,
    "no-dem": 0.4,
    "pair-not-tied": 0.4,
    "photo-misplaced": 0.4,
    "reference-half-pixel": 0.4,
    "sigma-nought-given": 0.4,
    "world-file-affine": 0.4,
    # For information.
    "fiducial-unsure": 0.3,
    "fiducials-estimated": 0.3,
    "fiducials-scale": 0.3,
    "georeference-missing": 0.3,
    "no-ortho": 0.3,
    "no-picture": 0.3,
    "polygons-elsewhere": 0.3,
    "reference-elsewhere": 0.3,
    "reference-not-compared": 0.3,
    "roads-empty": 0.3,
    "pair-few-ties": 0.2,
    "reference-reprojected": 0.2,
    "scan-turned": 0.2,
    "unsettled": 0.2,
    "film-shrinkage": 0.1,
}
"""Every kind of doubt, gravest first, and how grave it is where the case itself does not say."""
OF_ITS_KIND = -1.0  # design: no gravity, so that it stands for none given
"""Gravity of a doubt that is as grave as its kind."""


@dataclass(frozen=True, slots=True)
class Doubt:
    """Something that may not stand: shown to the operator, never guessed away."""

    kind: str
    """Short machine name, one of `GRAVITY`."""
    subject: str
    """What it is about: a scan, a point, a file."""
    message: str
    """One or two plain sentences: what is doubtful, why, and what would settle it."""
    gravity: float = OF_ITS_KIND
    """From 0 (for information) to 1 (the result cannot be trusted without a decision); as grave as
    its kind where the case does not say."""
    evidence: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """Figures that support it, JSON-able."""

    def __post_init__(self) -> None:
        if self.gravity == OF_ITS_KIND:
            object.__setattr__(self, "gravity", GRAVITY[self.kind])


@dataclass(frozen=True, slots=True)
class Failure:
    """An estimate that did not stand."""

    reason: str
    """One plain sentence."""
    evidence: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """Figures that support it, JSON-able."""
