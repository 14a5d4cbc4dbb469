"""A list of orientations against what is known of its photos."""

from dataclasses import replace
from pathlib import Path

import pytest

from core.errors import ProjectError
from core.formats.eo_format import read_eo_block, write_eo_block
from core.formats.rotations import AngleConvention
from tests.core.formats.film_block import read_film_block


def test_columns_that_may_be_angles_are_asked_about_and_others_named__truth(
    tmp_path: Path,
) -> None:
    path = tmp_path / "eo.csv"
    path.write_text("scan,X,Y,Z,a,b,c\nS1,1,2,3,0.1,0.2,-3.4e0\n")
    with pytest.raises(ProjectError, match="Columns a, b, c hold numbers where angles") as told:
        read_eo_block(path)
    assert "--answer columns=" in told.value.remedy
    heads = ("scan", "X", "Y", "Z", "omega_deg", "phi_deg", "kappa_deg")
    assert read_eo_block(path, heads=heads).photos["S1"].exterior is not None
    assert read_eo_block(path, heads=(*heads[:4], "", "", "")).photos["S1"].position == (1, 2, 3)
    path.write_text("scan,X,Y,Z,time,strip\nS1,1,2,3,11:20,4\n")
    assert "Columns that are not read: time, strip" in read_eo_block(path).notes
    path.write_text("scan,X,Y,Z,omega_deg,phi_deg,kappa_deg,a,b,c\nS1,1,2,3,0,0,0,1,2,3\n")
    assert "Columns that are not read: a, b, c" in read_eo_block(path).notes


def test_a_list_that_counts_otherwise_than_it_says_is_asked_about__real(
    shared_data: Path, tmp_path: Path
) -> None:
    block = read_film_block(shared_data)
    path = tmp_path / "list.csv"
    write_eo_block(path, block, AngleConvention("yaw-pitch-roll", "deg"))
    text = path.read_text().replace("yaw-pitch-roll", "omega-phi-kappa")
    path.write_text(text.replace("yaw_deg,pitch_deg,roll_deg", "omega_deg,phi_deg,kappa_deg"))
    assert read_eo_block(path).photos
    with pytest.raises(ProjectError, match="as eo-ypr-deg by"):
        read_eo_block(path, known=block)
    oriented = replace(block, measurements=(), points={})
    with pytest.raises(ProjectError, match="as eo-ypr-deg by"):
        read_eo_block(path, known=oriented)
