"""What an import brings: decisions, and lists that are kept in the block's folder."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from app.block_writing import with_values
from app.project import Project
from core.errors import ProjectError
from core.exchange import UPRIGHT_SUFFIX
from core.formats.eo_format import write_eo_block
from core.formats.exchange import ExchangeBlock, ExchangeTies
from core.formats.micmac_points import image_measures_name, write_image_measures
from core.formats.records import one_word, scan_stem
from core.formats.tie_list import write_ties
from core.said import say
from sessions.atomic_write import whole_file
from sessions.decisions import Decision

BROUGHT = "brought"
"""Folder of the block into which foreign lists are put in our own form."""


@dataclass(frozen=True, slots=True)
class Brought:
    """What an import took over."""

    counts: Mapping[str, int]
    """How many of what: `points`, `measurements`, `ties`, `exteriors`, `positions`, `fiducials`."""
    notes: tuple[str, ...]
    """What was left out, a sentence each."""


@dataclass(frozen=True, slots=True)
class TakenOver:
    """What of a foreign file this block can use, before anything of it is written."""

    decisions: tuple[Decision, ...]
    """Points and measurements, undone at once."""
    write: Callable[[], None]
    """Puts orientations, fiducials and ties into the block's folder, named in `block.toml`."""
    brought: Brought
    """What to tell the user."""


def known_photos(foreign: ExchangeBlock, names: Mapping[str, str]) -> dict[str, str]:
    """Photos of the block by the foreign name."""
    # Some formats have no blanks in names.
    names = {one_word(name): ours for name, ours in names.items()} | dict(names)
    found: dict[str, str] = {}
    for theirs, photo in foreign.photos.items():
        for candidate in (theirs, scan_stem(theirs), scan_stem(photo.file)):
            plain = candidate.lower()
            ours = names.get(plain) or names.get(plain.removesuffix(UPRIGHT_SUFFIX))
            if ours is not None:
                found[theirs] = ours
                break
    return found


def no_scan_of_it(path: Path, foreign: ExchangeBlock, names: Mapping[str, str]) -> ProjectError:
    """The error of a file that knows no scan of the block."""
    return ProjectError(
        path,
        "knows no scan of this block; it names {theirs}.",
        "The scans of the block are {ours}.",
        theirs=", ".join(list(foreign.photos)[:3]),
        ours=", ".join(list(names.values())[:3]),
    )


def told_strangers(names: Sequence[str]) -> tuple[str, ...]:
    """A word on photos of a file that are no scans of the block; none where there are none."""
    if not names:
        return ()
    return (
        say(
            "{count:# photo is|# photos are} no scan of this block: {names}.",
            count=len(names),
            names=names[:5],
        ),
    )


def write_lists(
    folder: Path,
    foreign: ExchangeBlock,
    own: Mapping[str, str],
    path: Path,
    name: str,
    *,
    ties: ExchangeTies,
) -> dict[tuple[str, str], object]:
    """Orientations, fiducials and ties as files of the block; the keys of `block.toml` for them."""
    changes: dict[tuple[str, str], object] = {}
    if len(ties.point):
        file = folder / BROUGHT / ties_name(name)
        with whole_file(file) as temporary:
            write_ties(temporary, ties)
        changes["scans", "ties"] = file.relative_to(folder).as_posix()
    placed = {
        ours: foreign.photos[theirs]
        for theirs, ours in own.items()
        if foreign.photos[theirs].centre is not None
    }
    if placed:
        file = folder / BROUGHT / f"{name}-{path.stem}.csv"
        with whole_file(file) as temporary:
            listed = {n: replace(p, photo_id=n, file=n) for n, p in placed.items()}
            write_eo_block(temporary, ExchangeBlock(photos=listed))
        changes["scans", "exterior"] = file.relative_to(folder).as_posix()
    marked = {
        ours: foreign.photos[theirs]
        for theirs, ours in own.items()
        if foreign.photos[theirs].fiducials_px
    }
    for photo in marked.values():
        image = Path(photo.file).name
        with whole_file(folder / BROUGHT / image_measures_name(image)) as temporary:
            write_image_measures(temporary, image, photo.fiducials_px)
    if marked:
        changes["scans", "fiducial_measures"] = f"{BROUGHT}/{image_measures_name('*')}"
    return changes


def ties_name(form: str) -> str:
    """File of the tie points that a format brought."""
    return f"{form}-ties.csv"


def write_keys(project: Project, changes: Mapping[tuple[str, str], object]) -> None:
    """Name lists in `block.toml`, whose other text stays as it is."""
    if changes:
        text = project.file.read_text(encoding="utf-8")
        with whole_file(project.file) as temporary:
            temporary.write_text(with_values(text, changes), encoding="utf-8")
