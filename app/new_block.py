"""`gruber new`: write a `block.toml` for the files of a folder, and say what is missing."""

import glob
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, cast

import numpy as np
from pyproj import CRS

from app.block_toml import FILE, RASTERS
from app.block_writing import toml_value
from app.folder_scan import Findings, FoundLayer, FoundRaster, Kind, find, why_unreadable
from core.errors import CrsError, ProjectError
from core.geometry.crs import parse_crs, short_name
from core.georeference.archive import GeoreferenceKind
from core.matching.reference import DEM_SIGMA, ORTHO_SIGMA
from sessions.atomic_write import whole_file

FRAMES_MM = (90.0, 120.0, 180.0, 230.0, 300.0)
"""Sides of the picture of common film cameras."""
CAMERA = "film"
"""Name given to the camera."""
EXTERIOR_HEADER = ("scan", "X", "Y", "Z", "omega_deg", "phi_deg", "kappa_deg")
"""How a list of exterior orientations begins."""
CONTROL_HEADER = ("id", "X", "Y", "Z")
"""How a list of surveyed points begins."""
EXPECTED = {
    "ortho_sigma_m": "accuracy of the orthophoto, expected of its pixel",
    "dem_sigma_m": "accuracy of the terrain model, expected of its cell",
}
"""What is said of an accuracy that nobody stated."""
MOST_UNUSED = 12
"""Files of no use that are named."""
UNKNOWN_DISTANCE = (
    "# FILL IN: principal distance from the camera certificate, millimetres, such as 211.59;",
    "# left out, it is estimated: make and model of the camera help",
    "# principal_distance_mm =",
)
_WOODS = ("wood", "forest", "lesni", "lesy", "wald")
_WATER = ("water", "vodni", "vody", "lake", "gewaesser")
_NOT_ROADS = ("contour", "vrstev", "rail", "zelez", "river", "stream", "border", *_WOODS, *_WATER)


@dataclass(frozen=True, slots=True)
class Gap:
    """Something that was not found; its texts are `gap.NAME` and `gap.out.OUT`."""

    name: str
    """What is missing."""
    out: str
    """What that leaves out."""
    keys: tuple[str, ...]
    """Keys of `block.toml`, each of which supplies it."""


@dataclass(frozen=True, slots=True)
class Note:
    """A remark about a file; its text is `found.note.NAME`."""

    name: str
    """What is to be said."""
    values: Mapping[str, str]
    """Names of files and CRS in it."""


