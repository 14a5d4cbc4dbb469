"""The demo block: made once, and never over something else."""

import pytest

import app.verbs.demo
from app.verbs.demo import make_demo, truth_lines
from core.errors import StorageError
from core.synthetic.options import SyntheticOptions
from sessions.session import Session
from tests.app.test_run import Listener

TINY = SyntheticOptions("tiny")


@pytest.fixture
def made(monkeypatch):
    """How often a block was made; making takes no time."""
    calls = []

    def make(folder, options, progress):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "block.toml").write_text("[block]\n")
        calls.append(options)

    monkeypatch.setattr(app.verbs.demo, "make_block", make)
    return calls


def test_a_demo_is_made_once__law(made, tmp_path):
    voice = Listener()
    for _ in range(2):
        make_demo(tmp_path / "demo", TINY, voice)
    assert made == [TINY]
    assert len(voice.lines) == 1


def test_a_demo_with_other_options_wants_another_folder__truth(made, tmp_path):
    make_demo(tmp_path / "demo", TINY, Listener())
    with pytest.raises(StorageError, match="other options") as told:
        make_demo(tmp_path / "demo", SyntheticOptions("tiny", seed=2), Listener())
    assert "--out" in told.value.remedy
    assert made == [TINY]


def test_a_user_s_block_is_never_written_over__truth(made, tmp_path):
    (tmp_path / "block.toml").write_text("[block]\n")
    with pytest.raises(StorageError, match="not a demo"):
        make_demo(tmp_path, TINY, Listener())
    assert made == []


def test_a_demo_that_was_broken_off_is_made_anew__law(made, monkeypatch, tmp_path):
    """Half a block has no stamp; its block.toml is written near the end."""

    def breaks(folder, options, progress):
        folder.mkdir(parents=True)
        (folder / "scans").mkdir()
        raise KeyboardInterrupt

    whole = app.verbs.demo.make_block
    monkeypatch.setattr(app.verbs.demo, "make_block", breaks)
    with pytest.raises(KeyboardInterrupt):
        make_demo(tmp_path / "demo", TINY, Listener())
    monkeypatch.setattr(app.verbs.demo, "make_block", whole)
    make_demo(tmp_path / "demo", TINY, Listener())
    assert made == [TINY]


def test_the_truth_is_told_with_its_figures__truth(tiny_run):
    with Session.open(tiny_run.folder, "reader") as session:
        report = session.products.latest_value("adjustment")
    text = "\n".join(truth_lines(tiny_run.folder, report))
    assert "6 of 6" in text
    for words in ("mosaic m_p", "on ground", "control measurements", "sigma nought"):
        assert words in text
