"""What is fuzzed: good samples of everything the product reads, and who reads them."""

import json
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from io import StringIO
from pathlib import Path

import numpy as np
import pyogrio.raw
import shapely

import app.verbs.check  # verbs are imported when asked for; here before a hundred processes do it
import app.verbs.doctor
import app.verbs.exchange
import app.verbs.new
import app.verbs.run  # noqa: F401
from app.block_tasks import read_list
from app.cli import main
from app.new_block import recognise
from app.project import read_project
from core.errors import ExchangeError, PhotogrammetryError
from core.formats.eo_list import read_eo_list
from core.formats.exchange import ExchangeFormat, read_format
from core.formats.exchange_formats import FORMATS
from core.formats.listed_point import ListedPoint
from core.formats.outlines import read_footprints
from core.formats.point_list import read_control_points
from core.formats.qgis_points import find_qgis_points, read_qgis_points
from core.formats.records import plain_bytes, read_text
from core.formats.roads import read_roads
from core.formats.tie_list import read_ties
from core.formats.vectors import read_mask_polygons, write_polygons
from core.formats.world_file import read_georeference
from core.geometry.crs import read_crs
from core.matching.learned import check_network
from core.mosaic.seams import read_edited
from core.raster.dem import open_dem
from core.raster.grid import Grid
from core.raster.ortho import open_ortho
from core.raster.scan_file import open_scan, read_window
from core.sheets.map_sheets import read_sheet_index
from core.synthetic.archive import make_block
from core.synthetic.options import CRS, SyntheticOptions
from sessions.codec import to_json
from sessions.decisions import Accept, BringPoints, Place, Reject
from sessions.session import FILE as SESSION
from sessions.session import Session
from sessions.store import Store
from tests.exchanged import block_of
from tests.onnx_files import write_convolution
from ui.review.gestures import gesture_from_message
from ui.web.channel import object_from_text

OWN = (".gruber", "results", SESSION)
"""What a block may hold besides what was put into it."""


@dataclass(frozen=True)
class Target:
    """A good sample and its reader."""

    name: str
    sample: Path
    """Folder that is copied for each case."""
    reads: str
    """What of it is read: a file, or a folder."""
    read: Callable[[Path], object]
    weight: float = 1.0
    first: str = ""
    """The file that is spoilt most often."""
    first_share: float = 0.5
    may_write: tuple[str, ...] = ()
    """What may be written where reading went well, relative to the sample."""
    may_leave: tuple[str, ...] = ()
    """What may be written where it did not."""
    seconds: float = 5.0
    """Longest a case may take."""
    shows_warnings: bool = False
    """Warnings are the reader's own business."""


def all_targets(samples: Path, tiny: Path | None = None, real: Path | None = None) -> list[Target]:
    """Every target.

    Args:
        samples: Folder in which their samples are made.
        tiny: The synthetic block of that size; made where it is not given.
        real: The folder of real data; its samples of exchange are targets, too.
    """
    samples.mkdir(parents=True)
    block = _block(samples, tiny)
    found = [
        *_formats(samples),
        *_parts_of_a_block(samples, block),
        *_blocks(samples, block),
        *_sessions(samples, block),
    ]
    return found if real is None else [*found, *_real(samples, real / "exchange-samples")]


def _block(samples: Path, tiny: Path | None) -> Path:
    """A synthetic block of two scans."""
    folder = samples / "tiny"
    if tiny is None:
        make_block(folder, SyntheticOptions("tiny"))
    else:
        shutil.copytree(tiny, folder)
    shutil.rmtree(folder / "truth")
    for path in sorted((folder / "scans").iterdir())[4:]:
        path.unlink()
    for number, scan in enumerate(sorted((folder / "scans").glob("*.tif"))):
        for path in (scan, scan.with_suffix(".tfw")):
            path.rename(path.with_stem(f"1938_{number:03d}"))
    return folder


def _formats(samples: Path) -> Iterator[Target]:
    """Every format that is read, as we write it, alone and brought into a block."""
    for name, form in FORMATS.items():
        if form.read is None:
            continue
        folder = samples / f"format-{name}"
        _written(form, folder)
        reads = "." if form.folder else form.default_name or name
        # One reader in many dresses counts once.
        weight = 0.3 if name.startswith("eo-") else 1.0
        yield Target(name, folder, reads, partial(read_format, form), weight)


def _written(form: ExchangeFormat, folder: Path) -> None:
    """A small block in a format."""
    folder.mkdir()
    assert form.write is not None
    for seed in (2, 4, 7, 12):
        block = block_of((seed, 3, 2, True), "upright" if form.holds == "nothing" else form.holds)
        try:
            form.write(folder if form.folder else folder / (form.default_name or form.name), block)
        except ExchangeError:
            continue
        return
    raise AssertionError(f"{form.name} holds none of our blocks")


