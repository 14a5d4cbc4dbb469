"""What the command says of itself, and how wrong use ends."""

import argparse
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

from app.arguments import VERBS
from app.cli import main, parser
from app.run import STAGE_NAMES


def help_of(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 0
    return capsys.readouterr().out


def test_version_is_the_installed_one__truth(capsys: pytest.CaptureFixture[str]) -> None:
    assert help_of(["--version"], capsys) == f"gruber {version('gruber')}\n"


def test_help_names_every_verb_and_exit_code__truth(capsys: pytest.CaptureFixture[str]) -> None:
    told = help_of(["--help"], capsys)
    assert all(f"    {verb} " in told for verb in VERBS)
    assert all(f"{code} " in told for code in (0, 1, 2, 130))


def test_help_waits_for_no_engine_and_no_desk__law() -> None:
    begun = "import sys; from gruber.__main__ import program; sys.argv[1:] = ['--help']"
    asks = f"{begun}\ntry: program()\nexcept SystemExit: pass"
    told = "print(*sorted({'viser', 'scipy', 'core.pipeline', 'rasterio'} & set(sys.modules)))"
    out = subprocess.check_output([sys.executable, "-c", f"{asks}\n{told}"], text=True)
    assert out.splitlines()[-1] == ""


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_shows_an_example__truth(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    told = help_of([verb, "--help"], capsys)
    assert f"examples:\n  gruber {verb}" in told


def test_stages_are_named_as_they_are_typed_in_every_language__law(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Two of them were translated, and refused when typed so."""
    told = help_of(["run", "--help", "--language", "cs"], capsys)
    assert ", ".join(STAGE_NAMES) in " ".join(told.split())
    with pytest.raises(SystemExit):
        main(["run", "--from", "adjustment", "--until", "control", "--language", "cs"])
    told = " ".join(capsys.readouterr().err.split())
    assert ", ".join(STAGE_NAMES) in told
    assert "`control`" in told


@pytest.mark.parametrize(
    "wrong",
    [
        [],
        ["fly"],
        ["run", "--until", "breakfast"],
        ["run", "--workers", "0"],
        ["demo", "--size", "x"],
    ],
)
def test_wrong_use_ends_with_two__truth(wrong: list[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(wrong)
    assert ended.value.code == 2


@pytest.mark.parametrize(
    ("arguments", "json"),
    [
        (["run", "block"], False),
        (["--log-json", "run", "block"], True),
        (["run", "block", "--log-json"], True),
    ],
)
def test_log_json_stands_before_the_verb_or_after_it__law(arguments: list[str], json: bool) -> None:
    given: argparse.Namespace = parser().parse_args(arguments)
    assert given.log_json is json


def test_examples_parse__law(capsys: pytest.CaptureFixture[str]) -> None:
    for verb in VERBS:
        told = help_of([verb, "--help"], capsys).split("examples:\n")[1]
        for line in told.splitlines():
            example = line.strip().split("   ")[0].split()
            assert example[0] == "gruber"
            assert parser().parse_args(example[1:]).verb is not None


def test_bash_completes_verbs_options_choices_and_block_folders__oracle(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Asked is bash itself, about the words after `gruber`."""
    assert main(["completion", "bash"]) == 0
    (tmp_path / "gruber.bash").write_text(capsys.readouterr().out)
    (tmp_path / "archive").mkdir()
    (tmp_path / "archive.csv").touch()
    asked = {
        "ba": "batch",
        "run --unt": "--until",
        "run --until mos": "mosaic",
        "run arch": "archive",
        "batch archive.": "archive.csv",
    }
    script = 'source gruber.bash; complete() { _shtab_gruber; echo "${COMPREPLY[@]}"; }\n'
    for words in asked:
        script += f"COMP_WORDS=(gruber {words}); COMP_CWORD={len(words.split())}; complete\n"
    told = subprocess.check_output(["bash", "-c", script], text=True, cwd=tmp_path)
    assert told.splitlines() == list(asked.values())
