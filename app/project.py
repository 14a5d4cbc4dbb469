"""Read `block.toml` into a frozen `Project` with every default, in the engine's terms."""

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatch
from glob import has_magic
from itertools import islice
from pathlib import Path
from typing import cast

import numpy as np

from app.block_schema import OPERATOR_NAMES, USUAL_NAMES
from app.block_sections import (
    BlockSection,
    OrthoSection,
    adjustment_options,
    check_attribute,
    check_edge,
    ortho_section,
    read_block,
    read_camera,
    surface_options,
    taken_in,
    taken_of,
)
from app.block_toml import FILE, Document, Table
from app.references import ReferenceSection, read_reference
from app.sheets_section import SheetsSection, sheets_section
from core.adjustment.adjusted import AdjustmentOptions
from core.block import surveyed_point
from core.control.stage import ControlStageOptions
from core.errors import ProjectError
from core.formats.listed_point import ListedPoint
from core.formats.micmac_points import read_image_measures
from core.formats.point_list import read_control_points
from core.formats.records import scan_stem
from core.geometry.camera import Camera
from core.geometry.crs import bounds_of, check_range, read_crs
from core.georeference import archive
from core.literature.baselines import operator_named
from core.literature.dense_descriptors import has_akaze
from core.literature.published_chains import Preset
from core.localisation.photo_orientation import OrientationOptions
from core.localisation.stage import LocalisationOptions
from core.matching.learned import LEARNED, check_network
from core.matching.reference import ReferenceFiles
from core.quality.job_rules import JobRules
from core.results import BlockInput
from core.said import say
from core.scans.stage import ScanInput
from core.surface.stage import SurfaceOptions
from sessions.session import FILE as SESSION_FILE


@dataclass(frozen=True, slots=True)
class ListedScan:
    """One scan of the block with what holds for it."""

    photo_id: str
    """The file's name without folder and extension."""
    path: Path
    """The scan file."""
    camera: str
    """Name of its camera."""
    scan_pixel_um: float
    """Size of a scan pixel on the film, micrometres."""
    taken: str = ""
    """Day, month or year of exposure as ISO has it, or a time with its offset from UTC; empty where
    nobody says."""


@dataclass(frozen=True, slots=True)
class ScansSection:
    """`[scans]` with its overrides applied."""

    listed: tuple[ListedScan, ...]
    """The scans by name, those excluded left out."""
    footprints: Path | None = None
    """Vector file with a polygon for each scan."""
    footprint_name: str = "LMS_TIF_UP"
    """Attribute of the footprints that holds the scan's file name."""
    exterior: Path | None = None
    """List of known exterior orientations; goes before `georeference` where it names a scan."""
    georeference: archive.GeoreferenceKind = "world-file"
    """What to begin from."""
    fiducial_measures: tuple[Path, ...] = ()
    """MicMac's MeasuresIm-*.xml: fiducials measured by hand, which go before found ones."""
    scale_number: float | None = None
    """Scale of the photos, for those that no source places."""
    flying_height_m: float | None = None
    """Height above sea from which they were taken, metres."""
    ties: Path | None = None
    """Tie points of another program, which are taken over instead of measured."""


@dataclass(frozen=True, slots=True)
class ControlSection:
    """`[control]`."""

    points: Path | None = None
    """Surveyed points the user has."""
    operators: tuple[str, ...] = USUAL_NAMES
    """What scan and reference are compared by; the first proposes the control."""
    learned: Path | None = None
    """Weights of the operator `learned`, where it is among them."""
    preset: Preset = "gruber"
    """Whose control it is: our own, or that of a published chain to compare it with."""


