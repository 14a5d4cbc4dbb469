"""What a user may hand in by mistake: one message with file, cause and remedy, or a scan set aside.

Each goes through the command line itself, on a copy of one synthetic block.
"""

import json
import re
from collections.abc import Callable

import numpy as np
import pytest

from tests.journeys.copies import BlockCopy, gruber
from tests.journeys.spoiling import (
    Axes,
    add_line,
    cut_off,
    exterior_list,
    exterior_placed,
    pixels_changed,
    points_placed,
    positive,
    positive_swapped,
    raster_placed,
    swapped,
    vector_changed,
    without,
    world_files,
)

CopyOf = Callable[..., BlockCopy]
Spoil = Callable[[BlockCopy], object]
Capsys = pytest.CaptureFixture[str]
ORTHO = "ortho/ORTO24.2022.SYNT25.tif"
ROADS = "roads/SilniceDalnice.shp"


def scan_replaced(content: bytes) -> Spoil:
    return lambda copy: copy.replace(copy.scans[0], content)


def scan_cropped(copy: BlockCopy) -> None:
    pixels_changed(copy, f"scans/{copy.scans[0].name}", lambda values: values[:, :600, :600])


def scan_of_reals(copy: BlockCopy) -> None:
    pixels_changed(copy, f"scans/{copy.scans[0].name}", lambda v: v.astype(np.float32))


def scan_damaged(copy: BlockCopy) -> None:
    name = f"scans/{copy.scans[0].name}"
    pixels_changed(copy, name, lambda values: values, compress="deflate")
    content = bytearray((copy.folder / name).read_bytes())
    middle = len(content) // 2
    content[middle : middle + 20_000] = bytes(20_000)
    copy.replace(name, bytes(content))


def world_file(text: str) -> Spoil:
    return lambda copy: copy.replace(copy.scans[0].with_suffix(".tfw"), text)


def far_away(copy: BlockCopy) -> None:
    """A world file ten kilometres off: near enough to be believed, too far to be of use."""
    path = copy.scans[0].with_suffix(".tfw")
    *linear, east, north = path.read_text().split()
    copy.replace(path, "\n".join([*linear, f"{float(east) + 10_000}", north]))


BAD_SCANS: dict[str, tuple[Spoil, str, tuple[str, ...]]] = {
    "no image": (scan_replaced(b"no image " * 99), ".tif", ("not an image", "Copy the scan again")),
    "empty": (scan_replaced(b""), ".tif", ("is empty", "Copy the scan again")),
    "truncated": (
        lambda copy: cut_off(copy, f"scans/{copy.scans[0].name}"),
        ".tif",
        ("was cut off", "Copy the scan again"),
    ),
    "damaged in the middle": (scan_damaged, ".tif", ("cut off", "Copy the scan again")),
    "of another size": (
        scan_cropped,
        ".tif",
        ("600 x 600 pixels of 180 µm", "does not fit the 180 x 180 mm frame", "[[scans.override]]"),
    ),
    "of real numbers": (scan_of_reals, ".tif", ("float32", "Save the scan as an 8 or 16 bit")),
    "words in the world file": (world_file("1 2 three"), ".tfw", ("six numbers", "Write A, D, B")),
    "no area in the world file": (
        world_file("1 1 1 1 -577000 -1192000"),
        ".tfw",
        ("no area", "in this order"),
    ),
    "world file mirrored": (
        world_file("1.2 0 0 1.2 -578000 -1192000"),
        ".tfw",
        ("mirrored", "Turn the scan over"),
    ),
    "world file of nowhere": (
        world_file("1.2 0 0 -1.2 0 0"),
        ".tfw",
        ("km outside the area EPSG:5514", "Check the CRS"),
    ),
    "world file of another place": (
        far_away,
        ".tif",
        ("km outside the DEM", "Correct its world file"),
    ),
}


@pytest.mark.parametrize("name", BAD_SCANS)
def test_a_scan_that_cannot_be_used_is_set_aside_and_the_rest_goes_on__truth(
    name: str, copy_of: CopyOf, capsys: Capsys
) -> None:
    spoil, suffix, words = BAD_SCANS[name]
    copy = copy_of(2)
    bad = copy.scans[0].with_suffix(suffix)
    spoil(copy)
    told = gruber(capsys, "run", copy.folder, "--until", "georeference")
    assert (told.code, told.err) == (0, "")
    assert "1 photo placed" in told.out
    said = [line for line in told.out.splitlines() if line.startswith("Set aside: ")]
    assert len(said) == 1
    rest = said[0]
    for word in (str(bad), *words):
        _, found, rest = rest.partition(word)
        assert found, f"{word!r} not in: {said[0]}"


