"""`block.toml`: read into a frozen value, or refused with line and remedy."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import shapely
from pyogrio import raw

from app.block_form import BlockForm
from app.bring_points import brought_points
from app.new_block import recognise
from app.project import Project, described, read_project
from core.adjustment.adjusted import AdjustmentOptions
from core.errors import PhotogrammetryError, ProjectError
from core.formats.listed_point import ListedPoint
from core.matching.learned import LearnedOperator
from core.matching.operators import FusedOperator
from sessions.decisions import BringPoints
from sessions.products import digest_of
from sessions.session import Session
from tests.onnx_files import write_convolution

TOML = """
[block]
name = "kobyli-1938"
crs = "EPSG:5514"
heights = "Bpv"

[camera.wide]
principal_distance_mm = 211.59
frame_mm = [180.0, 180]
fiducials_mm = { 1 = [-84.5, 0.3], 2 = [84.5, -0.2] }

[scans]
files = "scans/*.tif"
camera = "wide"
scan_pixel_um = 15.0

[reference]
ortho = "ortho/*.tif"
dem = "dem.tif"
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("scans/b.tif", "scans/a.tif", "scans/.hidden.tif", "ortho/1.tif", "dem.tif"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    return tmp_path


def read(folder: Path, toml: str = TOML) -> Project:
    (folder / "block.toml").write_text(toml)
    return read_project(folder)


def put(line: str, table: str = "scans") -> str:
    """The file with one more line in a table."""
    return TOML.replace(f"[{table}]\n", f"[{table}]\n{line}\n")


def swap(key: str, value: str) -> str:
    """The file with another value of a key."""
    return re.sub(rf"(?m)^{key} = .*$", f"{key} = {value}", TOML)


def test_defaults_are_those_of_the_manual__truth(folder: Path) -> None:
    project = read(folder)
    assert [scan.photo_id for scan in project.scans.listed] == ["a", "b"]
    assert project.scans.listed[0].path == folder / "scans" / "a.tif"
    assert (project.scans.georeference, project.scans.footprint_name) == (
        "world-file",
        "LMS_TIF_UP",
    )
    assert (project.reference.ortho_sigma_m, project.reference.dem_sigma_m) == (None, None)
    assert project.reference.roads == ()
    assert project.ortho.gsd_m is None
    camera = project.cameras["wide"]
    assert camera.principal_point_mm == (0.0, 0.0)
    assert camera.radial_distortion == (0.0, 0.0, 0.0)
    assert camera.fiducials_mm["1"] == (-84.5, 0.3)
    assert project.folder == folder


PROMISE = """
[block]
name = "kobyli-1938"
crs  = "EPSG:5514"                       # horizontal; X east, Y north
heights = "Bpv"                          # or "EPSG:8357"

[camera.wide]
principal_distance_mm = 211.59           # left out: proposed and estimated
frame_mm = [180.0, 180.0]                # picture area, width and height
principal_point_mm = [0.0, 0.0]          # from the fiducial centre; optional
radial_distortion = []                   # k1, k2, k3 for r in mm; optional
fiducials_mm = { 1 = [-84.5, 0.3], 2 = [84.5, -0.2], 3 = [0.2, 84.5], 4 = [-0.1, -84.5] }

[scans]
files = "scans/*.tif"
camera = "wide"                          # or [[scans.override]] per file
scan_pixel_um = 15.0
footprints = "footprints.gpkg"           # optional; attribute with the file name:
footprint_name = "LMS_TIF_UP"
exterior = "eo.csv"                      # optional: scan,X,Y,Z,omega_deg,phi_deg,kappa_deg
georeference = "world-file"              # world-file | points | footprints | none
taken = "1938-06-21"                     # optional: date, or table of file and time

[reference]
ortho = "ortho/*.tif"
dem = "dem.tif"
roads = ["roads/SilniceDalnice.shp", "roads/Ulice.shp", "roads/Cesta.shp"]
ortho_sigma_m = 0.25                     # accuracy of the reference
dem_sigma_m = 0.5
buildings = "buildings.gpkg"             # optional: seams keep 5 m away from them
bridges = "bridges.gpkg"                 # optional 3D polygons
mask = "changed.gpkg"                    # optional: where nothing may be matched

[[reference.other]]                      # optional: further references

[control]                                # optional: surveyed points the user already has
points = "points.csv"                    # id,X,Y,Z,sigma_xy,sigma_z,role

[ortho]
gsd_m = 0.5
sheets = "sm5.gpkg"                      # optional: map sheets to cut; attribute `name`
"""
"""The example of the contract, section 2."""
OTHER = """[[reference.other]]
ortho = "1957/*.tif"
dem = "1957/dem.tif"
year = 1957
ortho_sigma_m = 0.4
dem_sigma_m = 1.0
"""


@pytest.fixture
def promised(folder: Path) -> Path:
    """The files that the example of the contract names."""
    shape = [shapely.to_wkb(shapely.box(0, 0, 1, 1))]
    for name, attribute in (("footprints", "LMS_TIF_UP"), ("sm5", "name")):
        raw.write(
            folder / f"{name}.gpkg",
            np.array(shape, object),
            [np.array(["a"], object)],
            [attribute],
            geometry_type="Polygon",
            crs="EPSG:5514",
        )
    roads = [f"roads/{name}.shp" for name in ("SilniceDalnice", "Ulice", "Cesta")]
    layers = [f"{name}.gpkg" for name in ("buildings", "bridges", "changed")]
    for name in ("eo.csv", "points.csv", "1957/1.tif", "1957/dem.tif", *roads, *layers):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).touch()
    return folder


