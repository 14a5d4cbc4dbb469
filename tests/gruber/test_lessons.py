"""Lessons in notebooks: their cells run, and say what the page says."""

import json
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest

import gruber
from app.found_lessons import find_lessons
from app.teaching import Teacher

PYTHON = Path(__file__).resolve().parents[2] / "docs" / "python"


def run_of(name: str) -> dict[str, Any]:
    """All that a notebook knows at its end."""
    book = json.loads((PYTHON / f"{name}.ipynb").read_text(encoding="utf-8"))
    assert (book["nbformat"], book["metadata"]["kernelspec"]["name"]) == (4, "python3")
    cells = [cell for cell in book["cells"] if cell["cell_type"] == "code"]
    assert not [cell for cell in cells if cell["outputs"] or cell["execution_count"]]
    known: dict[str, Any] = {}
    with mpl.rc_context({"backend": "agg"}):
        for cell in cells:
            exec(compile("".join(cell["source"]), name, "exec"), known)
        plt.close("all")
    return known


def test_image_coordinates_are_those_of_the_print__paper() -> None:
    told = run_of("image-coordinates")
    assert told["worst"] <= 2.0
    # 50 um at 300 km/h and 1 : 10 000 are 6 ms, or 1/167 s.
    assert told["slowest"] == 167


def test_orientation_tells_what_fixes_a_photo_and_finds_what_was_hidden__truth() -> None:
    told = run_of("orientation")
    sigmas = list(told["sigmas"].values())
    assert sigmas == sorted(sigmas)
    assert not np.isfinite(told["on_it"])
    assert told["rms"] == sorted(told["rms"], reverse=True)
    # Five unknowns of six parallaxes: noise of 5 um leaves little, and the elements near.
    assert told["solved"]["rms"] < 15
    for name, truth in told["truth"].items():
        assert told["solved"][name] == pytest.approx(truth, abs=0.1)


def test_chance_alone_brings_ten_candidates_together__paper() -> None:
    """METHODS 1.4: 10.3 on average; as tests/app/lessons/test_textbook.py has it."""
    told = run_of("ransac")
    assert np.mean(told["counts"]) == pytest.approx(10.3, abs=1.0)
    assert told["found"][-1]["right"] > told["found"][-1]["chance"]


def test_a_notebook_and_the_page_say_the_same__law() -> None:
    state = {"H": 5000, "r": 100}
    page = Teacher(find_lessons()).view("corrections", state, truth=True)
    study = gruber.lesson("corrections")
    assert study.figures(**state) == {k: one["value"] for k, one in page["figures"].items()}
    curve = study.curves(**state)["sum"]
    assert curve.tolist() == page["plot"]["curves"][-1]["points"]
    assert "H: 600 to 16000, 4500 m" in repr(study)
    assert set(gruber.lesson("relative").truth()) == {"by", "bz", "omega", "phi", "kappa"}


def test_what_no_slider_can_have_is_refused__law() -> None:
    for wrong in ({"H": 1e9}, {"height": 1}):
        with pytest.raises(gruber.PhotogrammetryError):
            gruber.lesson("corrections").figures(**wrong)
    with pytest.raises(gruber.PhotogrammetryError, match="There are: interior"):
        gruber.lesson("alchemy")