@dataclass(frozen=True, slots=True)
class Recognition:
    """What a folder was recognised to hold; paths relative to it, as `block.toml` writes them."""

    folder: Path
    """The folder."""
    crs: str | None
    """CRS of the reference."""
    scans: tuple[str, ...]
    """Paths or globs of the scans."""
    scan_count: int
    """Number of scans."""
    scan_pixel_um: float | None
    """Scan pixel by the scans' own resolution tag, micrometres."""
    frame_mm: float | None
    """Side of the picture that fits the scans, millimetres; a guess."""
    georeference: GeoreferenceKind
    """What the scans can begin from."""
    footprints: tuple[str, str] | None
    """Footprint file and the attribute that holds the scans' names."""
    exterior: str | None
    """List of exterior orientations."""
    ortho: tuple[str, ...]
    """Paths or globs of the ortho sheets."""
    dem: tuple[str, ...]
    """Paths or globs of terrain heights."""
    pixels_m: Mapping[str, float]
    """Finest pixel of `ortho` and cell of `dem`, where known, metres."""
    roads: tuple[str, ...]
    """Road layers."""
    buildings: str | None
    """Building polygons."""
    woods: str | None
    """Wood polygons."""
    water: str | None
    """Water polygons."""
    bridges: str | None
    """Bridge polygons."""
    control: str | None
    """List of surveyed points."""
    sheets: str | None
    """Map sheets to cut."""
    notes: tuple[Note, ...]
    """What else the operator should know."""

    @property
    def found(self) -> tuple[tuple[str, str], ...]:
        """What was recognised: its text is `found.NAME`, and a value."""
        lines = (
            ("scans", f"{self.scan_count}: {', '.join(self.scans)}" if self.scans else ""),
            ("begin", "" if self.georeference == "none" else self.georeference),
            ("footprints", self.footprints[0] if self.footprints else ""),
            ("exterior", self.exterior or ""),
            ("ortho", ", ".join(self.ortho)),
            ("dem", ", ".join(self.dem)),
            ("roads", ", ".join(self.roads)),
            ("buildings", self.buildings or ""),
            ("woods", self.woods or ""),
            ("water", self.water or ""),
            ("bridges", self.bridges or ""),
            ("control", self.control or ""),
            ("sheets", self.sheets or ""),
            ("crs", short_name(CRS.from_user_input(self.crs)) if self.crs else ""),
        )
        return tuple((name, value) for name, value in lines if value)

    @property
    def sigmas_m(self) -> Mapping[str, float]:
        """Accuracy to expect of ortho and terrain by their pixels, by key of [reference]."""
        rules = {"ortho": ORTHO_SIGMA, "dem": DEM_SIGMA}
        return {
            f"{name}_sigma_m": rules[name].expected_m(size) for name, size in self.pixels_m.items()
        }

    @property
    def stands_alone(self) -> bool:
        """Whether surveyed points or exterior orientations do where there is no ortho."""
        return not self.ortho and (self.control is not None or self.exterior is not None)

    @property
    def gaps(self) -> tuple[Gap, ...]:
        """What was not found, and what that leaves out; the gravest first."""
        begin = self.georeference != "none" or self.exterior is not None
        alone = self.stands_alone
        ortho_out, dem_out = ("proposals", "level") if alone else ("nothing", "nothing")
        missing = (
            (True, "distance", "distance", ("camera.principal_distance_mm",)),
            (not self.scans, "scans", "nothing", ("scans.files",)),
            (not self.ortho, "ortho", ortho_out, ("reference.ortho",)),
            (not self.dem, "dem", dem_out, ("reference.dem",)),
            (self.crs is None, "crs", "nothing", ("block.crs",)),
            (self.scan_pixel_um is None, "pixel", "nothing", ("scans.scan_pixel_um",)),
            (self.frame_mm is None, "frame", "nothing", ("camera.frame_mm",)),
            (not begin, "place", "place", ("scans.scale_number", "scans.exterior")),
            (True, "fiducials", "shrinkage", ("camera.fiducials_mm", "camera.fiducials_file")),
            (not self.roads and not alone, "roads", "roads", ("reference.roads",)),
            (self.control is None, "control", "checks", ("control.points",)),
            (self.buildings is None, "buildings", "buildings", ("reference.buildings",)),
        )
        return tuple(Gap(name, out, keys) for lacks, name, out, keys in missing if lacks)


def recognise(folder: Path) -> Recognition:
    """Look through a folder and say what it holds; nothing is changed."""
    folder = folder.resolve()
    if not folder.is_dir():
        raise ProjectError(folder, "is no folder.", "Name the folder that holds the scans.")
    return recognise_files(folder, find(folder))