def test_every_example_of_the_promise_is_read__paper(promised: Path) -> None:
    project = read(promised, PROMISE)
    scans, reference = project.scans, project.reference
    assert (project.block.name, project.block.heights) == ("kobyli-1938", "Bpv")
    assert len(project.cameras["wide"].fiducials_mm) == 4
    assert (scans.footprints, scans.exterior) == (promised / "footprints.gpkg", promised / "eo.csv")
    assert project.taken == {"a": "1938-06-21", "b": "1938-06-21"}
    assert [road.stem for road in reference.roads] == ["SilniceDalnice", "Ulice", "Cesta"]
    assert (reference.ortho_sigma_m, reference.dem_sigma_m) == (0.25, 0.5)
    layers = (reference.buildings, reference.bridges, reference.mask)
    assert layers == tuple(promised / f"{n}.gpkg" for n in ("buildings", "bridges", "changed"))
    assert reference.other == ()
    assert project.control.points == promised / "points.csv"
    assert (project.ortho.gsd_m, project.sheets.index) == (0.5, promised / "sm5.gpkg")


def test_further_references_are_read_as_the_reference_is__law(promised: Path) -> None:
    text = PROMISE.replace("[[reference.other]]  ", f"{OTHER}[[reference.other]]  ")
    (other,) = read(promised, text).reference.other
    assert other.ortho == (promised / "1957/1.tif", promised / "1957/dem.tif")
    assert (other.dem, other.year) == ((promised / "1957/dem.tif",), 1957)
    assert (other.ortho_sigma_m, other.dem_sigma_m) == (0.4, 1.0)
    assert other.name(promised) == "1957 (1957)"
    line = text[: text.index("year = 1957")].count("\n") + 1
    for wrong, cause in (
        ("year = 19570", f"block.toml:{line} .reference.other. year: 19570 is outside"),
        ("year = 1957.5", f"block.toml:{line} .reference.other. year: 1957.5 is no whole number"),
        ("years = 1957", f"block.toml:{line} .reference.other. years: is no key"),
    ):
        with pytest.raises(ProjectError, match=cause):
            read(promised, text.replace("year = 1957", wrong))
    with pytest.raises(ProjectError, match="neither an ortho nor heights"):
        read(promised, PROMISE.replace("[[reference.other]]", "[[reference.other]]\nyear = 1957"))


