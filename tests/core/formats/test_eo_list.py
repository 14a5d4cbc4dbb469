"""Lists of exterior orientations, as people and programs write them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.errors import ProjectError
from core.formats.eo_format import EO_FORMATS, fitting_convention, read_eo_block, write_eo_block
from core.formats.eo_list import read_eo_list, read_eo_records
from core.formats.exchange import ExchangeBlock, ExchangePhoto, pixels_of
from core.formats.rotations import CONVENTIONS, AngleConvention
from core.geometry.exterior import ExteriorOrientation
from tests.core.formats.film_block import FOLDER, read_film_block
from tests.real.readers import read_rows

place = st.floats(-1e7, 1e7, allow_nan=False)
angle = st.floats(-3.14, 3.14, allow_nan=False)
triples = st.tuples(place, place, place)
HEADER = "scan,X,Y,Z,omega_deg,phi_deg,kappa_deg\n"


@settings(max_examples=40)
@given(triples, st.none() | st.tuples(angle, angle, angle), st.none() | triples)
def test_written_and_read__law(
    tmp_path_factory: pytest.TempPathFactory,
    centre: tuple,
    angles: tuple | None,
    sigma: tuple | None,
) -> None:
    path = tmp_path_factory.mktemp("eo") / "eo.csv"
    turned = ("",) * 3 if angles is None else np.degrees(angles).tolist()
    sure = ("",) * 3 if angles is None else np.abs(np.degrees(angles)).tolist()
    sigma = sigma and tuple(np.abs(sigma).tolist())
    cells = ["LMSA08.1938.HUST25.00859", *centre, *turned, *(sigma or ("",) * 3), *sure]
    sigmas = ",sigma_X,sigma_Y,sigma_Z,sigma_omega_deg,sigma_phi_deg,sigma_kappa_deg\n"
    path.write_text(HEADER.strip() + sigmas + ",".join(map(str, cells)) + "\n")
    back = read_eo_list(path)["LMSA08.1938.HUST25.00859"]
    np.testing.assert_allclose(back.centre, centre, atol=1e-4)
    for got, given_ in ((back.angles, angles), (back.sigma_angles, angles)):
        assert (got is None) == (given_ is None)
        if got is not None:
            expected = given_ if got is back.angles else np.abs(given_)
            np.testing.assert_allclose(got, expected, atol=1e-9)
    assert (back.sigma_centre_m is None) == (sigma is None)


def test_columns_in_any_order_and_case__truth(tmp_path: Path) -> None:
    path = tmp_path / "eo.csv"
    path.write_text(
        "\ufeffScan;Z;Y;X;kappa_gon;phi_gon;omega_gon;note\nscans\\a.TIF;3;2;1;200;0;-1;x\n"
    )
    record = read_eo_list(path)["a"]
    assert record.centre == (1.0, 2.0, 3.0)
    np.testing.assert_allclose(record.angles, np.radians([-0.9, 0, 180]))


@pytest.mark.parametrize("name", ["Strip 1, photo 2.tif", 'a, "b", c.tif'])
def test_a_name_with_commas_is_read_as_it_was_written__law(tmp_path: Path, name: str) -> None:
    """Its row was cut in the middle of the name."""
    exterior = ExteriorOrientation(np.array([1.0, 2.0, 3.0]), 0.1, 0.2, 0.3)
    path, stem = tmp_path / "eo.csv", name.removesuffix(".tif")
    write_eo_block(path, ExchangeBlock(photos={stem: ExchangePhoto(stem, name, exterior=exterior)}))
    record = read_eo_list(path)[stem]
    assert record.file == name
    assert record.centre == (1.0, 2.0, 3.0)
    np.testing.assert_allclose(record.angles, (0.1, 0.2, 0.3))
    path.write_text(f'{HEADER}a,1,2,3,,,\n"b, c" , 1, 2, 3,,,\n')
    assert set(read_eo_list(path)) == {"a", "b, c"}


def test_position_only_rows__truth(tmp_path: Path) -> None:
    path = tmp_path / "eo.csv"
    path.write_text(
        "scan,X,Y,Z,omega_deg,phi_deg,kappa_deg,sigma_X,sigma_Y,sigma_Z\na,1,2,3,,,,200,200,50\n"
    )
    record = read_eo_list(path)["a"]
    assert record.angles is None
    assert record.sigma_centre_m == (200.0, 200.0, 50.0)
    path.write_text("scan,X,Y,Z\nb.tif,1,2,3\n")
    assert read_eo_list(path)["b"].angles is None


@pytest.mark.parametrize(
    ("text", "words"),
    [("scan,X,Y\na,1,2\n", "column Z is missing"), ("X,Y,Z\n1,2,3\n", "column scan is missing"),
     ("scan,X,Y,Z,omega_deg,phi_deg\na,1,2,3,4,5\n", "column kappa_deg is missing"),
     ("scan,X,Y,Z,omega,phi,kappa\na,1,2,3,4,5,6\n", "does not say its unit"),
     (HEADER + "a,1,two,3,0,0,0\n", "Row 2, column Y: 'two' is not a number"),
     (HEADER + "a,1,2,,0,0,0\n", r"Row 2 \(a\), column Z is empty"),
     (HEADER + ",1,2,3,0,0,0\n", "names no scan"), (HEADER, "no rows")],
)  # fmt: skip
def test_unusable_list_says_why__truth(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "eo.csv"
    path.write_text(text)
    with pytest.raises(ProjectError, match=words):
        read_eo_list(path)


def test_missing_list_says_so__truth(tmp_path: Path) -> None:
    with pytest.raises(ProjectError, match=r"cannot be read.*UTF-8"):
        read_eo_list(tmp_path / "none.csv")

    with pytest.raises(ProjectError, match="stands twice, in row 2 already"):
        read_eo_list(written(tmp_path, HEADER + "a.tif,1,2,3,0,0,0\na,1,2,3,0,0,0\n"))


def written(folder: Path, text: str) -> Path:
    path = folder / "list.txt"
    path.write_text(text, encoding="utf-8")
    return path


ROW = "a.tif 10 20 3000 1.5 -2.5 90\n"
OPK_GON = AngleConvention("omega-phi-kappa", "gon")


@pytest.mark.parametrize(
    ("text", "words"),
    [("scan X Y Z Omega Phi Kappa\n" + ROW, "omega does not say its unit"),
     ("imageName X Y Z Yaw Pitch Roll\n" + ROW, "yaw does not say its unit"),
     ("scan X Y Z phi[deg] omega[deg] kappa[deg]\n" + ROW, "which of them turns first"),
     (ROW, "column scan is missing"),
     ("scan X Y Z omega_deg phi_gon kappa_deg\n" + ROW, "in two units, deg, gon"),
     ("scan X Y Z omega_deg phi_deg kappa_deg X\n" + ROW, "X stands twice"),
     (HEADER + "a,1,2,3,0,0,387.2\n", "387.2 deg is more than a whole turn"),
     ("# angles: omega-phi-kappa, rad\n" + HEADER.replace("_deg", "") + "a,1,2,3,0,0,90\n",
      r"90(\.0)? rad is more than a whole turn"),
     (HEADER + "a,1,2,nan,0,0,0\n", r"column Z is empty"),
     (HEADER + "a,1,2,3,0,nan,0\n", r"column phi is empty"),
     (HEADER + "a,1,2,3,0,0,0\nb,1,2,3,0\n", r"Row 3 \(b\) ends early"),
     ("scan,X,Y,Z,sigma_X,sigma_Y,sigma_Z\na,1,2,3,1,-1,1\n", "below nought"),
     (HEADER + "a,1,2,3,0,0,zero\n", "Row 2, column kappa: 'zero' is not a number")],
)  # fmt: skip
def test_what_is_not_said_is_asked__truth(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(ProjectError, match=words) as told:
        read_eo_block(written(tmp_path, text))
    assert "Say it" in told.value.remedy or "unit" not in words or "two" in words


def test_what_caller_and_list_say_must_agree__truth(tmp_path: Path) -> None:
    path = written(tmp_path, HEADER + "a,1,2,3,0,0,0\n")
    with pytest.raises(ProjectError, match="says deg, and is to be read as gon"):
        read_eo_records(path, OPK_GON)


@pytest.mark.parametrize("parted", [",", ";", "\t", "   "])
def test_every_way_of_parting_columns_says_the_same__truth(tmp_path: Path, parted: str) -> None:
    rows = [
        ["scan", "X", "Y", "Z", "omega[gon]", "phi[gon]", "kappa[gon]"],
        ["a.tif", "10.25", "20.5", "3000", "1", "2", "200"],
    ]
    text = "".join(parted.join(row) + "\n" for row in rows)
    if parted == ";":
        text = text.replace(".2", ",2").replace("20.5", "20,5")
    record = read_eo_list(written(tmp_path, text))["a"]
    assert record.centre == (10.25, 20.5, 3000.0)
    assert record.file == "a.tif"
    np.testing.assert_allclose(record.angles, np.array([0.9, 1.8, 180]) * np.pi / 180)


def test_a_list_without_header_is_read_as_the_caller_says__truth(tmp_path: Path) -> None:
    record = read_eo_records(written(tmp_path, ROW), OPK_GON).records["a"]
    np.testing.assert_allclose(record.angles, np.array([1.5, -2.5, 90]) * np.pi / 200)


def test_the_header_of_metashape_is_a_comment__truth(tmp_path: Path) -> None:
    text = "# Cameras (1)\n# PhotoID, X, Y, Z, Omega, Phi, Kappa, r11\n"
    path = written(tmp_path, text + "a\t1\t2\t3\t0.5\t0.25\t90\t1\n")
    said = AngleConvention("omega-phi-kappa", "deg")
    np.testing.assert_allclose(
        read_eo_records(path, said).records["a"].angles, np.radians([0.5, 0.25, 90])
    )


def test_steep_photos_are_told__truth(tmp_path: Path) -> None:
    block = read_eo_block(written(tmp_path, HEADER + "a,1,2,3,90,0,0\nb,1,2,3,1,1,0\nc,1,2,3,,,\n"))
    assert {name: photo.position for name, photo in block.photos.items()} == {
        "a": None,
        "b": None,
        "c": (1.0, 2.0, 3.0),
    }
    assert [note[:7] for note in block.notes] == ["1 photo"]


turns = st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-3.1, 3.1))


@settings(max_examples=30)
@given(triples, turns, st.none() | turns, st.sampled_from(EO_FORMATS))
def test_every_format_comes_back__law(
    tmp_path_factory: pytest.TempPathFactory, centre, angles, sigma, one
) -> None:
    photo = ExchangePhoto(
        "a b",
        "a b.tif",
        exterior=ExteriorOrientation(np.array(centre), *angles),
        sigma_centre_m=None if sigma is None else tuple(np.abs(sigma).tolist()),
        sigma_angles=None if sigma is None else tuple(np.abs(sigma).tolist()),
    )
    path = tmp_path_factory.mktemp("eo") / one.default_name
    notes = one.write(path, ExchangeBlock("EPSG:5514", photos={"a b": photo}))
    back = one.read(path)
    assert back.crs == "EPSG:5514"
    again = back.photos["a b"]
    assert again.file == "a b.tif"
    np.testing.assert_array_equal(again.exterior.centre, centre)
    turned = again.exterior.object_from_image - photo.exterior.object_from_image
    assert np.abs(turned).max() < 1e-9
    assert (again.sigma_centre_m or ()) == (photo.sigma_centre_m or ())
    if sigma is not None and ("opk" in one.name or one.name == "eo"):
        np.testing.assert_allclose(again.sigma_angles, photo.sigma_angles, rtol=1e-12)
    elif sigma is not None:
        assert "carry none here" in notes[0]


@pytest.mark.parametrize("convention", CONVENTIONS, ids=lambda one: one.name)
def test_measurements_tell_how_an_erdas_list_counts__real(
    shared_data: Path, tmp_path: Path, convention: AngleConvention
) -> None:
    block = read_film_block(shared_data)
    path = tmp_path / "list.txt"
    write_eo_block(path, block, convention)
    words = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    rows = [" ".join(line.split(",")[:7]) for line in words[1:]]
    # The same list with nothing said: its photos stand upside down, and 3.1 rad is no tilt.
    path.write_text("\n".join(rows) + "\n")
    with pytest.raises(ProjectError, match="scan is missing"):
        read_eo_block(path)
    names = convention.order.split("-")
    path.write_text("\n".join([" ".join(["scan", "X", "Y", "Z", *names]), *rows]) + "\n")
    with pytest.raises(ProjectError, match="does not say its unit"):
        read_eo_block(path)
    if convention.order == "yaw-pitch-roll":
        best, told = fitting_convention(path, block)
        assert best == convention
        assert "px" in told
        return
    # Tilts of half a degree hardly tell which of omega and phi turns first: unit alone is sure.
    try:
        best, told = fitting_convention(path, block)
        assert best == convention
        assert read_eo_block(path, known=block).notes == (told,)
    except ProjectError as error:
        assert error.cause.startswith("Angles fit as")  # noqa: PT017
        assert convention.name in error.cause  # noqa: PT017


def test_a_prior_tells_the_unit_where_nothing_is_measured__real(
    shared_data: Path, tmp_path: Path
) -> None:
    block = replace(read_film_block(shared_data), points={}, measurements=())
    path = written(
        tmp_path,
        "scan X Y Z omega phi kappa\n4092 484561.193 994485.941 3341.383 8.0 30.0 178.0\n",
    )
    tilted = ExteriorOrientation(
        np.array([484561.193, 994485.941, 3341.383]), *np.radians([8.1, 30.2, 177.5])
    )
    prior = {"4092": replace(block.photos["4092"], exterior=tilted)}
    best, told = fitting_convention(path, replace(block, photos=prior))
    assert best == AngleConvention("omega-phi-kappa", "deg")
    assert "0.59" in told or "0.5" in told


def test_swapped_axes_are_seen_where_the_block_is_known__real(
    shared_data: Path, tmp_path: Path
) -> None:
    block = read_film_block(shared_data)
    path = tmp_path / "list.csv"
    write_eo_block(path, block)
    assert set(read_eo_block(path, known=block).photos) == set(block.photos)
    lines = [line.split(",") for line in path.read_text().splitlines()]
    swapped = [
        ",".join([c[0], c[2], c[1], *c[3:]]) if "409" in c[0] else ",".join(c) for c in lines
    ]
    path.write_text("\n".join(swapped) + "\n")
    with pytest.raises(ProjectError, match="with axes swapped"):
        read_eo_block(path, known=block)


def test_orientations_of_erdas_give_its_residuals__real(shared_data: Path) -> None:
    block = read_film_block(shared_data)
    published = {
        (row["point_id"], row["image"]): (float(row["res_x"]), float(row["res_y"]))
        for row in read_rows(shared_data / FOLDER / "image_points.csv")
    }
    for one in block.measurements:
        place = np.array([block.points[one.point_id].position])
        photo = block.photos[one.photo_id]
        pixel = pixels_of(place, photo, block.camera_of(one.photo_id))[0]
        # Single precision of the block file.
        expected = published[one.point_id, one.photo_id]
        np.testing.assert_allclose(pixel - [one.column, one.row], expected, atol=1e-3)


def test_columns_of_a_list_may_be_said__truth(tmp_path: Path) -> None:
    path = tmp_path / "eo.csv"
    path.write_text("image,n,X0,X1,Y1,Z1,w,p,k\na,9,0,1,2,3,0.1,0.2,0.3\n")
    with pytest.raises(ProjectError, match="--answer columns"):
        read_eo_list(path)
    heads = ("scan", "", "", "X", "Y", "Z", "omega_rad", "phi_rad", "kappa_rad")
    record = read_eo_records(path, heads=heads).records["a"]
    assert record.centre == (1.0, 2.0, 3.0)
    assert record.angles == (0.1, 0.2, 0.3)
    path.write_text("a,9,0,1,2,3,0.1,0.2,0.3\n")
    assert read_eo_records(path, heads=heads).records["a"] == record