def recognise_files(folder: Path, findings: Findings) -> Recognition:
    """What the files of a folder are."""
    scans, orthos, dems = (_of_kind(findings, kind) for kind in ("scan", "ortho", "dem"))
    crs = _crs_of(orthos, dems, findings.layers)
    footprints = _footprints(findings.layers, scans)
    pixel_um = _common(scan.scan_pixel_um for scan in scans)
    layers = [layer for layer in findings.layers if footprints is None or layer != footprints[0]]
    return Recognition(
        folder,
        _code(crs),
        _patterns(folder, scans, findings.unreadable),
        len(scans),
        pixel_um,
        _frame(scans, pixel_um),
        _georeference(scans, findings.points, footprints is not None),
        None if footprints is None else (_relative(folder, footprints[0].path), footprints[1]),
        _table(folder, findings, EXTERIOR_HEADER),
        _patterns(folder, orthos),
        _patterns(folder, dems),
        {
            name: size
            for name, found in (("ortho", orthos), ("dem", dems))
            if (size := _finest(found))
        },
        tuple(dict.fromkeys(_relative(folder, layer.path) for layer in layers if _is_road(layer))),
        _polygons(folder, layers, "building", "budov", "house", "gebaeude"),
        _polygons(folder, layers, *_WOODS),
        _polygons(folder, layers, *_WATER),
        _polygons(folder, layers, "bridge", "most"),
        _table(folder, findings, CONTROL_HEADER),
        _polygons(
            folder, [item for item in layers if "name" in item.fields], "sheet", "klad", "sm5"
        ),
        tuple(_notes(folder, findings, crs)),
    )


def write_block_toml(
    recognition: Recognition,
    path: Path | None = None,
    accepted: Mapping[str, Any] = MappingProxyType({}),
) -> Path:
    """Write what was recognised; what cannot be known stands there as a comment to be filled in.

    Args:
        recognition: What the folder holds.
        path: Where to; None for its `block.toml`.
        accepted: What was read in the margins, by key.

    Raises:
        ProjectError: There is a `block.toml` already; it is left as it is.
    """
    target = path or recognition.folder / FILE
    refuse_second(target)
    with whole_file(target) as temporary:
        temporary.write_text(toml_of(recognition, accepted), encoding="utf-8")
    return target


def refuse_second(path: Path) -> None:
    """Refuse a folder that has a `block.toml`, or such a file itself.

    Raises:
        ProjectError: It is there.
    """
    target = path / FILE if path.is_dir() else path
    if target.exists():
        raise ProjectError(target, "is there already.", "Edit it, or rename it and start again.")


def toml_of(found: Recognition, accepted: Mapping[str, Any] = MappingProxyType({})) -> str:
    """The text of a `block.toml`."""
    distance, days = accepted.get("camera.principal_distance_mm"), accepted.get("scans.override")
    in_margin = {
        key: accepted.get(f"scans.{key}") for key in ("taken", "flying_height_m", "scale_number")
    }
    camera = (
        *(_lines(principal_distance_mm=distance) if distance else UNKNOWN_DISTANCE),
        _frame_line(found.frame_mm),
        "# fiducials_mm = { 1 = [-84.5, 0.3], 2 = [84.5, -0.2] }  # certified marks, mm; optional",
    )
    scans = (
        _or_comment("files", found.scans, "paths of the scans"),
        _line("camera", CAMERA),
        _or_comment(
            "scan_pixel_um", found.scan_pixel_um, "scan pixel, micrometres; 1693 dpi are 15"
        ),
        _line("georeference", found.georeference),
        *_lines(**in_margin),
        *_lines(footprints=found.footprints and found.footprints[0]),
        *_lines(footprint_name=found.footprints and found.footprints[1], exterior=found.exterior),
    )
    if found.stands_alone:
        files = ("# no ortho: nothing is proposed", *_lines(dem=found.dem))
    else:
        files = (
            _or_comment("ortho", found.ortho, "sheets of today's orthophoto"),
            _or_comment("dem", found.dem, "terrain heights"),
        )
    reference = (
        *files,
        *_lines(roads=found.roads, buildings=found.buildings),
        *_lines(woods=found.woods, water=found.water, bridges=found.bridges),
        *(
            f"{_line(key, sigma)}  # {EXPECTED[key]}: check"
            for key, sigma in found.sigmas_m.items()
        ),
    )
    block = (_line("name", found.folder.name), _or_comment("crs", found.crs, "CRS of the ortho"))
    tables = {"block": block, f"camera.{CAMERA}": camera, "scans": scans, "reference": reference}
    tables |= {"control": tuple(_lines(points=found.control))} if found.control else {}
    tables |= {"ortho": tuple(_lines(sheets=found.sheets))} if found.sheets else {}
    text = ["\n".join([f"[{name}]", *lines]) for name, lines in tables.items()]
    text += [
        "\n".join(["[[scans.override]]", _line("file", file), _line("taken", day)])
        for file, day in (days or {}).items()
    ]
    return "\n\n".join(text) + "\n"