def test_ties_to_another_year_ask_for_years__law(folder: Path) -> None:
    other, undated = '[[reference.other]]\northo = "ortho/1.tif"\nties = true\n', "year = 1953\n"
    for more, remedy in (("", "Add year"), (undated, r"Add taken to \[scans\]")):
        with pytest.raises(ProjectError, match=f"reference.other. ties: .*{remedy}, or leave"):
            read(folder, TOML + other + more)
    dated = TOML.replace('camera = "wide"', 'camera = "wide"\ntaken = "1938"')
    assert read(folder, dated + other + undated).reference.other[0].ties


def test_file_or_folder_is_the_same__truth(folder: Path) -> None:
    assert read(folder) == read_project(folder / "block.toml")


def test_a_linked_file_counts_where_the_link_is__law(folder: Path, tmp_path: Path) -> None:
    """Results went to the folder that it points to."""
    (tmp_path / "written.toml").write_text(TOML, encoding="utf-8")
    own = tmp_path / "own"
    for part in ("scans", "ortho"):
        shutil.copytree(folder / part, own / part)
    (own / "dem.tif").touch()
    (own / "block.toml").symlink_to(tmp_path / "written.toml")
    (tmp_path / "linked").symlink_to(own)
    for named in (own, own / "block.toml", tmp_path / "linked"):
        project = read_project(named)
        assert project.folder == own
        assert project.scans.listed[0].path == own / "scans" / "a.tif"


def test_real_block_is_read__real(shared_data: Path) -> None:
    project = read_project(shared_data / "vovcha-film")
    assert len(project.scans.listed) == 6
    assert len(project.reference.roads) == 2


def test_overrides_change_and_exclude_single_scans__truth(folder: Path) -> None:
    text = TOML.replace(
        "[scans]", "[camera.other]\nprincipal_distance_mm=152\nframe_mm=[230,230]\n[scans]"
    )
    text += '[[scans.override]]\nfile = "a.tif"\ncamera = "other"\nscan_pixel_um = 20\n'
    text += '[[scans.override]]\nfile = "scans/b*"\nexclude = true\n'
    (only,) = read(folder, text).scans.listed
    assert (only.photo_id, only.camera, only.scan_pixel_um) == ("a", "other", 20.0)


def test_days_of_exposure_hold_for_all_scans_or_for_one__truth(folder: Path) -> None:
    text = TOML.replace("[scans]", '[scans]\ntaken = "1938-05"')
    text += '[[scans.override]]\nfile = "a.tif"\ntaken = "1938-05-16"\n'
    taken = read(folder, text).taken
    assert taken.pop("a") == "1938-05-16"
    assert set(taken.values()) == {"1938-05"}


@pytest.mark.parametrize(
    ("line", "days"),
    [
        ("taken = 1938-06-21", ("1938-06-21", "1938-06-21")),
        ("taken = 1938-06-21T10:15:00", ("1938-06-21", "1938-06-21")),
        ('taken = "1938-06-21T10:15"', ("1938-06-21", "1938-06-21")),
        ('taken = "1938-06-21 10:15:30+01:00"', ("1938-06-21", "1938-06-21")),
        ('taken = { "a.tif" = 1938-06-21, b = 1938-07-01T09:30:00 }', ("1938-06-21", "1938-07-01")),
        ('taken = { "scans/b.*" = "1938" }', ("", "1938")),
        ('taken = "times.csv"', ("1938-06-21", "1938-07")),
    ],
)  # fmt: skip
def test_times_of_exposure_are_dates_or_a_table__law(
    folder: Path, line: str, days: tuple[str, str]
) -> None:
    """What the contract promises of `taken`; seams and items know the day alone."""
    rows = "file,time\na.tif,1938-06-21 10:15\nelsewhere.tif,1937\nb,1938-07\n"
    (folder / "times.csv").write_text(rows, encoding="utf-8")
    project = read(folder, put(line))
    assert tuple(project.taken.get(name, "") for name in "ab") == days
    found = BlockForm(folder / "block.toml").read(recognise(folder))
    assert found.judged.errors == {}
    told = [one for part in found.sections for one in part["fields"] if one["key"] == "taken"]
    json.dumps(told)
    assert bool(told) == ("{" not in line)


