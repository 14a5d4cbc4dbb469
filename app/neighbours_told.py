"""What neighbouring blocks share, in sentences for the terminal."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from core.said import say

Figures = Mapping[str, Any]


def told_lines(figures: Figures) -> Iterable[str]:
    """What was compared, in sentences; a line that begins with `!` needs attention."""
    for left in figures["left_out"]:
        yield say("! {block} is not compared. {why}", block=left["path"], why=left["why"])
    if count := figures["unadjusted"]:
        yield say(
            "{count:# block is|# blocks are} not adjusted yet: run {count:it|them}.", count=count
        )
    for pair in figures["pairs"]:
        yield from _pair_lines(pair)
    pairs, told = len(figures["pairs"]), sum(pair["told"] > 0 for pair in figures["pairs"])
    yield say(
        "{blocks:# block|# blocks}, {pairs:# pair|# pairs} with something in common, "
        "{told} told apart (a pair of sound blocks in {odds:.0f} is)",
        blocks=figures["blocks"],
        pairs=pairs,
        told=told,
        odds=1 / figures["level"],
    )


def _pair_lines(pair: Figures) -> Iterator[str]:
    one, other = pair["one"], pair["other"]
    if pair["why"]:
        yield say("! {one} and {other}: {why}", one=one, other=other, why=pair["why"])
    counts = {kind: sum(row["kind"] == kind for row in pair["rows"]) for kind in ROW_TOLD}
    differs = any(row["verdict"] == "differ" for row in pair["rows"])
    known = [row for row in pair["rows"] if row["ratio"] is not None]
    if known:
        worst = max(known, key=lambda row: row["ratio"])
        yield say(
            DISAGREE if pair["told"] else DIFFER if differs else AGREE,
            one=one,
            other=other,
            photos=counts["photo"],
            points=counts["point"],
            length=worst["length_m"],
            sigma=worst["sigma_m"],
        )
    elif pair["rows"]:
        yield say(
            "? {one} and {other}: nothing is predicted of what both hold", one=one, other=other
        )
    for row in pair["rows"]:
        if row["verdict"] == "disagree":
            yield say(
                ROW_TOLD[row["kind"]],
                name=row["name"],
                length=row["length_m"],
                sigma=row["sigma_m"],
            )
    if pair["one_sided"]:
        yield say("  only one of both orients {photos}", photos=pair["one_sided"])
    for photo in pair["namesakes"]:
        yield say(NAMESAKE, photo=photo)


DISAGREE = (
    "! {one} and {other} disagree: {photos:# photo|# photos}, {points:# point|# points} in both, "
    "largest difference {length:.2f} m, {sigma:.2f} m predicted"
)
AGREE = (
    "{one} and {other} agree: {photos:# photo|# photos}, {points:# point|# points} in both, "
    "largest difference {length:.2f} m, {sigma:.2f} m predicted"
)
DIFFER = (
    "{one} and {other} differ within what the job allows: {photos:# photo|# photos}, "
    "{points:# point|# points} in both, largest difference {length:.2f} m, {sigma:.2f} m predicted"
)
NAMESAKE = (
    "  {photo} is in both under one name, but is not the same file: it is not compared "
    "(a scan saved again?)"
)
ROW_TOLD: Mapping[str, str] = {
    "photo": "  photo {name}: its ground lies {length:.2f} m apart, {sigma:.2f} m predicted",
    "point": "  point {name}: its places lie {length:.2f} m apart, {sigma:.2f} m predicted",
    "ground": "  both mosaics: {length:.2f} m apart, {sigma:.2f} m predicted",
}
"""What disagrees, by kind of row."""