def _line(key: str, value: Any) -> str:
    single = isinstance(value, tuple) and len(cast("tuple[Any, ...]", value)) == 1
    return f"{key} = {toml_value(value[0] if single else value)}"


def _lines(**values: object) -> Iterable[str]:
    return (_line(key, value) for key, value in values.items() if value)


def _or_comment(key: str, value: object, what: str) -> str:
    """The line, or a comment that asks for it."""
    return _line(key, value) if value else f"# FILL IN: {what}\n# {key} ="


def _frame_line(side_mm: float | None) -> str:
    if side_mm is None:
        return _or_comment("frame_mm", None, "picture area [width, height], millimetres")
    return _line("frame_mm", [side_mm, side_mm]) + "  # guessed from the size of the scans: check"


def _of_kind(findings: Findings, kind: Kind) -> list[FoundRaster]:
    """Rasters of a kind; a virtual one only where it does not repeat real ones."""
    found = [raster for raster in findings.rasters if raster.kind == kind]
    real = [raster for raster in found if raster.path.suffix.lower() != ".vrt"]
    return real if real and kind != "dem" else found


def _crs_of(
    orthos: Sequence[FoundRaster], dems: Sequence[FoundRaster], layers: Sequence[FoundLayer]
) -> CRS | None:
    """The CRS of most orthos; without them, of most heights, then of most layers."""
    for group in (orthos, dems, layers):
        known = Counter(item.crs for item in group if item.crs is not None)
        if known:
            return known.most_common(1)[0][0]
    return None


def _code(crs: CRS | None) -> str | None:
    """Authority and code, such as `EPSG:5514`, else well-known text."""
    authority = None if crs is None else crs.to_authority()
    return ":".join(authority) if authority else crs and crs.to_wkt()


def _is_same_map(one: CRS, other: CRS) -> bool:
    """True for two spellings of one CRS."""
    epsg = one.to_epsg()
    known = epsg is not None and epsg == other.to_epsg()
    return known or one.equals(other, ignore_axis_order=True)


def _patterns(
    folder: Path, wanted: Sequence[FoundRaster], broken: Collection[Path] = ()
) -> tuple[str, ...]:
    """A glob for each folder and suffix where it means no other file, else the paths.

    Those that are `broken` do not count: of scans the run tells why each was set aside.
    """
    patterns: list[str] = []
    groups: dict[tuple[Path, str], list[Path]] = {}
    for raster in wanted:
        groups.setdefault((raster.path.parent, raster.path.suffix), []).append(raster.path)
    for (parent, suffix), paths in groups.items():
        # Previews and other kinds may lie there as well.
        inside = (path for path in parent.glob(f"*{suffix}") if not path.name.startswith("."))
        if len(paths) > 1 and {path for path in inside if path.is_file()} - {*broken} == {*paths}:
            plain = Path(glob.escape(_relative(folder, parent)))
            patterns.append((plain / f"*{suffix}").as_posix())
        else:
            patterns += [_relative(folder, path) for path in paths]
    return tuple(patterns)


def _finest(rasters: Sequence[FoundRaster]) -> float | None:
    """Smallest pixel, metres: the finest sheets are used first."""
    found = min((raster.pixel_m for raster in rasters if raster.pixel_m), default=None)
    return found and float(f"{found:.3g}")


def _relative(folder: Path, path: Path) -> str:
    return path.relative_to(folder).as_posix()


