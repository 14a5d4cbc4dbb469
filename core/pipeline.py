"""The stages in their order: the table of contents of the engine.

Each stage takes what the block was described as and what earlier stages made, and returns a
value. Nothing here knows of folders, sessions or screens; `app.run` walks this list.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from core.block.assembly import AssemblyOptions
from core.block.georeference import Georeference
from core.block.orientation import (
    OrientationOptions,
)
from core.block.tie_points import TieOptions
from core.doubts import Doubt
from core.errors import PhotogrammetryError
from core.geometry.camera import Camera
from core.progress import Progress
from core.reference.dem import open_dem
from core.reference.ortho import open_ortho
from core.reference.reference import Reference
from core.scan.orientation import ScanOrientation, orient_scan

Mapper = Callable[..., Iterable[Any]]
"""Runs a function over items, such as `map` or the `map` of a pool of threads."""


@dataclass(frozen=True, slots=True)
class ScanInput:
    """One scan and how it was taken."""

    path: Path
    """The file."""
    camera: str
    """Name of its camera."""
    scan_pixel_um: float
    """Nominal size of a scan pixel on the film, micrometres."""


@dataclass(frozen=True, slots=True)
class BlockInput:
    """A block as its owner describes it."""

    name: str
    crs: str
    cameras: Mapping[str, Camera]
    scans: tuple[ScanInput, ...]
    georeference: Georeference
    ortho: tuple[Path, ...]
    dem: tuple[Path, ...]
    roads: tuple[Path, ...] = ()
    mask: Path | None = None
    ortho_sigma_m: float = 0.25
    dem_sigma_m: float = 0.5
    orientation: OrientationOptions = field(default_factory=OrientationOptions)
    assembly: AssemblyOptions = field(default_factory=AssemblyOptions)
    ties: TieOptions = field(default_factory=TieOptions)


@dataclass(frozen=True, slots=True, eq=False)
class ScanSet:
    """All scans with their interior orientation, and those that were set aside."""

    oriented: Mapping[str, ScanOrientation]
    """By photo."""
    set_aside: Mapping[str, str]
    """Reason by photo."""
    doubts: tuple[Doubt, ...]
    """What is doubtful about them."""


@dataclass(frozen=True, slots=True)
class Work:
    """How a stage is to run."""

    progress: Progress
    """Told how far it is; asks it to stop."""
    mapper: Mapper
    """Runs independent pieces side by side."""


def random_for(*names: str) -> np.random.Generator:
    """A generator that depends on names alone, so that the same run gives the same result."""
    digest = sha256("/".join(names).encode()).digest()
    return np.random.default_rng(int.from_bytes(digest[:8], "big"))


def open_reference(given: BlockInput) -> Reference:
    """The reference of a block, its files opened."""
    return Reference(
        open_ortho(given.ortho, given.crs),
        open_dem(given.dem, given.crs),
        given.ortho_sigma_m,
        given.dem_sigma_m,
    )


def orient_scans(given: BlockInput, made: Mapping[str, Any], work: Work) -> ScanSet:
    """Read every scan, find picture area and fiducials, fit its interior orientation.

    A scan that cannot be used is set aside with its reason; the rest goes on.

    Raises:
        PhotogrammetryError: No scan can be used.
    """

    def one(scan: ScanInput) -> ScanOrientation | PhotogrammetryError:
        try:
            return orient_scan(scan.path, given.cameras[scan.camera], scan.scan_pixel_um)
        except PhotogrammetryError as error:
            return error

    oriented: dict[str, ScanOrientation] = {}
    failed: dict[str, PhotogrammetryError] = {}
    for done, (scan, result) in enumerate(
        zip(given.scans, work.mapper(one, given.scans), strict=True)
    ):
        work.progress.report(done + 1, len(given.scans), scan.path.name)
        if isinstance(result, PhotogrammetryError):
            failed[scan.path.stem] = result
        else:
            oriented[result.photo_id] = result
    if not oriented:
        raise next(iter(failed.values()))
    doubts = [doubt for result in oriented.values() for doubt in result.doubts]
    doubts += [Doubt("scan-set-aside", name, str(error), 0.8) for name, error in failed.items()]
    reasons = {name: str(error) for name, error in failed.items()}
    return ScanSet(dict(sorted(oriented.items())), reasons, tuple(doubts))