def every_scan(spoil_name: str) -> Spoil:
    """The same slip with the only scan there is."""
    return BAD_SCANS[spoil_name][0]


def nothing_known(copy: BlockCopy) -> None:
    for path in (copy.folder / "scans").glob("*.tfw"):
        path.unlink()
    without(copy, "footprints", "footprint_name")


def placed(name: str) -> Callable[[Axes], Spoil]:
    return lambda axes: lambda copy: raster_placed(copy, name, axes)


def shifted(metres: float) -> Axes:
    return lambda east, north: (east + metres, north)


def all_nodata(copy: BlockCopy) -> None:
    pixels_changed(copy, "dem.tif", lambda v: np.full_like(v, -9999), nodata=-9999)


def flat_ortho(copy: BlockCopy) -> None:
    for path in sorted((copy.folder / "ortho").glob("*.tif")):
        pixels_changed(copy, f"ortho/{path.name}", lambda values: np.full_like(values, 100))


def footprints_only(copy: BlockCopy) -> None:
    for path in (copy.folder / "scans").glob("*.tfw"):
        path.unlink()
    copy.setting("georeference", '"footprints"')


def footprints_placed(axes: Axes) -> Spoil:
    def spoil(copy: BlockCopy) -> None:
        footprints_only(copy)
        vector_changed(copy, "footprints.gpkg", axes)

    return spoil


