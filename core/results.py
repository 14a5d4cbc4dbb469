"""The description of a block and the results of its stages."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from core.adjustment.adjusted import AdjustmentOptions, AdjustmentReport
from core.block import SurveyedPoint
from core.control.stage import ControlFound, ControlStageOptions
from core.doubts import Doubt, Failure
from core.geometry.camera import Camera
from core.georeference.archive import Georeference
from core.georeference.stage import Georeferenced
from core.literature.published_chains import Preset
from core.localisation.stage import LocalisationOptions, Localised
from core.matching.reference import ReferenceFiles
from core.mosaic.composition import MosaicProduct
from core.orthos.rectification import OrthoProduct
from core.raster.scan_file import ScanFile
from core.reference.stage import ReferenceFeatures
from core.scans.stage import ScanInput, ScanSet
from core.sheets.delivery import Delivery
from core.surface.stage import SurfaceProduct
from core.ties.stage import Tied


@dataclass(frozen=True, slots=True)
class BlockInput:
    """A block as its owner describes it."""

    name: str
    """What it is called."""
    cameras: Mapping[str, Camera]
    """Cameras by name."""
    scans: tuple[ScanInput, ...]
    """All scans."""
    georeference: Georeference
    """Where the photos are placed by at first."""
    reference: ReferenceFiles
    """What is known of the ground today, and the block's CRS."""
    surveyed: tuple[SurveyedPoint, ...] = ()
    """Points the user already has."""
    ties: tuple[Path, ...] = ()
    """List of another program's tie points, taken over instead of measured; empty for none."""
    preset: Preset = "gruber"
    """Whose control it is."""
    localisation: LocalisationOptions = field(default_factory=LocalisationOptions)
    """How photos are found on the reference."""
    control: ControlStageOptions = field(default_factory=ControlStageOptions)
    """How control is searched."""
    adjustment: AdjustmentOptions = field(default_factory=AdjustmentOptions)
    """How the block is adjusted in the end, with the operator's decisions."""

    @property
    def crs(self) -> str:
        """The block's CRS."""
        return self.reference.crs

    @property
    def scan_cameras(self) -> dict[str, str]:
        """Name of the camera by photo."""
        return {scan.path.stem: scan.camera for scan in self.scans}


@dataclass(frozen=True, slots=True, eq=False)
class StageResults:
    """What the stages have made so far: a field for each, None until it is made."""

    scans: ScanSet | None = None
    """Interior orientations."""
    georeference: Georeferenced | None = None
    """Where the archive puts the photos."""
    reference: ReferenceFeatures | None = None
    """Junctions and salient points."""
    localisation: Localised | None = None
    """Where the photos really lie."""
    ties: Tied | None = None
    """Fine tie points."""
    control: ControlFound | None = None
    """Control, and the block adjusted on it."""
    adjustment: AdjustmentReport | None = None
    """The block adjusted with the operator's decisions."""
    surface: SurfaceProduct | Failure | None = None
    """The surface from the photos, where it was asked for, or why there is none."""
    orthos: tuple[OrthoProduct, ...] | None = None
    """One ortho of each photo."""
    mosaic: MosaicProduct | None = None
    """Their composition."""
    change: Mapping[str, float] | None = None
    """How much of the ground has changed since, by kind, shares of the mosaic."""
    sheets: Delivery | None = None
    """Map sheets cut from it; None where nobody asked for them."""

    @property
    def opened_scans(self) -> dict[str, ScanFile]:
        """Scans by photo, as the first stage opened them."""
        oriented = {} if self.scans is None else self.scans.oriented
        return {name: scan.scan for name, scan in oriented.items()}

    @property
    def doubts(self) -> tuple[Doubt, ...]:
        """Everything doubtful, gravest first."""
        stages = (
            self.scans,
            self.georeference,
            self.reference,
            self.localisation,
            self.ties,
            self.control,
            self.adjustment,
        )
        every = [doubt for made in stages if made is not None for doubt in made.doubts]
        return tuple(sorted(every, key=lambda doubt: -doubt.gravity))

    @property
    def set_aside(self) -> dict[str, str]:
        """Scans that could not be used, with the reason."""
        reasons: dict[str, str] = {}
        for made in (self.scans, self.georeference):
            reasons.update({} if made is None else made.set_aside)
        return reasons
