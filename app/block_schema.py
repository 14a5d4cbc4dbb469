"""Every key of `block.toml` in one place: the reader, the form of the start page and the manual."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

from core.adjustment.adjusted import AdjustmentOptions
from core.geometry.camera import SETS
from core.geometry.collinearity import CORRECTIONS
from core.georeference.archive import GeoreferenceKind
from core.literature.baselines import OPERATORS
from core.literature.published_chains import Preset
from core.matching.learned import LEARNED
from core.matching.operators import USUAL
from core.orthos.rectification import OrthoOptions, Resampling
from core.said import say
from core.sheets.cutting import SUFFIXES
from core.sheets.stage import LOSSY_PERCENT
from core.surface.ground import GroundKind

Kind = Literal[
    "text", "number", "numbers", "measures", "choice", "choices", "flag", "count", "file", "files",
    "rasters", "marks", "pairs", "tables", "time", "words",
]  # fmt: skip
"""How a value is written: `measures` are numbers of a unit, `marks` a table of places by name,
`choices` a list of known words, `words` one of any, `rasters` files of which globs keep rasters,
`time` a day as TOML or text has it, or times by file."""
Asked = Literal["first", "more", "file"]
"""Where the form has a key: in sight, folded away, or not at all."""


@dataclass(frozen=True, slots=True)
class Unit:
    """The range a number must lie in, and the mistakes that leave it."""

    name: str
    """Unit in words."""
    low: float
    """Smallest value that makes sense."""
    high: float
    """Largest value that makes sense."""
    taken_for: Sequence[tuple[str, float]] = ()
    """Units that are often mistaken for it, with the factor to this one; a factor of 0 stands for
    dots per inch."""
    example: str = ""
    """A value and what it means, where the unit alone does not tell how it is written."""
    whole: bool = False
    """Whether it has no fraction."""

    def advice(self, value: float) -> str:
        """What the value probably was meant to be."""
        for other, factor in self.taken_for:
            meant = value * factor if factor else 25_400.0 / value if value else 0.0
            if self.low <= meant <= self.high:
                return f"{value:g} looks like {other}: write {meant:.6g}."
        if self.example:
            return say(
                "Write {example}; from {low:.0f} to {high:.0f}.",
                example=self.example,
                low=self.low,
                high=self.high,
            )
        return f"Write it in {self.name}, from {self.low:g} to {self.high:g}."


MILLIMETRES = Unit("millimetres", 10, 2000, (("metres", 1000), ("micrometres", 0.001)))
"""Principal distances and sides of a picture."""
MICROMETRES = Unit("micrometres", 3, 500, (("millimetres", 1000), ("dots per inch", 0)))
"""Scan pixels."""
SCALE_NUMBERS = Unit("scale numbers", 500, 500_000, example="15000 for 1 : 15 000")
"""Scales of photos."""
HEIGHTS = Unit("metres above sea", 100, 30_000, (("kilometres", 1000),))
"""Heights of perspective centres."""
METRES = Unit("metres", 0.001, 1000, (("millimetres", 0.001),))
"""Standard deviations and ground sample distances."""
INTERVALS = Unit("metres", 0.1, 1000)
"""Heights between contour lines."""
SMALL_MM = Unit("millimetres", 0.0001, 10, (("micrometres", 0.001),))
"""Priors of camera constants."""
SMALL_UM = Unit("micrometres", 0.1, 10_000, (("millimetres", 1000),))
"""Priors of distortion."""
DEM_M = Unit("metres", 0.0, 1000)
"""Nought leaves the terrain out."""
RIM_M = Unit("metres", 0.0, 10_000, (("kilometres", 1000),))
"""Rims of map sheets, and how far beyond a border they show something."""
PERCENT = Unit("hundredths", 0.5, 100)
"""Sizes beside the uncompressed one."""
YEARS = Unit("years", 1858, 2100, whole=True)
"""Of photographs from the air."""
EDGE_MM = Unit("millimetres", 0.0, 100, (("micrometres", 0.001),))
"""Strips along the edge of a frame."""
RISK = Unit("a probability", 1e-6, 0.1)
"""Of rejecting what is good."""


@dataclass(frozen=True, slots=True)
class Key:
    """One key of a table."""

    name: str
    """As it is written."""
    kind: Kind
    """How its value is written."""
    default: Any = None
    """What holds where it is left out, as it would be written; None for nothing."""
    required: bool = False
    """Whether it may not be left out."""
    unit: Unit | None = None
    """Range of its numbers."""
    choices: tuple[str, ...] = ()
    """Words that it may be."""
    count: int = 0
    """How many numbers."""
    asked: Asked = "file"
    """Where the form has it."""


DEFAULT, RECTIFIED = AdjustmentOptions(), OrthoOptions()
SIDES = ("", "left", "right", "top", "bottom")
OPERATOR_NAMES = (*OPERATORS, LEARNED)
USUAL_NAMES = tuple(operator.name for operator in USUAL)
"""The operators that compare where `block.toml` names none."""
BLOCK = (
    Key("name", "text", required=True, asked="first"),
    Key("crs", "text", required=True, asked="first"),
    Key("heights", "text", "", asked="more"),
    Key("corrections", "choices", list(CORRECTIONS), choices=CORRECTIONS),
    Key("rules", "file", asked="more"),
)
CAMERA = (
    Key("principal_distance_mm", "number", unit=MILLIMETRES, asked="first"),
    Key("make", "text", "", asked="more"),
    Key("model", "text", "", asked="more"),
    Key("frame_mm", "measures", required=True, unit=MILLIMETRES, count=2, asked="first"),
    Key("principal_point_mm", "numbers", [0.0, 0.0], count=2, asked="more"),
    Key("radial_distortion", "numbers", [], asked="more"),
    Key("distortion_table_um", "pairs"),
    Key("digital", "flag", False),
    Key("decentring", "numbers", [0.0, 0.0], count=2),
    Key("fiducials_mm", "marks", {}, asked="first"),
    Key("fiducials_file", "file"),
    Key("fiducial_marks", "count", 0, choices=("0", "4", "8"), asked="more"),
    Key("data_strip", "choice", "", choices=SIDES, asked="more"),
)
SCANS = (
    Key("files", "rasters", required=True, asked="first"),
    Key("camera", "text", required=True),
    Key("scan_pixel_um", "number", required=True, unit=MICROMETRES, asked="first"),
    Key("georeference", "choice", "world-file", choices=get_args(GeoreferenceKind), asked="first"),
    Key("footprints", "file", asked="more"),
    Key("footprint_name", "text", "LMS_TIF_UP", asked="more"),
    Key("scale_number", "number", unit=SCALE_NUMBERS, asked="first"),
    Key("flying_height_m", "number", unit=HEIGHTS, asked="more"),
    Key("exterior", "file", asked="more"),
    Key("taken", "time", "", asked="more"),
    Key("fiducial_measures", "files"),
    Key("ties", "file"),
    Key("override", "tables"),
)
OVERRIDE = (
    Key("file", "text", required=True),
    Key("camera", "text"),
    Key("scan_pixel_um", "number", unit=MICROMETRES),
    Key("taken", "time"),
    Key("exclude", "flag", False),
)
REFERENCE = (
    Key("ortho", "rasters", [], asked="first"),
    Key("dem", "rasters", [], asked="first"),
    Key("roads", "files", [], asked="first"),
    Key("ortho_sigma_m", "number", unit=METRES, asked="first"),
    Key("dem_sigma_m", "number", unit=METRES, asked="first"),
    Key("year", "number", unit=YEARS),
    Key("buildings", "file"),
    Key("woods", "file"),
    Key("water", "file"),
    Key("bridges", "file"),
    Key("mask", "file", asked="more"),
    Key("other", "tables"),
)
OTHER = (
    Key("block", "text"),
    Key("surface", "flag", False),
    Key("ortho", "rasters", []),
    Key("dem", "rasters", []),
    Key("year", "number", unit=YEARS),
    Key("ortho_sigma_m", "number", unit=METRES),
    Key("dem_sigma_m", "number", unit=METRES),
    Key("ties", "flag", False),
)
CONTROL = (
    Key("points", "file", asked="more"),
    Key("operators", "choices", list(USUAL_NAMES), choices=OPERATOR_NAMES),
    Key("learned", "file"),
    Key("preset", "choice", "gruber", choices=get_args(Preset)),
)
ADJUSTMENT = (
    Key("cameras", "flag", True),
    Key("sigma_principal_distance_mm", "number", DEFAULT.sigma_principal_distance_mm,
        unit=SMALL_MM),
    Key("sigma_principal_point_mm", "number", DEFAULT.sigma_principal_point_mm, unit=SMALL_MM),
    Key("sigma_distortion_um", "number", DEFAULT.sigma_distortion_um, unit=SMALL_UM),
    Key("self_calibration", "choices", [], choices=tuple(SETS)),
    Key("self_calibration_per", "choice", "camera", choices=("camera", "photo")),
    Key("sigma_additional_um", "number", DEFAULT.sigma_additional_um, unit=SMALL_UM),
    Key("only_significant", "flag", True),
    Key("gnss_shift", "choice", "none", choices=("none", "block", "strip")),
    Key("gnss_drift", "flag", False),
    Key("imu_misalignment", "flag", False),
    Key("dem_sigma_m", "number", 0.0, unit=DEM_M),
    Key("network", "choice", "control", choices=("control", "free")),
    Key("compare_methods", "flag", False),
    Key("variance_components", "flag", False),
    Key("gross_errors", "choice", "w", choices=("w", "tau", "none")),
    Key("risk", "number", DEFAULT.risk, unit=RISK),
)  # fmt: skip
ORTHO = (
    Key("gsd_m", "number", unit=METRES, asked="more"),
    Key("sheets", "file", asked="more"),
    Key("balance", "flag", True),
    Key("tone", "text", "", asked="more"),
    Key("ground", "choice", "dem", choices=get_args(GroundKind)),
    Key("visibility", "flag", False),
    Key("area", "file", asked="more"),
    Key("resampling", "choice", RECTIFIED.resampling, choices=get_args(Resampling), asked="more"),
    Key("edge_mm", "number", RECTIFIED.edge_mm, unit=EDGE_MM, asked="more"),
)
SURFACE = (
    Key("gsd_m", "number", unit=METRES),
    Key("point_cloud", "flag", False),
    Key("contours_m", "number", unit=INTERVALS),
)
SHEETS = (
    Key("rule", "choice", "", choices=("", "sm5"), asked="more"),
    Key("sm50", "marks", {}),
    Key("formats", "choices", ["geotiff"], choices=tuple(SUFFIXES)),
    Key("lossy_percent", "number", LOSSY_PERCENT, unit=PERCENT),
    Key("crs", "words", []),
    Key("overlap_m", "number", 0.0, unit=RIM_M),
    Key("border", "file"),
    Key("border_m", "number", 100.0, unit=RIM_M),
    Key("product", "text", "", asked="more"),
    Key("year", "number", unit=YEARS),
)
TABLES: Mapping[str, tuple[Key, ...]] = {
    "block": BLOCK,
    "camera": CAMERA,
    "scans": SCANS,
    "scans.override": OVERRIDE,
    "reference": REFERENCE,
    "reference.other": OTHER,
    "control": CONTROL,
    "adjustment": ADJUSTMENT,
    "surface": SURFACE,
    "ortho": ORTHO,
    "sheets": SHEETS,
}
"""Keys by table; `camera` stands for every `[camera.NAME]`."""
SECTIONS = tuple(name for name in TABLES if "." not in name)
"""Tables of the file."""


def keys_of(table: str) -> Mapping[str, Key]:
    """The keys of a table by its dotted name, such as `camera.wide`."""
    found = TABLES["camera"] if table.startswith("camera.") else TABLES[table]
    return {key.name: key for key in found}


def missing_reference(values: Mapping[str, Any], *, brought: bool) -> tuple[str, ...]:
    """Keys of [reference] that a `block.toml` must still have.

    An ortho needs heights; a block without an ortho needs surveyed points or known exterior
    orientations, unless points were brought into it.
    """

    def has(table: str, key: str) -> bool:
        found = values.get(table, {})
        return isinstance(found, dict) and key in found

    if has("reference", "ortho"):
        return () if has("reference", "dem") else ("dem",)
    if brought or has("control", "points") or has("scans", "exterior"):
        return ()
    return ("ortho",) if has("reference", "dem") else ("ortho", "dem")