def _real(samples: Path, data: Path) -> Iterator[Target]:
    """What other programs wrote."""
    listed = {
        "colmap": ("colmap", "."), "asp": ("asp", "."), "odm": ("odm", "tmizu_gcp_list.txt"),
        "metashape": ("metashape", "tmizu_marker.xml"),
        "opensfm": ("opensfm", "orthority_odm.json"),
        "micmac": ("micmac-scanned-film/CompensOnLine", "Ori-Rel"),
        "mmvii": ("micmac-v1-and-mmvii", "."),
    }  # fmt: skip
    for name, (folder, reads) in listed.items():
        sample = samples / f"real-{name}"
        shutil.copytree(
            data / folder,
            sample,
            ignore=shutil.ignore_patterns("*.jpg", "*.JPG", "*.tif", "sbcv*", "uclm*"),
        )
        read = partial(read_format, FORMATS[name])
        yield Target(f"real-{name}", sample, reads, read, 0.7)


AROUND = (-1e6, -1.3e6, -4e5, -9e5)
"""Czechia and more, EPSG:5514, metres."""


def _parts_of_a_block(samples: Path, block: Path) -> Iterator[Target]:
    """Readers of single files of a block."""

    def part(
        name: str, source: str, read: Callable[[Path], object], *more: str, weight: float = 1.0
    ) -> Target:
        folder = samples / name
        folder.mkdir()
        for one in (source, *more):
            os.link(block / one, folder / Path(one).name)
        first = Path(source).name
        return Target(name, folder, first, read, weight, first, 0.8)

    _lists(block)
    photos = ("1938_000", "1938_001")
    scan, road = "scans/1938_000.tif", "roads/Ulice"
    ortho = next(f"ortho/{path.name}" for path in sorted((block / "ortho").iterdir()))
    beside = [f"{road}{suffix}" for suffix in (".shx", ".dbf", ".prj", ".cpg")]
    yield part("scan", scan, _scan, "scans/1938_000.tfw", weight=4)
    yield part("world-file", scan, read_georeference, "scans/1938_000.tfw")
    yield part("qgis-points", scan, _clicked, "1938_000.points", weight=0.5)
    yield part("eo-list", "eo.csv", read_eo_list)
    yield part("points-list", "points.csv", partial(read_control_points, crs=CRS), weight=2)
    yield part("tie-list", "ties.csv", partial(read_ties, photos=photos), weight=0.5)
    yield part("dem", "dem.tif", _dem, weight=3)
    yield part("ortho", ortho, _ortho, weight=3)
    yield part("roads", f"{road}.shp", partial(read_roads, crs=CRS), *beside, weight=2)
    yield part(
        "footprints",
        "footprints.gpkg",
        lambda p: read_footprints(p, "LMS_TIF_UP", photos),
        weight=2,
    )
    yield part("mask", "mask.gpkg", lambda p: read_mask_polygons(p, read_crs(CRS, p)), weight=2)
    yield part("mask-json", "mask.geojson", lambda p: read_mask_polygons(p, read_crs(CRS, p)))
    yield part("sheet-index", "sheets.gpkg", partial(read_sheet_index, crs=CRS))
    yield part("edited-seams", "seams.gpkg", lambda p: read_edited(p, CRS, photos))
    yield part("network", "network.onnx", check_network)
    yield part("gestures", "gestures.json", _gestures, weight=2)
    yield part("batch-list", "list.csv", read_list, weight=0.5)


def _lists(block: Path) -> None:
    """What the synthetic block has not, and a block may have."""
    rows = ["scan,X,Y,Z,omega_deg,phi_deg,kappa_deg"]
    rows += [f"1938_00{n},-577776.0,-1192961.0,1631,0.1,-0.2,{n}" for n in range(2)]
    (block / "eo.csv").write_text("\n".join(rows) + "\n")
    rows = [
        f"P{n},{-577776.5 + 100 * n},{-1192961.5 - 90 * n},24{n}.5,0.1,0.2,check" for n in range(6)
    ]
    (block / "points.csv").write_text("\n".join(["id,X,Y,Z,sigma_xy,sigma_z,role", *rows, ""]))
    rows = [f"-57{n}776.5,-1192961.5,{10 * n}.5,-{20 * n}.5,1,0,0,0" for n in range(4)]
    heads = ["#CRS: EPSG:5514", "mapX,mapY,sourceX,sourceY,enable,dX,dY,residual"]
    (block / "1938_000.points").write_text("\n".join([*heads, *rows, ""]))
    rows = [f"T{n},1938_00{s},{100.5 + 7 * n},{90.5 + s},0.3" for n in range(9) for s in range(2)]
    (block / "ties.csv").write_text("\n".join(["point_id,scan,col,row,sigma_px", *rows, ""]))
    (block / "list.csv").write_text("block,priority,until\nhome,3,scans\nother/block.toml,,\n")
    write_convolution(block / "network.onnx", np.ones((4, 1, 3, 3), np.float32))
    (block / "gestures.json").write_text("\n".join(json.dumps(one) for one in GESTURES))
    area = shapely.box(-578000.0, -1193500.0, -577500.0, -1193000.0)
    names = {"name": np.array(["SYNT 2-5"], object), "scan": np.array(["1938_000"], object)}
    for name in ("mask", "sheets", "seams"):
        write_polygons(block / f"{name}.gpkg", name, [area], names, crs=CRS)
    pyogrio.raw.write(
        block / "mask.geojson",
        geometry=np.array([shapely.to_wkb(area)]), field_data=[names["name"]],
        fields=np.array(["name"], object), geometry_type="Polygon", crs=CRS, driver="GeoJSON",
    )  # fmt: skip


