"""Sentences about neighbouring blocks: the gravest verdict of a pair is the one that is said."""

from typing import Any

import pytest

from app.neighbours_told import told_lines
from core.said import Said


def row(verdict: str, length_m: float, ratio: float | None) -> dict[str, Any]:
    return {
        "kind": "photo",
        "name": f"p{length_m:.0f}",
        "length_m": length_m,
        "sigma_m": 0.5,
        "ratio": ratio,
        "verdict": verdict,
    }


def told(*rows: dict[str, Any], **more: Any) -> list[str]:
    pair = {
        "one": "east",
        "other": "west",
        "why": "",
        "rows": rows,
        "one_sided": [],
        "told": sum(one["verdict"] == "disagree" for one in rows),
        "namesakes": [],
    }
    figures = {"blocks": 2, "level": 0.001, "left_out": [], "unadjusted": 0, "pairs": [pair | more]}
    return [*told_lines(figures)]


@pytest.mark.parametrize(
    ("verdicts", "begin"),
    [
        (["agree", "agree"], "east and west agree: 2 photos"),
        (["agree", "differ"], "east and west differ within what the job allows: 2 photos"),
        (["differ", "disagree"], "! east and west disagree: 2 photos"),
    ],
)
def test_a_pair_is_told_by_its_gravest_verdict__truth(verdicts: list[str], begin: str) -> None:
    lines = told(*(row(verdict, 1.0 + n, 2.0 + n) for n, verdict in enumerate(verdicts)))
    assert lines[0].startswith(begin)
    assert lines[0].endswith("largest difference 2.00 m, 0.50 m predicted")
    assert ("  photo p2: its ground lies 2.00 m apart, 0.50 m predicted" in lines) == (
        "disagree" in verdicts
    )


def test_what_drops_out_is_told_by_photo__truth() -> None:
    lines = told(row("agree", 0.1, 0.2), one_sided=["a", "b"], namesakes=["c"])
    assert "only one of both orients a, b" in lines[1]
    assert lines[2].strip().startswith("c is in both under one name, but is not the same file")


def test_what_is_not_compared_is_told__truth() -> None:
    assert "nothing is predicted" in told(row("unknown", 1.0, None))[0]
    assert told(why=Said("Run it.", {}))[0] == "! east and west: Run it."