@dataclass(frozen=True, slots=True)
class Project:
    """A block as its `block.toml` describes it; every path is there."""

    file: Path
    """The `block.toml`."""
    block: BlockSection
    """Name and CRS."""
    cameras: Mapping[str, Camera]
    """Cameras by name."""
    scans: ScansSection
    """Scans and what is known of their place."""
    reference: ReferenceSection
    """What is known of the ground; empty for a block that stands on points of its own."""
    control: ControlSection = ControlSection()
    """Surveyed points."""
    ortho: OrthoSection = field(default_factory=OrthoSection)
    """What orthos and mosaic are to be."""
    adjustment: AdjustmentOptions = field(default_factory=AdjustmentOptions)
    """`[adjustment]`."""
    surface: SurfaceOptions | None = None
    """`[surface]`; None where no surface is asked for."""
    sheets: SheetsSection = field(default_factory=SheetsSection)
    """What map sheets are cut."""

    @property
    def asked_for(self) -> frozenset[str]:
        """Stages it asks for that not every block needs."""
        surface = self.surface is not None or self.ortho.ground != "dem"
        asked = {"surface": surface, "sheets": self.sheets.asked}
        return frozenset(name for name, wanted in asked.items() if wanted)

    @property
    def folder(self) -> Path:
        """The block's folder."""
        return self.file.parent

    @property
    def rules(self) -> JobRules:
        """Limits by which it is judged."""
        return self.block.rules

    @property
    def exposed(self) -> dict[str, str]:
        """When each photo was taken, as far as that is known, of those that have a date."""
        return {scan.photo_id: scan.taken for scan in self.scans.listed if scan.taken}

    @property
    def taken(self) -> dict[str, str]:
        """Day, month or year of exposure by photo, of those that have one."""
        return {name: time.partition("T")[0] for name, time in self.exposed.items()}


def read_project(path: Path, *, brought: bool = False) -> Project:
    """Read a block's `block.toml`.

    Args:
        path: The file, or the folder that holds it.
        brought: Whether points or orientations come in now, which may tell where it lies.

    Raises:
        ProjectError: Something in it cannot be used; says in which line and what to do.
    """
    file = path / FILE if path.is_dir() else path
    # Unlike Path.resolve, this follows links in a circle no further. A linked file counts where
    # the link is: there lie the scans, and there go the results.
    folder = Path(os.path.realpath(file.parent))
    if {"\n", "\r"} & set(str(folder)):
        cause = "lies in a folder with a line break in its name; GDAL opens no file there."
        raise ProjectError(folder / file.name, cause, "Rename the folder.")
    return project_of(Document(folder / file.name), brought=brought)


def project_of(document: Document, *, brought: bool = False) -> Project:
    """What a `block.toml` says; raises as `read_project` does."""
    document.check_sections()
    cameras = _cameras(document)
    adjustment = adjustment_options(document)
    unknown = next((name for name, camera in cameras.items() if camera.distances_mm), None)
    if unknown is not None and not adjustment.estimate_cameras:
        cause = say("nobody states the principal distance of {camera}.", camera=unknown)
        remedy = "State it in [camera], or let cameras be estimated."
        raise document.table("adjustment").error("cameras", cause, remedy)
    scans = _scans(document, cameras)
    dated = any(scan.taken for scan in scans.listed)
    ortho = ortho_section(document)
    check_edge(document, ortho, cameras)
    return Project(
        document.path,
        read_block(document),
        cameras,
        scans,
        read_reference(document, brought or may_have_points(document), dated, years_of),
        _control(document),
        ortho,
        adjustment,
        surface_options(document),
        sheets_section(document),
    )


def years_of(document: Document) -> tuple[int, ...]:
    """Years in which the scans of a `block.toml` were taken, of those that have a date.

    Raises:
        ProjectError: Its scans are not as it says.
    """
    listed = _scans(document, _cameras(document)).listed
    return tuple(int(scan.taken[:4]) for scan in listed if scan.taken)


def _cameras(document: Document) -> dict[str, Camera]:
    found = document.values.get("camera", {})
    names = cast("dict[str, object]", found) if isinstance(found, dict) else {}
    if not names or not all(isinstance(table, dict) for table in names.values()):
        remedy = "Add a table [camera.NAME] with principal_distance_mm and frame_mm."
        raise ProjectError(document.path, "describes no camera.", remedy)
    return {name: read_camera(document, name) for name in names}


def _scans(document: Document, cameras: Mapping[str, Camera]) -> ScansSection:
    table = document.table("scans", required=True)
    footprints, named = table.file("footprints"), table.text("footprint_name")
    if footprints is not None:
        check_attribute(table, "footprints", footprints, "footprint_name", named)
    georeference = table.choice("georeference")
    if georeference == "footprints" and footprints is None:
        remedy = 'Add footprints = "footprints.gpkg", or another georeference.'
        raise table.error("georeference", "there are no footprints.", remedy)
    return ScansSection(
        _listed(document, table, cameras),
        footprints,
        named,
        table.file("exterior"),
        cast("archive.GeoreferenceKind", georeference),
        table.files("fiducial_measures"),
        *(
            table.number(key) if table.has(key) else None
            for key in ("scale_number", "flying_height_m")
        ),
        ties=table.file("ties"),
    )