GESTURES: tuple[dict[str, object], ...] = (
    {"kind": "judge", "key": ["J1", "a"], "verdict": "reject"},
    {"kind": "judge", "keys": [["J1", "a"], ["J2", "b"]], "verdict": "accept"},
    {"kind": "place", "key": ["J1", "a"], "place": [1, 2], "frame": "scan"},
    {"kind": "step", "step": -7}, {"kind": "answer", "number": 7}, {"kind": "back", "decision": 3},
    {"kind": "layer", "layer": "ties", "shown": 1}, {"kind": "vectors", "scale": 1e9},
    {"kind": "follow", "number": 7, "ray": [1, 2, 3, 0, 0, -1]}, {"kind": "add", "place": [1, 2]},
    {"kind": "quality", "shown": True, "pair": [1, 3]}, {"kind": "name", "name": "Anna"},
    {"kind": "mark", "photo": "a", "name": "1", "place": [3, 4], "snap": True},
    {"kind": "draw", "photo": "a", "strokes": [{"points": [[1, 2], [3, 4], [5, 6]], "wide": 3}]},
)  # fmt: skip
"""What pages send, a line each."""


def _gestures(path: Path) -> object:
    """Messages as the web socket takes them; what is no gesture is passed over."""
    found: list[object] = []
    for line in read_text(path).splitlines():
        with suppress(ValueError):
            found.append(gesture_from_message("seat", object_from_text(line)))
    return found


def _scan(path: Path) -> object:
    scan = open_scan(path)
    return read_window(scan, 10, 10, 400, 400, 4)


def _clicked(path: Path) -> object:
    found = find_qgis_points(path)
    return None if found is None else read_qgis_points(found)


def _dem(path: Path) -> object:
    dem = open_dem([path], CRS)
    west, south, east, north = dem.bounds
    middle = np.array([[(west + east) / 2, (south + north) / 2]])
    return dem.heights(middle), dem.mean_height()


def _ortho(path: Path) -> object:
    ortho = open_ortho([path], CRS)
    west, south, east, north = ortho.sheets.bounds
    return ortho.read_colour(Grid((west + east) / 2, (south + north) / 2, 1.0, 64, 64))


