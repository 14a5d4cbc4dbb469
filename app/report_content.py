"""What the accuracy report is made from."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from shapely.geometry import Polygon

from core.adjustment.adjusted import AdjustmentOptions, AdjustmentReport
from core.adjustment.influence import Influence
from core.block import Block
from core.control.calibration_check import Bin
from core.doubts import Doubt
from core.mosaic.comparison import MosaicAccuracy
from core.mosaic.seams import Seam


@dataclass(frozen=True, slots=True, eq=False)
class ReportContent:
    """Everything a report tells of; what is left out is left out of the report."""

    name: str
    """Name of the block."""
    report: AdjustmentReport
    """The adjusted block and its figures."""
    adjustment: AdjustmentOptions = field(default_factory=AdjustmentOptions)
    """What it was adjusted with."""
    before: Block | None = None
    """The block before the adjustment, for the changes of the cameras."""
    heights: str = ""
    """Height system in words."""
    doubts: Sequence[Doubt] = ()
    """What the engine is unsure of."""
    set_aside: Mapping[str, str] = field(default_factory=dict[str, str])
    """Scans that could not be used, with the reason."""
    reference_sigma_m: tuple[float, float] | None = None
    """Accuracy of the reference ortho and DEM, metres."""
    influence: Influence | None = None
    """Equations of the adjusted block, to tell where control would help; None: it is not told."""
    reliability: Sequence[Bin] = ()
    """How far the probabilities of control proposals are borne out."""
    footprints: Mapping[str, Polygon] = field(default_factory=dict[str, Polygon])
    """Footprint of each photo; over level ground when left out."""
    mosaic: Path | None = None
    """The mosaic."""
    seams: Sequence[Seam] = ()
    """Its seams."""
    change: Mapping[str, float] = field(default_factory=dict[str, float])
    """Share of the ground that is `same` as today and that is `different`; empty: not known."""
    comparisons: Mapping[str, MosaicAccuracy] = field(default_factory=dict[str, MosaicAccuracy])
    """Mosaic against other orthos, by their name."""
    timings_s: Mapping[str, float] = field(default_factory=dict[str, float])
    """Seconds of each stage."""
    provenance: Mapping[str, str] = field(default_factory=dict[str, str])
    """Versions, options, digests, times."""