def _listed(
    document: Document, table: Table, cameras: Mapping[str, Camera]
) -> tuple[ListedScan, ...]:
    """The scans with the overrides applied, in the order of their names."""
    camera, pixel_um = (table.choice("camera", tuple(cameras)), table.number("scan_pixel_um"))
    taken = taken_in(table)
    usual = taken if isinstance(taken, str) else ""
    listed: dict[str, ListedScan] = {}
    for path in table.files("files"):
        if path.stem in listed:
            told = "two scans are called {stem}: {first} and {second}."
            values = {"stem": path.stem, "first": listed[path.stem].path, "second": path}
            cause = say(told, **values)
            raise table.error("files", cause, "Rename one; the name tells the photo.")
        listed[path.stem] = ListedScan(path.stem, path, camera, pixel_um, usual)
    if not isinstance(taken, str):
        _date(table, listed, taken)
    for override in document.tables("scans.override"):
        _apply(override, listed, cameras)
    if not listed:
        raise table.error("files", "all scans are excluded.", "Leave at least one.")
    return tuple(listed[name] for name in sorted(listed))


def _date(table: Table, listed: dict[str, ListedScan], taken: Mapping[str, str]) -> None:
    """Give scans the days of a table; one in a file may know scans of other blocks as well."""
    folder, strange = table.document.path.parent, ""
    for name, day in taken.items():
        named = listed.get(scan_stem(name))
        globbed = _meant(listed, name, folder) if has_magic(name) and named is None else []
        meant = globbed if named is None else [named]
        strange = strange or ("" if meant else name)
        listed |= {scan.photo_id: replace(scan, taken=day) for scan in meant}
    nobody = not any(scan.taken for scan in listed.values())
    if strange and (nobody or isinstance(table.values["taken"], dict)):
        raise _no_scan(table, "taken", strange, listed.values())


def _apply(override: Table, listed: dict[str, ListedScan], cameras: Mapping[str, Camera]) -> None:
    pattern, folder = override.text("file"), override.document.path.parent
    meant = _meant(listed, pattern, folder)
    if not meant:
        raise _no_scan(override, "file", pattern, listed.values())
    for scan in meant:
        if override.flag("exclude"):
            del listed[scan.photo_id]
            continue
        listed[scan.photo_id] = ListedScan(
            scan.photo_id,
            scan.path,
            override.choice("camera", tuple(cameras), scan.camera),
            override.number("scan_pixel_um", scan.scan_pixel_um),
            taken_of(override, scan.taken),
        )


def _no_scan(table: Table, key: str, name: str, listed: Iterable[ListedScan]) -> ProjectError:
    """A name or glob that means no scan."""
    names = ", ".join(scan.path.name for scan in islice(listed, 3))
    cause = say('"{pattern}" matches none of the scans.', pattern=name)
    remedy = say("Correct it; the scans are {names}, ...", names=names)
    return table.error(key, cause, remedy if names else "All are excluded already.")


def _meant(listed: Mapping[str, ListedScan], pattern: str, folder: Path) -> list[ListedScan]:
    """Scans that a name or glob means; what is a name is no glob, and signs in it mean themselves.

    Paths are counted from `block.toml`.
    """

    def names(scan: ListedScan) -> tuple[str, str]:
        return scan.path.name, Path(os.path.relpath(scan.path, folder)).as_posix()

    scans = [*listed.values()]
    exact = [scan for scan in scans if pattern in names(scan)]
    return exact or [scan for scan in scans if any(fnmatch(n, pattern) for n in names(scan))]


def may_have_points(document: Document) -> bool:
    """Whether a block was opened before, so that points may have been brought into it."""
    return (document.path.parent / SESSION_FILE).is_file()


def _control(document: Document) -> ControlSection:
    table = document.table("control")
    preset = cast("Preset", table.choice("preset"))
    operators = _operators(table)
    return ControlSection(table.file("points"), operators, _network(table, operators), preset)


