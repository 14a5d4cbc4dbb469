"""The wheel: everything lies inside `gruber`, and it runs from there alone."""

import json
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
import yaml

from app.cli import parser
from gruber.packing import ROOMS, with_imports_inside

REPOSITORY = Path(__file__).resolve().parents[2]
WITHOUT_CHECKOUT = """
import sys
from gruber.__main__ import program
sys.argv = ["gruber", "--version"]
try:
    program()
except SystemExit as done:
    assert not done.code
import gruber
gruber.open_block
print(sorted({name.split(".")[0] for name in sys.modules} & {"app", "core", "ui", "sessions"}))
print(sys.modules["gruber.core.block"].__file__)
"""


def test_imports_of_rooms_and_no_others_go_inside__law():
    source = '''"""From core to app."""
from core import block
from core.block import (
    Block,
)
from corelib import x
import numpy.core

def late():
    if True: from app.cli import program
    text = "from core.block import Block"
'''
    changed = with_imports_inside(source, "there.py").splitlines()
    differing = [k for k, line in enumerate(source.splitlines()) if line != changed[k]]
    assert differing == [1, 2, 9]
    assert changed[1] == "from gruber.core import block"
    assert changed[2] == "from gruber.core.block import ("
    assert changed[9] == "    if True: from gruber.app.cli import program"


def test_a_room_imported_under_its_own_name_stops_the_build__law():
    with pytest.raises(SyntaxError, match=r"there.py:2.*core.block"):
        with_imports_inside("import numpy\nimport core.block\n", "there.py")


def test_the_wheel_puts_nothing_beside_gruber_and_runs_alone__law(tmp_path):
    source = tmp_path / "source"
    for part in ("pyproject.toml", "README.md", "LICENSE", "gruber", *ROOMS):
        copied = source / part
        copied.parent.mkdir(exist_ok=True)
        subprocess.run(["cp", "-r", REPOSITORY / part, copied], check=True)
    build = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--no-build-isolation", "-q", "."]
    subprocess.run([*build, "-w", tmp_path], cwd=source, check=True)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as packed:
        names = packed.namelist()
        packed.extractall(tmp_path / "installed")
    tops = {name.split("/")[0] for name in names}
    assert tops == {"gruber", next(top for top in tops if top.endswith(".dist-info"))}
    assert "gruber/packing.py" not in names
    for data in (
        "py.typed",
        "app/report/page.html",
        "app/report/page.css",
        "ui/words/cs.toml",
        "ui/web/pages/desk.js",
    ):
        assert f"gruber/{data}" in names
    said = subprocess.run(
        [sys.executable, "-c", WITHOUT_CHECKOUT],
        cwd=tmp_path, env={"PYTHONPATH": str(tmp_path / "installed"), "PYTHONWARNINGS": "error"},
        check=True, capture_output=True, text=True,
    ).stdout.splitlines()  # fmt: skip
    assert said[-2] == "[]"
    assert Path(said[-1]).is_relative_to(tmp_path / "installed")


def test_the_image_is_made_of_what_the_wheel_needs_and_asks_what_is_understood__law():
    recipe = (REPOSITORY / "Dockerfile").read_text()
    copied = {
        word for line in re.findall(r"(?m)^COPY (?!--)(.+) \S+$", recipe) for word in line.split()
    }
    assert {*ROOMS, "gruber", "pyproject.toml", "README.md", "LICENSE"} <= copied
    let_in = {
        line[1:]
        for line in (REPOSITORY / ".dockerignore").read_text().splitlines()
        if line[0] == "!"
    }
    assert let_in == copied
    asked = [json.loads(found) for found in re.findall(r"(?m)^CMD (\[.+\])$", recipe)]
    services = yaml.safe_load((REPOSITORY / "compose.yaml").read_text())["services"].values()
    given = [one["command"] for one in services if "command" in one and "entrypoint" not in one]
    # As compose does where a variable is not set.
    asked += [[re.sub(r"\$\{\w+:-(.*)\}", r"\1", word) for word in words] for words in given]
    verbs = {parser().parse_args(words).verb for words in asked}
    assert verbs == {"review", "batch"}