@pytest.mark.parametrize(
    ("line", "cause"),
    [
        ("taken = 10:15:00", '"10:15:00" is no date'),
        ('taken = "1938-06-21T25:00"', "is no date"),
        ('taken = { "c.tif" = "1938" }', '"c.tif" matches none of the scans. Correct it'),
        ('taken = { "a.tif" = "May" }', '"May" is no date'),
        ('taken = "nowhere.csv"', '"nowhere.csv" is not there'),
        ('taken = "bad.csv"', 'bad.csv: Line 2: "May" is no date'),
        ('taken = "strange.csv"', '"c.tif" matches none of the scans'),
    ],
)
def test_times_that_cannot_be_used_are_refused__law(folder: Path, line: str, cause: str) -> None:
    (folder / "bad.csv").write_text("file,time\na.tif,May\n", encoding="utf-8")
    (folder / "strange.csv").write_text("file,time\nc.tif,1938\n", encoding="utf-8")
    with pytest.raises(ProjectError, match=re.escape(cause)):
        read(folder, put(line))


MISTAKES = {
    "no day": (
        TOML.replace("[scans]", '[scans]\ntaken = "16.5.1938"'),
        r'taken: "16.5.1938" is no date .* when film was exposed. Write a day, a month or a year',
    ),
    "unknown key": (
        put('camra = "x"'),
        r":13 \[scans\] camra: is no key .* Did you mean `camera`\?",
    ),
    "unknown table": (TOML + "[refrence]\n", r":20 refrence: is no key .* `reference`\?"),
    "operator": (
        TOML + '[control]\noperators = ["magic"]\n',
        r"'magic' is no operator.*Write a list of ncc",
    ),
    "no table": (TOML.replace("[block]", "[control]"), r"has no \[block\]. Add it"),
    "no camera": (re.sub(r"\[camera.wide\]\n(.+\n)+", "", TOML), "describes no camera"),
    "nameless camera": (TOML.replace("[camera.wide]", "[camera]"), "describes no camera"),
    "missing key": (swap("frame_mm", "").replace("frame_mm = \n", ""), r"frame_mm: is missing"),
    "not toml": (TOML + "x = [1,\n", r"not valid TOML: .*line"),
    "metres": (swap("principal_distance_mm", "0.21159"), r":8 .*looks like metres: write 211.59"),
    "micrometres": (swap("principal_distance_mm", "211590"), r"micrometres: write 211.59"),
    "words": (swap("principal_distance_mm", '"211.59"'), r"must be a number, not '211.59'"),
    "truth": (swap("scan_pixel_um", "true"), r"must be a number, not True"),
    "millimetres": (swap("scan_pixel_um", "0.015"), r":15 .*looks like millimetres: write 15\."),
    "dots per inch": (swap("scan_pixel_um", "1693.33"), r"looks like dots per inch: write 15"),
    "nought": (swap("scan_pixel_um", "0"), r"Write it in micrometres, from 3 to 500"),
    "one side": (
        swap("frame_mm", "[180.0]"),
        r"must be 2 numbers, not \[180.0\]. Write \[0.0, 0.0\]",
    ),
    "frame in m": (swap("frame_mm", "[0.18, 0.18]"), r"looks like metres: write 180"),
    "far fiducial": (swap("fiducials_mm", "{ 1 = [-5633, 20], 2 = [1, 1] }"), "mark 1 lies far"),
    "one fiducial": (swap("fiducials_mm", "{ 1 = [-84, 0] }"), "one mark alone"),
    "far principal point": (put("principal_point_mm = [95, 0]", "camera.wide"), "lies outside"),
    "five distortions": (put("radial_distortion = [1, 2, 3, 4, 5]", "camera.wide"), "3 numbers"),
    "undefined camera": (swap("camera", '"wild"'), r'"wild" is not known. Did you mean `wide`'),
    "georeference": (put('georeference = "worldfile"'), r"Did you mean `world-file`\?"),
    "no footprints": (put('georeference = "footprints"'), "there are no footprints"),
    "missing file": (
        swap("dem", '"dmr.tif"'),
        r'"dmr.tif" is not there. .* holds block.toml, dem.tif',
    ),
    "folder for a file": (swap("dem", '"scans"'), r'"scans" is a folder'),
    "no match": (swap("files", '"scans/*.jpg"'), r"matches no file. .*scans holds a.tif, b.tif"),
    "no folder": (swap("files", '"film/*.tif"'), r"There is no folder .*film"),
    "two lists": (put('exterior = "scans/*.tif"'), r"must be one file but matches 2: a.tif, b.tif"),
    "path number": (swap("files", "3"), "must be a path or a list of paths, not 3"),
    "footprint file": (put('footprints = "dem.tif"'), "dem.tif cannot be opened"),
    "override": (TOML + '[[scans.override]]\nfile="c.tif"\n', r":21 .*matches none of the scans"),
    "all out": (TOML + '[[scans.override]]\nfile="*"\nexclude=true\n', "all scans are excluded"),
    "one bracket": (TOML + '[scans.override]\nfile="a.tif"\n', "Write \\[\\[scans.override\\]\\]"),
    "exclude": (TOML + '[[scans.override]]\nfile="*"\nexclude="yes"\n', "must be true or false"),
    "crs": (swap("crs", '"EPSG:55144"'), r":4 .*does not know the CRS 'EPSG:55144'"),
    "geographic": (swap("crs", '"EPSG:4326"'), r":4 .*does not count in metres .*Give a projected"),
    "positive krovak": (swap("crs", '"EPSG:5513"'), r"south and west, .*that is EPSG:5514"),
    "feet": (swap("crs", '"EPSG:2263"'), "counts in US survey foot, not in metres"),
    "name": (swap("name", r'"a\\nb"'), r":3 .*line break or control character"),
    "heights": (swap("heights", '"EPSG:5514"'), "is no height system"),
}