def _blocks(samples: Path, block: Path) -> Iterator[Target]:
    """Whole blocks, through the command line."""
    folder = samples / "block"
    shutil.copytree(block, folder)
    text = (folder / "block.toml").read_text()
    text = text.replace("[scans]\n", '[scans]\nexterior = "eo.csv"\ntaken = "1938-06-21"\n')
    text = text.replace(
        "[reference]\n", '[reference]\nmask = "mask.gpkg"\nbuildings = "mask.geojson"\n'
    )
    text = text.replace("[ortho]\n", '[ortho]\nsheets = "sheets.gpkg"\n')
    text += '\n[control]\npoints = "points.csv"\n\n[adjustment]\ncameras = true\nrisk = 0.05\n'
    text += '\n[[scans.override]]\nfile = "scans/1938_001.tif"\nscan_pixel_um = 180.0\n'
    (folder / "block.toml").write_text(text)
    (folder / "list.csv").unlink()
    first = "block.toml"

    def whole(name: str, weight: float, *arguments: str, share: float = 0.6) -> Target:
        return Target(
            name, folder, ".", partial(_verb, arguments), weight, first, share,
            may_write=OWN, may_leave=OWN, seconds=30 if name == "run" else 10, shows_warnings=True,
        )  # fmt: skip

    yield Target("block.toml", folder, ".", read_project, 8, first, 0.9)
    yield whole("doctor", 8, "doctor", "{block}")
    yield whole("run", 0.5, "run", "{block}", "--until", "georeference", "--workers", "1")
    yield Target("folder", folder, ".", _looked_at, 2, "dem.tif", 0.2)
    for name in ("opensfm", "metashape", "micmac", "colmap"):
        form = FORMATS[name]
        home = samples / f"new-{name}"
        _written(form, home)
        for scan in (folder / "scans").iterdir():
            os.link(scan, home / scan.name)
        files = [path for path in sorted(home.rglob("*")) if path.suffix not in (".tif", ".tfw")]
        yield Target(
            f"new-{name}", home, ".",
            partial(_verb, ("new", "{block}", "--from", name, "--crs", CRS)), 1,
            str(next(path for path in files if path.is_file()).relative_to(home)), 0.9,
            may_write=(*OWN, "brought", "block.toml"), seconds=10, shows_warnings=True,
        )  # fmt: skip
    for name in ("points", "opensfm", "eo", "qgis", "metashape", "micmac", "odm"):
        form = FORMATS[name]
        home = samples / f"import-{name}"
        shutil.copytree(folder, home, copy_function=os.link)
        _written(form, home / "foreign")
        reads = "{block}/foreign" + ("" if form.folder else f"/{form.default_name or name}")
        files = sorted(path for path in (home / "foreign").rglob("*") if path.is_file())
        yield Target(
            f"import-{name}", home, ".",
            partial(_verb, ("import", "{block}", "--from", name, reads)), 1,
            str(files[0].relative_to(home)), 0.9,
            may_write=(*OWN, "brought", "block.toml"), may_leave=OWN,
            seconds=10, shows_warnings=True,
        )  # fmt: skip


def _looked_at(folder: Path) -> object:
    """What `gruber new` and the start page see in a folder."""
    found = recognise(folder)
    return found.found, found.gaps, found.notes


def _verb(arguments: tuple[str, ...], block: Path) -> None:
    """A verb in this process: done, or one line that names what is wrong."""
    given = [one.format(block=block) for one in arguments]
    told, kept, out = StringIO(), sys.stderr, sys.stdout
    sys.stderr, sys.stdout = told, StringIO()
    try:
        code = main(given)
    finally:
        sys.stderr, sys.stdout = kept, out
    lines = told.getvalue().splitlines()
    if code == 0:
        assert not lines, f"said on the side: {lines}"
        return
    assert code == 1, f"ended with {code}: {lines}"
    assert len(lines) == 1, f"{len(lines)} lines: {lines}"
    assert lines[0].startswith("gruber: "), lines
    file, _, rest = lines[0].removeprefix("gruber: ").partition(": ")
    raise PhotogrammetryError(file, rest, "Told.")


def _sessions(samples: Path, block: Path) -> Iterator[Target]:
    """The file of decisions and the kept products."""
    folder = samples / "session"
    folder.mkdir()
    os.link(block / "block.toml", folder / "block.toml")
    with Session.open(folder, "surveyor") as session:
        for number in range(9):
            session.record(Place(f"P{number}", "1938_000", 10.5 + number, 20.5))
            session.record(Accept(f"P{number}", "1938_000"))
        session.record(Reject("P1", "1938_000", "changed"))
        session.products.save_value("scans", "0" * 16, {"a": np.arange(9.0), "b": (1, "x")})
    yield Target("session", folder, ".", _session, 4, SESSION, 0.75, may_write=OWN, may_leave=OWN)
    folder = samples / "decisions"
    folder.mkdir()
    made = [Place("P", "1938_000", 10.5, 20.5), Accept("P", "1938_000"), _brought()]
    (folder / "decisions.json").write_text(json.dumps([to_json(one) for one in made]))
    yield Target("decisions", folder, "decisions.json", _decisions, 3, may_write=OWN, may_leave=OWN)


def _brought() -> BringPoints:
    point = ListedPoint("P", -577776.5, -1192961.5, 240.5, (0.1, 0.1, 0.2))
    return BringPoints((point,), "points.csv")


def _session(folder: Path) -> object:
    with Session.open(folder, "surveyor") as session:
        known = session.decisions()
        session.record(Accept("P9", "1938_000"))
        return known, session.products.latest_value("scans")


def _decisions(path: Path) -> object:
    """Decisions in a sound file, as another version or another hand may have put them there."""
    try:
        rows = json.loads(plain_bytes(path))
    except (OSError, ValueError, RecursionError):
        return None
    store = Store.open(path.parent / SESSION)
    for row in rows if isinstance(rows, list) else [rows]:
        store.append("2026-01-01T00:00:00.000+00:00", "x", [("Place", json.dumps(row))])
    store.close()
    with Session.open(path.parent, "surveyor") as session:
        return [one.decision for one in session.decisions()]