REFUSED: dict[str, tuple[Spoil, tuple[str, ...]]] = {
    "no scan where the glob looks": (
        lambda copy: copy.setting("files", '"scan/*.tif"'),
        ("block.toml:", "[scans] files", "matches no file", "Correct the path"),
    ),
    "the only scan is no image": (
        every_scan("no image"),
        ("scans/", ".tif", "not an image", "Copy the scan again"),
    ),
    "the only scan is truncated": (
        every_scan("truncated"),
        ("scans/", ".tif", "cut off", "Copy the scan again"),
    ),
    "another scan pixel than the frame's": (
        lambda copy: copy.setting("scan_pixel_um", "60.0"),
        ("scans/", "does not fit", "Check scan_pixel_um"),
    ),
    "a frame in centimetres": (
        lambda copy: copy.setting("frame_mm", "[18.0, 18.0]"),
        ("block.toml:", "[camera.archive] fiducials_mm", "far outside", "Write millimetres"),
    ),
    "fiducials in centimetres": (
        lambda copy: copy.setting("frame_mm", "[1800.0, 1800.0]"),
        ("block.toml:", "[camera.archive] fiducials_mm", "in the middle", "Write millimetres"),
    ),
    "nothing says where": (
        nothing_known,
        ("scans/", "Nothing says where", "Give a world file, a footprint"),
    ),
    "an unknown CRS": (
        lambda copy: copy.setting("crs", '"EPSG:99999"'),
        ("block.toml:", "[block] crs", "does not know the CRS", "Give an EPSG code"),
    ),
    "a CRS in degrees": (
        lambda copy: copy.setting("crs", '"EPSG:4326"'),
        ("block.toml:", "[block] crs", "does not count in metres", "Give a projected CRS"),
    ),
    "a CRS to the south and west": (
        lambda copy: copy.setting("crs", '"EPSG:5513"'),
        ("block.toml:", "[block] crs", "south and west", "EPSG:5514"),
    ),
    "another CRS of the block": (
        lambda copy: copy.setting("crs", '"EPSG:32633"'),
        (".tfw", "outside the area EPSG:32633", "look like EPSG:5514"),
    ),
    "the DEM under a false CRS": (
        lambda copy: raster_placed(copy, "dem.tif", shifted(0), crs="EPSG:32633"),
        ("dem.tif", "outside the area EPSG:32633", "look like EPSG:5514"),
    ),
    "an ortho sheet under a false CRS": (
        lambda copy: raster_placed(copy, ORTHO, shifted(0), crs="EPSG:32633"),
        (ORTHO, "outside the area EPSG:32633", "look like EPSG:5514"),
    ),
    "a road layer under a false CRS": (
        lambda copy: vector_changed(copy, ROADS, crs="EPSG:32633"),
        (ROADS, "outside the area EPSG:32633", "look like EPSG:5514"),
    ),
    "a DEM without CRS that does not fit": (
        lambda copy: raster_placed(copy, "dem.tif", lambda e, n: (4e6, 9e6), crs=None),
        ("dem.tif", "names no CRS", "Assign its CRS"),
    ),
    "a DEM somewhere else": (
        lambda copy: raster_placed(copy, "dem.tif", shifted(-20_000)),
        ("dem.tif", "the DEM covers 0 % of the block", "Add DEM files"),
    ),
    "an ortho somewhere else": (
        lambda copy: [
            raster_placed(copy, f"ortho/{path.name}", shifted(20_000))
            for path in sorted((copy.folder / "ortho").glob("*.tif"))
        ],
        ("ortho/", "the ortho covers 0 % of the block", "Add ortho files"),
    ),
    "a DEM of nothing but nodata": (
        all_nodata,
        ("dem.tif", "holds no height", "Export it again"),
    ),
    "a truncated DEM": (
        lambda copy: cut_off(copy, "dem.tif"),
        ("dem.tif", "damaged or cut off", "Copy it again"),
    ),
    "a DEM that is no raster": (
        lambda copy: copy.replace("dem.tif", b"heights " * 99),
        ("dem.tif", "cannot be read as a raster", "Copy it again"),
    ),
    "a truncated ortho sheet": (
        lambda copy: cut_off(copy, ORTHO),
        (ORTHO, "damaged or cut off", "Copy it again"),
    ),
    "no DEM": (
        lambda copy: (copy.folder / "dem.tif").unlink(),
        ("block.toml:", "[reference] dem", "is not there", "Correct the path"),
    ),
    "a road layer that is cut": (
        lambda copy: cut_off(copy, ROADS),
        (ROADS, "was cut off", "Copy it again"),
    ),
    "roads that are no vector file": (
        lambda copy: copy.setting("roads", '"dem.tif"'),
        ("dem.tif", "cannot be read as vector data", "Export it again"),
    ),
    "footprints that are no vector file": (
        lambda copy: copy.replace("footprints.gpkg", b"prints " * 99),
        ("block.toml:", "[scans] footprints", "cannot be opened", "Give a vector file"),
    ),
    "words in the EO list": (
        lambda copy: exterior_list(copy, f"{copy.scans[0].stem},here,-1192961,1631,0,0,0"),
        ("eo.csv", "Row 2, column X", "The list needs the columns"),
    ),
    "an EO list below the ground": (
        lambda copy: exterior_list(copy, f"{copy.scans[0].stem},-577776,-1192961,20,0,0,0"),
        ("eo.csv", "below the ground", "Check the column Z"),
    ),
    "an unknown key": (
        lambda copy: add_line(copy, "scans", "scan_pixels_um = 15"),
        ("block.toml:", "scan_pixels_um", "is no key", "Did you mean `scan_pixel_um`?"),
    ),
    "no TOML": (
        lambda copy: copy.replace("block.toml", "[block\nname="),
        ("block.toml", "not valid TOML", "Mend that line"),
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_used_is_told_once_with_file_cause_and_remedy__truth(
    name: str, copy_of: CopyOf, capsys: Capsys
) -> None:
    spoil, words = REFUSED[name]
    copy = copy_of(1)
    spoil(copy)
    stage = "reference" if "road" in name else "georeference"
    gruber(capsys, "run", copy.folder, "--until", stage).refuses(*words)


HOLDERS: dict[str, tuple[Callable[[Axes], Spoil], str]] = {
    "world files": (lambda axes: lambda copy: world_files(copy, axes), ".tfw"),
    "EO list": (lambda axes: lambda copy: exterior_placed(copy, axes), "eo.csv"),
    "footprints": (footprints_placed, "footprints.gpkg"),
    "surveyed points": (lambda axes: lambda copy: points_placed(copy, axes), "points.csv"),
    "ortho": (placed(ORTHO), ORTHO),
    "DEM": (placed("dem.tif"), "dem.tif"),
    "roads": (lambda axes: lambda copy: vector_changed(copy, ROADS, axes), ROADS),
}
SLIPS: dict[str, tuple[Axes, tuple[str, str]]] = {
    "positive": (positive, ("both coordinates are positive, first Y", "put a minus before both")),
    "swapped": (swapped, ("easting and northing are swapped", "Swap the two")),
    "positive and swapped": (
        positive_swapped,
        ("both coordinates are positive, first X", "swap the two and put a minus before both"),
    ),
}


@pytest.mark.parametrize("slip", SLIPS)
@pytest.mark.parametrize("holder", HOLDERS)
def test_axes_of_s_jtsk_are_recognised_wherever_they_slip__truth(
    holder: str, slip: str, copy_of: CopyOf, capsys: Capsys
) -> None:
    spoiling, file = HOLDERS[holder]
    axes, words = SLIPS[slip]
    copy = copy_of(1)
    spoiling(axes)(copy)
    gruber(capsys, "run", copy.folder, "--until", "reference").refuses(file, "S-JTSK", *words)


def test_files_without_crs_that_fit_the_block_are_taken__truth(
    copy_of: CopyOf, capsys: Capsys
) -> None:
    copy = copy_of(1)
    raster_placed(copy, "dem.tif", shifted(0), crs=None)
    raster_placed(copy, ORTHO, shifted(0), crs=None)
    vector_changed(copy, ROADS, crs=None)
    assert gruber(capsys, "run", copy.folder, "--until", "reference").code == 0


def doubts_of(copy: BlockCopy, stage: str) -> str:
    """Kinds and messages of the doubts a stage left, as text."""
    (value,) = (copy.folder / ".gruber" / "products" / stage).glob("*.value")
    return value.read_bytes().partition(b"\n")[2].decode()


def test_empty_road_layers_leave_salient_points_and_a_doubt__truth(
    copy_of: CopyOf, capsys: Capsys
) -> None:
    copy = copy_of(1)
    for path in sorted((copy.folder / "roads").glob("*.shp")):
        vector_changed(copy, f"roads/{path.name}", empty=True)
    told = gruber(capsys, "run", copy.folder, "--until", "reference")
    assert told.code == 0
    made = json.loads(doubts_of(copy, "reference"))["value"]
    assert set(made["sources"].values()) == {"salient"}
    kinds = [doubt["kind"] for doubt in made["doubts"]["@tuple"]]
    assert kinds == ["roads-empty"] * 3


def test_bridges_outside_of_the_block_are_a_doubt__truth(copy_of: CopyOf, capsys: Capsys) -> None:
    copy = copy_of(1)
    copy.replace("bridges.geojson", json.dumps({"type": "FeatureCollection", "features": []}))
    text = (copy.folder / "block.toml").read_text()
    copy.replace(
        "block.toml", text.replace("[reference]", '[reference]\nbridges = "bridges.geojson"')
    )
    assert gruber(capsys, "run", copy.folder, "--until", "reference").code == 0
    (doubt,) = json.loads(doubts_of(copy, "reference"))["value"]["doubts"]["@tuple"]
    assert doubt["kind"] == "polygons-elsewhere"
    assert "bridges.geojson" in str(doubt["message"])


def test_a_dem_of_half_the_block_is_a_doubt__truth(copy_of: CopyOf, capsys: Capsys) -> None:
    copy = copy_of(1)
    raster_placed(copy, "dem.tif", shifted(-2000))
    assert gruber(capsys, "run", copy.folder, "--until", "georeference").code == 0
    assert "dem-coverage" in doubts_of(copy, "georeference")


def test_fiducials_that_are_not_found_leave_a_nominal_interior_and_a_doubt__truth(
    copy_of: CopyOf, capsys: Capsys
) -> None:
    copy = copy_of(1)
    copy.setting("fiducials_mm", "{ 1 = [-60.0, 0.5], 2 = [61.0, 0.0], 3 = [0.0, 60.0] }")
    told = gruber(capsys, "run", copy.folder, "--until", "scans")
    assert told.code == 0
    assert "no fiducials" in told.out
    assert "None of the 3 fiducials could be found" in told.out
    assert "interior-nominal" in doubts_of(copy, "scans")


def test_an_eo_list_of_other_scans_is_a_doubt__truth(copy_of: CopyOf, capsys: Capsys) -> None:
    copy = copy_of(1)
    exterior_list(copy, "another,-577776,-1192961,1631,0,0,0")
    told = gruber(capsys, "run", copy.folder, "--until", "georeference")
    assert told.code == 0
    assert "eo.csv name no scan of this block" in told.out


def test_a_reference_that_shows_nothing_is_told_of_the_photos__truth(
    copy_of: CopyOf, capsys: Capsys
) -> None:
    copy = copy_of(1)
    flat_ortho(copy)
    told = gruber(capsys, "run", copy.folder)
    told.refuses(copy.scans[0], "does not stand on the reference ortho", "Check that ortho")


def test_a_blank_scan_is_left_out_by_its_photo__truth(copy_of: CopyOf, capsys: Capsys) -> None:
    copy = copy_of(1)
    pixels_changed(copy, f"scans/{copy.scans[0].name}", lambda values: np.full_like(values, 128))
    told = gruber(capsys, "run", copy.folder)
    told.refuses(copy.scans[0], "The scan is blank", "Scan the photo again")


def test_a_report_of_a_block_without_an_oriented_photo_is_refused__truth(
    copy_of: CopyOf, capsys: Capsys
) -> None:
    copy = copy_of(1)
    text = (copy.folder / "block.toml").read_text()
    surveyed = '[control]\npoints = "points.csv"\n'
    copy.replace("block.toml", re.sub(r"\[reference\]\n(.+\n)+", surveyed, text))
    copy.replace("points.csv", "id,X,Y,Z\nA,-577500,-1192900,300\n")
    told = gruber(capsys, "report", copy.folder)
    told.refuses("report.html", "was not written", "Measure four surveyed points")
    assert "report.html" not in told.out
