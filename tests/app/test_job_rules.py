"""The rules of a job in their file: read, refused with one message, printed to be edited."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from app.job_rules import read_rules, rules_lines, rules_on_disk
from app.project import described, read_project
from core.errors import ProjectError
from core.pipeline import STAGES
from core.quality.job_rules import LIMITS, USUAL_RULES
from sessions.products import digest_of
from tests.app.test_project import TOML

NAMED = TOML.replace('heights = "Bpv"', 'heights = "Bpv"\nrules = "../rules.toml"')
OWN = "tilt_deg = 2.5\nreadings = 40 # of the archive\n"
Made = Callable[[str, str], Path]


@pytest.fixture
def made(tmp_path: Path) -> Made:
    """A block beside the rules of its job."""

    def write(rules: str, toml: str = NAMED) -> Path:
        folder = tmp_path / "block"
        for name in ("scans/a.tif", "ortho/1.tif", "dem.tif"):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).touch()
        (folder / "block.toml").write_text(toml, encoding="utf-8")
        (tmp_path / "rules.toml").write_text(rules, encoding="utf-8")
        return folder

    return write


def test_limits_are_those_on_disk_now__law(made: Made) -> None:
    """A desk that was open went on with what its rules had been."""
    folder = made(OWN, NAMED)
    block = folder / "block.toml"
    assert rules_on_disk(block) == replace(USUAL_RULES, tilt_deg=2.5, readings=40)
    (folder.parent / "rules.toml").write_text("tilt_deg = 2.0\n", encoding="utf-8")
    assert rules_on_disk(block) == replace(USUAL_RULES, tilt_deg=2.0)
    (folder.parent / "rules.toml").write_text("tilt_deg = = 2.0\n", encoding="utf-8")
    assert rules_on_disk(block) is None


def test_a_file_holds_the_limits_that_differ__truth(made: Made) -> None:
    rules = read_project(made(OWN, NAMED)).rules
    assert rules == replace(USUAL_RULES, tilt_deg=2.5, readings=40)
    assert read_project(made(OWN, TOML)).rules == USUAL_RULES == read_rules(None)


@pytest.mark.parametrize(
    ("rules", "words"),
    [
        ("tilt_deg = 2.5\ntilt = 3\n", ("rules.toml:2 tilt:", "Did you mean `tilt_deg`?")),
        ('readings = "many"', ("rules.toml:1 readings:", "must be a number", "without quotes")),
        ("readings = 30.5", ("rules.toml:1 readings:", "a whole number")),
        ("\nsun_deg = 91", ("rules.toml:2 sun_deg:", "91 is outside", "degrees, from 0 to 90")),
        ("tilt_deg = 5", ("rules.toml:1 tilt_deg:", "more than tilt_most_deg (4.5)", "Set both")),
        ("tilt_most_deg = 2", ("rules.toml:1 tilt_most_deg:", "tilt_deg is 3", "Set both")),
        ("tilt_deg: 3", ("rules.toml:", "is not valid TOML", "Mend that line")),
        ("[flight]\ntilt_deg = 3", ("rules.toml:1 flight:", "is no key of this table")),
    ],
)
def test_what_no_limit_can_be_is_refused_with_file_key_and_remedy__truth(
    made: Made, rules: str, words: tuple[str, ...]
) -> None:
    folder = made(rules, NAMED)
    with pytest.raises(ProjectError) as refused:
        read_project(folder)
    assert all(word in refused.value.told for word in words), refused.value.told


def test_a_file_that_is_not_there_is_named_with_its_key__truth(made: Made) -> None:
    folder = made(OWN, NAMED.replace("../rules.toml", "rules.toml"))
    with pytest.raises(
        ProjectError, match=r'\[block\] rules: "rules.toml" is not there'
    ) as refused:
        read_project(folder)
    assert "block.toml" in refused.value.told


@pytest.mark.parametrize("rules", [USUAL_RULES, replace(USUAL_RULES, tilt_deg=2.5, readings=40)])
def test_what_is_printed_reads_back_the_same__law(tmp_path: Path, rules) -> None:
    file = tmp_path / "rules.toml"
    text = "\n".join(rules_lines(rules))
    file.write_text(text, encoding="utf-8")
    assert read_rules(file) == rules
    assert all(f"\n{name} = " in text for name in LIMITS)
    assert text.count("SET BY THE JOB") == 2 * (rules != USUAL_RULES)


def test_no_stage_is_made_from_the_limits__law(made: Made) -> None:
    """They judge and steer nothing: what stages are made from is the same to the last byte."""
    usual, own = (read_project(made(OWN, toml)) for toml in (TOML, NAMED))
    assert usual.rules != own.rules
    assert replace(own, block=replace(own.block, rules=USUAL_RULES)) == usual
    for reference in (usual, own):
        assert not hasattr(described_parts(reference), "rules")
    first, second = ([digest_of(stage.inputs(described_parts(one))) for stage in STAGES]
                     for one in (usual, own))  # fmt: skip
    assert first == second


def described_parts(project):
    """What the engine is given, the reference stated: the files of this block are empty."""
    stated = replace(project.reference, ortho_sigma_m=0.25, dem_sigma_m=0.5)
    return described(replace(project, reference=stated))
