"""A list of orientations against what is known of its photos."""

from dataclasses import replace
from pathlib import Path

import pytest

from core.errors import ProjectError
from core.formats.eo_format import read_eo_block, write_eo_block
from core.formats.rotations import AngleConvention
from tests.core.formats.film_block import read_film_block


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