def test_a_folder_or_a_broken_link_called_as_a_scan_is_told__law(folder: Path) -> None:
    (folder / "block.toml").write_text(TOML, encoding="utf-8")
    for odd, made in (("c.tif", Path.mkdir), ("d.tif", lambda path: path.symlink_to("nowhere"))):
        made(folder / "scans" / odd)
        with pytest.raises(ProjectError, match=f"matches .*{odd}, which is not a file"):
            read_project(folder)
        (folder / "scans" / odd).rename(folder / odd)


@pytest.mark.parametrize(("toml", "message"), MISTAKES.values(), ids=MISTAKES.keys())
def test_each_mistake_names_the_line_and_the_remedy__truth(
    folder: Path, toml: str, message: str
) -> None:
    with pytest.raises(PhotogrammetryError) as caught:
        read(folder, toml)
    told = str(caught.value)
    assert re.search(message, told), told
    assert told.startswith(str(folder / "block.toml"))
    assert caught.value.remedy


def test_an_operator_this_machine_lacks_is_refused__truth(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.project.has_akaze", lambda: False)
    with pytest.raises(PhotogrammetryError, match=r"has no AKAZE\. Take another"):
        read(folder, TOML + '[control]\noperators = ["akaze"]\n')
    monkeypatch.setattr("app.project.has_akaze", lambda: True)
    assert read(folder, TOML + '[control]\noperators = "akaze"\n').control.operators == ("akaze",)


def test_the_learned_operator_needs_a_network__truth(folder: Path) -> None:
    with pytest.raises(ProjectError, match=r'"learned" has no network\. Name the ONNX file'):
        read(folder, TOML + '[control]\noperators = ["learned"]\n')
    (folder / "net.onnx").write_bytes(b"no network")
    asked = '[control]\noperators = ["learned", "fused"]\nlearned = "net.onnx"\n'
    with pytest.raises(ProjectError, match="no network that OpenCV can run"):
        read(folder, TOML + asked)
    file = write_convolution(folder / "net.onnx", np.ones((2, 1, 3, 3), np.float32))
    # The reference of this block is none that could be opened.
    stated = '"dem.tif"\northo_sigma_m = 0.3\ndem_sigma_m = 0.5\n'
    project = read(folder, TOML.replace('"dem.tif"\n', stated) + asked)
    assert project.control.learned == file
    given = described(project).localisation.orientation
    assert given.operators == (LearnedOperator(file), FusedOperator())
    before = digest_of(given)
    write_convolution(file, np.full((2, 1, 3, 3), 2.0, np.float32))
    assert digest_of(given) != before
    # Nobody asks for it: it is not looked at, and nothing depends on it.
    unasked = read(folder, TOML + '[control]\nlearned = "net.onnx"\n')
    assert unasked.control.learned is None


def test_missing_attribute_names_those_that_are_there__truth(folder: Path) -> None:
    raw.write(
        folder / "footprints.gpkg",
        np.array([shapely.to_wkb(shapely.box(0, 0, 1, 1))], object),
        [np.array(["a"], object)],
        ["LMS_TIF_UP"],
        geometry_type="Polygon",
        crs="EPSG:5514",
    )
    with pytest.raises(ProjectError, match=r'no attribute "scan". It has LMS_TIF_UP'):
        read(folder, put('footprints = "footprints.gpkg"\nfootprint_name = "scan"'))


def test_a_folder_of_two_lines_is_refused_by_name__truth(folder: Path, tmp_path: Path) -> None:
    """GDAL told of a good file that nobody knew what it was."""
    odd = tmp_path / "two\nlines"
    shutil.copytree(folder, odd)
    with pytest.raises(ProjectError, match="line break"):
        read_project(odd)


def test_missing_block_points_to_gruber_new__truth(tmp_path: Path) -> None:
    with pytest.raises(ProjectError, match=f"is not there. `gruber new {tmp_path}` writes one"):
        read_project(tmp_path)


def test_two_scans_of_one_name_are_told__truth(folder: Path) -> None:
    (folder / "ortho" / "a.tif").touch()
    with pytest.raises(ProjectError, match="two scans are called a"):
        read(folder, swap("files", '["scans/*.tif", "ortho/*.tif"]'))


def test_one_layer_of_a_file_is_named_as_qgis_does__truth(folder: Path) -> None:
    (folder / "change.gpkg").write_bytes(b"")
    project = read(
        folder, TOML.replace("[reference]", '[reference]\nmask = "change.gpkg|layername=different"')
    )
    assert project.reference.mask == Path(f"{folder / 'change.gpkg'}|layername=different")


def test_a_glob_character_in_the_folder_is_no_glob__truth(folder: Path) -> None:
    odd = folder / "block [1938]"
    odd.mkdir()
    for name in ("scans", "ortho", "dem.tif"):
        (folder / name).rename(odd / name)
    assert len(read(odd).scans.listed) == 2


# ------------------------------------------------------------------ [adjustment]


def with_adjustment(*lines: str) -> str:
    return TOML + "\n[adjustment]\n" + "\n".join(lines) + "\n"


def test_adjustment_is_optional_and_every_key_is_read__truth(folder: Path) -> None:
    assert read(folder).adjustment == AdjustmentOptions()
    toml = with_adjustment(
        "cameras = false",
        'self_calibration = ["tangential", "ebner12"]',
        'self_calibration_per = "photo"',
        "sigma_additional_um = 5",
        'gnss_shift = "strip"',
        "gnss_drift = true",
        "imu_misalignment = true",
        "dem_sigma_m = 2.5",
        'network = "free"',
        "variance_components = true",
        'gross_errors = "tau"',
        "risk = 0.01",
        "only_significant = false",
    )
    given = read(folder, toml).adjustment
    assert given == AdjustmentOptions(
        estimate_cameras=False,
        self_calibration=("tangential", "ebner12"),
        per_photo=True,
        sigma_additional_um=5.0,
        only_significant=False,
        gnss_shift="strip",
        gnss_drift=True,
        misalignment=True,
        dem_sigma_m=2.5,
        free_network=True,
        variance_components=True,
        test="tau",
        risk=0.01,
    )
    assert not read(folder, with_adjustment('gross_errors = "none"')).adjustment.robust


def test_control_is_judged_by_cameras_as_they_are_adjusted__truth(folder: Path) -> None:
    """Cameras that are held were estimated with control, and the estimate was held."""
    held = with_adjustment("cameras = false", "sigma_principal_point_mm = 0.02", "risk = 0.01")
    # The reference of this block is none that could be opened.
    stated = '"dem.tif"\northo_sigma_m = 0.3\ndem_sigma_m = 0.5\n'
    control = described(read(folder, held.replace('"dem.tif"\n', stated))).control.adjustment
    assert control == AdjustmentOptions(estimate_cameras=False, sigma_principal_point_mm=0.02)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ('self_calibration = ["ebner"]', "'ebner' is no set of parameters"),
        ('self_calibration = ["ebner12", "affinity"]', "hold the same terms more than once"),
        ("self_calibration = 3", "must be a list of sets"),
        ('gnss_shift = "photo"', '"photo" is not known'),
        ("risk = 0.5", "0.5 is outside what it can be"),
        ("variance_component = true", "is no key of this table"),
    ],
)
def test_wrong_adjustment_keys_are_named__law(folder: Path, line: str, said: str) -> None:
    with pytest.raises(ProjectError, match=r"block.toml:\d+ \[adjustment\]") as caught:
        read(folder, with_adjustment(line))
    assert said in str(caught.value)


