"""What the stages take and make, as values, and what a stage is."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from core.block.adjusted import AdjustmentOptions
from core.block.approximation import Approximation
from core.block.assembly import AssemblyOptions
from core.block.block import Block, SurveyedPoint, TiePoints
from core.block.block_placement import BlockPlacementOptions, PlacedBlock
from core.block.georeference import Georeference
from core.block.published import Preset
from core.block.registration.orientation import OrientationOptions
from core.block.registration.placement import Placement
from core.block.tie_points import TieOptions
from core.doubts import Doubt
from core.geometry.camera import Camera
from core.progress import Progress
from core.scan.orientation import ScanOrientation

Mapper = Callable[..., Iterable[Any]]
"""Runs a function over items, such as `map` or the `map` of a pool of threads."""
Made = Mapping[str, Any]
"""What earlier stages made, by name of the stage."""


@dataclass(frozen=True, slots=True)
class ScanInput:
    """One scan and how it was taken."""

    path: Path
    """The file."""
    camera: str
    """Name of its camera."""
    scan_pixel_um: float
    """Nominal size of a scan pixel on the film, micrometres."""
    marks: Mapping[str, tuple[float, float]] = field(default_factory=dict[str, tuple[float, float]])
    """Fiducials measured by hand (column, row), which go before found ones."""


@dataclass(frozen=True, slots=True)
class BlockInput:
    """A block as its owner describes it."""

    name: str
    """What it is called."""
    crs: str
    """Its CRS."""
    cameras: Mapping[str, Camera]
    """Cameras by name."""
    scans: tuple[ScanInput, ...]
    """All scans."""
    georeference: Georeference
    """Where the photos are placed by at first."""
    ortho: tuple[Path, ...]
    """Sheets of the reference ortho."""
    dem: tuple[Path, ...]
    """Files of the reference heights."""
    roads: tuple[Path, ...] = ()
    """Road layers."""
    mask: Path | None = None
    """Polygons in which nothing may be matched."""
    bridges: Path | None = None
    """Polygons of bridges."""
    surveyed: tuple[SurveyedPoint, ...] = ()
    """Points the user already has."""
    ortho_sigma_m: float = 0.25
    """Accuracy of the ortho per axis, metres."""
    dem_sigma_m: float = 0.5
    """Accuracy of a height, metres."""
    orientation: OrientationOptions = field(default_factory=OrientationOptions)
    """How single photos are oriented."""
    preset: Preset = "gruber"
    """Whose control it is."""
    assembly: AssemblyOptions = field(default_factory=AssemblyOptions)
    """How the block is brought together."""
    adjustment: AdjustmentOptions = field(default_factory=AdjustmentOptions)
    """How it is adjusted in the end, with the operator's decisions."""
    placement: BlockPlacementOptions = field(default_factory=BlockPlacementOptions)
    """How the whole block is found."""
    ties: TieOptions = field(default_factory=TieOptions)
    """How tie points are found."""


@dataclass(frozen=True, slots=True, eq=False)
class ScanSet:
    """All scans with their interior orientation, and those that were set aside."""

    oriented: Mapping[str, ScanOrientation]
    """By photo."""
    set_aside: Mapping[str, str]
    """Reason by photo."""
    doubts: tuple[Doubt, ...]
    """What is doubtful about them."""
    cameras: Mapping[str, Camera] = field(default_factory=dict[str, Camera])
    """Cameras by name, with marks where only the photos tell them; empty: as they were given."""


@dataclass(frozen=True, slots=True, eq=False)
class Georeferenced:
    """Photos with approximate orientations."""

    block: Block
    """The photos; nothing is measured yet."""
    approximations: Mapping[str, Approximation]
    """By photo, with every hypothesis."""
    set_aside: Mapping[str, str]
    """Reason by photo, for those nothing is known of."""
    doubts: tuple[Doubt, ...]
    """What is doubtful about the sources and the reference's coverage."""


@dataclass(frozen=True, slots=True, eq=False)
class Tied:
    """The tie points of the block, and where its photos are from here on."""

    ties: TiePoints
    """All rays."""
    doubts: tuple[Doubt, ...]
    """Photos and pairs that tie badly."""
    start: Georeferenced
    """The photos where a first look found them, in coarse steps."""


@dataclass(frozen=True, slots=True, eq=False)
class PlacedBlocks:
    """Connected parts of the block, each placed on the reference as a whole."""

    found: tuple[PlacedBlock, ...]
    """Parts of more than one photo, the largest first."""
    doubts: tuple[Doubt, ...]
    """Parts that could not be placed."""

    def placements(self, photo_id: str) -> tuple[Placement, ...]:
        """Where a photo may lie, likeliest first; none when nothing is tied to it."""
        return next(
            (part.placements[photo_id] for part in self.found if photo_id in part.placements), ()
        )


@dataclass(frozen=True, slots=True)
class Work:
    """How a stage is to run."""

    progress: Progress
    """Told how far it is; asks it to stop."""
    mapper: Mapper
    """Runs independent pieces side by side."""


@dataclass(frozen=True, slots=True)
class Stage:
    """One entry of the table of contents."""

    name: str
    """Word used on the command line and in the names of products."""
    title: str
    """What the operator reads while it runs."""
    needs: tuple[str, ...]
    """Stages whose values it takes."""
    inputs: Callable[[BlockInput], tuple[Any, ...]]
    """The parts of the description that its value depends on."""
    run: Callable[[BlockInput, Made, Work], Any]
    """The work."""
    version: int = 1
    """Counted up when the same inputs give another value than before."""