def _common(values: Iterable[float | None]) -> float | None:
    """The value all agree in."""
    known = set(values)
    return known.pop() if len(known) == 1 else None


def _frame(scans: Sequence[FoundRaster], pixel_um: float | None) -> float | None:
    """The largest common picture that fits on the smaller side of the scans."""
    if not scans or pixel_um is None:
        return None
    side_mm = float(np.median([min(scan.size_px) for scan in scans])) * pixel_um / 1000
    return max((frame for frame in FRAMES_MM if frame <= side_mm + 2), default=None)


def _georeference(
    scans: Sequence[FoundRaster], points: Sequence[Path], footprints: bool
) -> GeoreferenceKind:
    """What most scans can begin from."""
    named = {path.name.removesuffix(path.suffix) for path in points}
    with_points = [scan for scan in scans if {scan.path.name, scan.path.stem} & named]
    if 2 * sum(scan.placed for scan in scans) > len(scans):
        return "world-file"
    if 2 * len(with_points) > len(scans):
        return "points"
    return "footprints" if footprints else "none"


def _footprints(
    layers: Sequence[FoundLayer], scans: Sequence[FoundRaster]
) -> tuple[FoundLayer, str] | None:
    """The polygons and the attribute that name at least half of the scans."""
    stems = {scan.path.stem for scan in scans}
    for layer in layers:
        for field in layer.fields if layer.geometry == "polygon" and stems else ():
            values = layer.values(field)
            named = stems & (values | {Path(value).stem for value in values})
            if 2 * len(named) >= len(stems):
                return layer, field
    return None


def _is_road(layer: FoundLayer) -> bool:
    return layer.geometry == "line" and not layer.named(*_NOT_ROADS)


def _polygons(folder: Path, layers: Sequence[FoundLayer], *words: str) -> str | None:
    found = (item for item in layers if item.geometry == "polygon" and item.named(*words))
    return next((_relative(folder, item.path) for item in found), None)


def _table(folder: Path, findings: Findings, header: tuple[str, ...]) -> str | None:
    """The first CSV file that begins with a header."""
    found = (path for path, names in findings.tables if names[: len(header)] == header)
    return next((_relative(folder, path) for path in found), None)


def _notes(folder: Path, findings: Findings, crs: CRS | None) -> Iterable[Note]:
    for path in findings.unreadable:
        file = _relative(folder, path)
        why = why_unreadable(path) if path.suffix.lower() in RASTERS else ""
        values = {"file": file, "why": why}
        yield Note("broken", values) if why else Note("unreadable", {"file": file})
    yield from _unused(folder, findings)
    try:
        if crs is not None:
            parse_crs(crs.to_wkt(), "The CRS of the reference")
    except CrsError as error:
        yield Note("error", {"text": error.told})
    for item in (*findings.rasters, *findings.layers):
        if isinstance(item, FoundRaster) and item.kind in ("scan", "other"):
            continue
        name = _relative(folder, item.path)
        if item.crs is None:
            yield Note("bare", {"file": name})
        elif crs is not None and not _is_same_map(item.crs, crs):
            other = {"own": short_name(item.crs), "other": short_name(crs)}
            yield Note("transformed", {"file": name, **other})
    for layer in findings.layers:
        if layer.geometry == "line" and not _is_road(layer):
            yield Note("lines", {"file": _relative(folder, layer.path)})


def _unused(folder: Path, findings: Findings) -> Iterable[Note]:
    """Files of which nothing is known to be made; many are not all named."""
    lists = (EXTERIOR_HEADER, CONTROL_HEADER)
    strange = [
        path
        for path, names in findings.tables
        if not any(names[: len(header)] == header for header in lists)
    ]
    other = [raster.path for raster in findings.rasters if raster.kind == "other"]
    for path in sorted([*findings.unused, *strange, *other])[:MOST_UNUSED]:
        yield Note("unused", {"file": _relative(folder, path)})
