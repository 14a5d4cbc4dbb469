"""What the engine is unsure of, with its evidence; the operator decides."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True)
class Doubt:
    """Something that may not stand: shown to the operator, never guessed away."""

    kind: str
    """Short machine name, such as `fiducial-residual` or `scan-set-aside`."""
    subject: str
    """What it is about: a scan, a point, a file."""
    message: str
    """One or two plain sentences: what is doubtful, why, and what would settle it."""
    gravity: float = 0.5
    """From 0 (for information) to 1 (the result cannot be trusted without a decision)."""
    evidence: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """Figures that support it, JSON-able."""


@dataclass(frozen=True, slots=True)
class Failure:
    """An estimate that did not stand."""

    reason: str
    """One plain sentence."""
    evidence: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """Figures that support it, JSON-able."""