ALONE = TOML.partition("[reference]")[0]


def test_surveyed_points_or_orientations_stand_in_for_a_reference__truth(folder: Path) -> None:
    rows = ["id,X,Y,Z,sigma_xy,sigma_z,role", "A,-740000,-1040000,200,0.1,0.1,control"]
    rows += ["B,-739000,-1041000,220,0.1,0.1,control", "C,-739500,-1040500,900,0.1,0.1,check"]
    (folder / "points.csv").write_text("\n".join(rows))
    project = read(folder, ALONE + '[control]\npoints = "points.csv"\n')
    assert (project.reference.ortho, project.reference.dem) == ((), ())
    files = described(project).reference
    # Check points have no say, not even in the height of the ground.
    assert files.level_m == 210.0
    assert files.area == (-740000.0, -1041000.0, -739000.0, -1040000.0)
    (folder / "eo.csv").write_text("scan,X,Y,Z\na,0,0,0\n")
    listed = ALONE.replace("scan_pixel_um", 'exterior = "eo.csv"\nscan_pixel_um')
    assert not described(read(folder, listed)).reference.knows_ground


def test_points_brought_at_the_desk_stand_in_for_a_reference__truth(folder: Path) -> None:
    with Session.open(folder, "anna") as session:
        listed = [ListedPoint("A", -740000.0, -1040000.0, 200.0, (0.1, 0.1, 0.1))]
        listed.append(ListedPoint("B", -739000.0, -1041000.0, 220.0, (0.1, 0.1, 0.1)))
        session.record(BringPoints(tuple(listed), "list.csv"))
        files = described(read(folder, ALONE), brought_points(session)).reference
    assert files.level_m == 210.0
    assert files.area == (-740000.0, -1041000.0, -739000.0, -1040000.0)


def test_without_reference_points_and_orientations_the_error_says_what_to_add__truth(
    folder: Path,
) -> None:
    with pytest.raises(ProjectError, match="nothing else says where the block lies") as told:
        read(folder, ALONE)
    assert "[control] points" in told.value.remedy
    with pytest.raises(ProjectError, match="without heights an ortho gives no control"):
        read(folder, TOML.replace('dem = "dem.tif"\n', ""))