def _operators(table: Table) -> tuple[str, ...]:
    """Names of operators, each once."""
    key, every = "operators", OPERATOR_NAMES
    given: object = table.values.get(key, list(USUAL_NAMES))
    names = cast("list[object]", [given] if isinstance(given, str) else given)
    known = f"Write a list of {', '.join(every)}; without the key it is {list(USUAL_NAMES)}."
    if not isinstance(given, str | list) or not names:
        raise table.error(
            key, say("must be a list of operators, not {given!r}.", given=given), known
        )
    for name in names:
        if name not in every:
            raise table.error(key, say("{name!r} is no operator.", name=name), known)
        if name == "akaze" and not has_akaze():
            raise table.error(key, "the OpenCV of this machine has no AKAZE.", "Take another.")
    return tuple(dict.fromkeys(cast("list[str]", names)))


def _network(table: Table, operators: tuple[str, ...]) -> Path | None:
    """The weights of the learned operator; None where it is not asked for."""
    file = table.file("learned")
    if LEARNED not in operators:
        return None
    if file is None:
        remedy = 'Name the ONNX file of a network: learned = "network.onnx".'
        raise table.error("operators", '"learned" has no network.', remedy)
    check_network(file)
    return file


def described(project: Project, brought: Sequence[ListedPoint] = ()) -> BlockInput:
    """What the engine is given of a project; points brought into it tell where it lies, too."""
    scans = project.scans
    listed = listed_points(project.control.points, project.block.crs)
    measured: dict[str, dict[str, tuple[float, float]]] = {}
    for file in scans.fiducial_measures:
        measured |= read_image_measures(file)
    control = project.control
    operators = tuple(operator_named(name, control.learned) for name in control.operators)
    orientation = OrientationOptions(operators=operators)
    return BlockInput(
        name=project.block.name,
        cameras=project.cameras,
        scans=tuple(
            ScanInput(scan.path, scan.camera, scan.scan_pixel_um, measured.get(scan.path.name, {}))
            for scan in scans.listed
        ),
        georeference=archive.Georeference(
            scans.georeference,
            scans.footprints,
            scans.footprint_name,
            scans.exterior,
            scans.scale_number,
            scans.flying_height_m,
            project.block.corrections,
        ),
        reference=_reference_files(project, (*listed, *brought)),
        surveyed=tuple(surveyed_point(point) for point in listed),
        ties=() if scans.ties is None else (scans.ties,),
        preset=project.control.preset,
        localisation=LocalisationOptions(orientation=orientation),
        control=ControlStageOptions(orientation, project.adjustment.of_cameras),
        adjustment=project.adjustment,
    )


def _reference_files(project: Project, listed: Sequence[ListedPoint]) -> ReferenceFiles:
    """The reference; where there is none, what control points tell of the ground.

    Check points judge only: they have no say in it.
    """
    control = [point for point in listed if point.role != "check"]
    known = [point.height for point in control if point.role != "plan"]
    plan = np.array([(p.easting, p.northing) for p in control if p.role != "height"]).reshape(-1, 2)
    area = bounds_of(plan)
    reference = project.reference
    ortho_sigma_m, dem_sigma_m = reference.sigmas_m(project.block.crs)
    taken = [*project.taken.values()]
    return ReferenceFiles(
        crs=project.block.crs,
        ortho=reference.ortho,
        dem=reference.dem,
        roads=reference.roads,
        mask=reference.mask,
        bridges=reference.bridges,
        ortho_sigma_m=ortho_sigma_m,
        dem_sigma_m=dem_sigma_m,
        level_m=float(np.mean(known)) if known and not reference.dem else None,
        area=area if len(plan) and not reference.ortho else None,
        layers=tuple(reference.layers(project.block.crs, taken, project.folder)),
    )


def listed_points(file: Path | None, crs: str) -> tuple[ListedPoint, ...]:
    """The user's own points; their coordinates must be possible in the block's CRS."""
    if file is None:
        return ()
    listed = read_control_points(file, crs)
    places = np.array([(point.easting, point.northing) for point in listed]).reshape(-1, 2)
    check_range(read_crs(crs, file), places, file)
    return listed
