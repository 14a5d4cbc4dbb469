"""MicMac's tie points: Homol/PastisONE/OTHER.dat or .txt, and couples of scans (FORMATS 4.21).

A file holds the pairs of two scans, and another the same pairs the other way round; here a tie
point is one place in all its photos. Pixels count from the centre of the first pixel there, from
its outer corner here. Binary: 2, number of pairs, and for each 2, a weight and four doubles.
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float64, Int
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components

from core.errors import ExchangeError
from core.formats.exchange import ExchangeTies
from core.formats.records import read_bytes, read_text
from core.formats.xml_files import AGAIN, add, read_xml, trimmed, write_xml
from core.frames import HALF_PIXEL
from core.said import Said, say

FOLDER, PREFIX = "Homol", "Pastis"
COUPLES, COUPLE = "SauvegardeNamedRel", "Cple"
Pairs = Float64[np.ndarray, "n 4"]
"""Column, row in one scan; column, row in the other."""
PLACES = 2  # source: MicMac's own writer; so many places has a pair.
"""Begins a binary file, and each pair in it."""
# source: MicMac's own writer.
RECORD = np.dtype([("places", "<i4"), ("weight", "<f8"), ("pixels", "<f8", (4,))])
"""A pair in a binary file."""
COLUMNS = (4, 5)  # source: MicMac's own reader; the fifth is a weight.
"""Numbers a line of text may hold."""
HEAD = 8  # source: MicMac's own writer; two whole numbers of four bytes.
"""Bytes before the first pair."""


@dataclass(frozen=True, slots=True, eq=False)
class ReadTies:
    """What a folder of tie points gave."""

    ties: ExchangeTies
    """The tie points; their photos are named by the scans' file names."""
    notes: tuple[Said, ...]
    """What was left out."""


def read_homol(folder: Path) -> ReadTies:
    """Read all files of a Homol folder, and chain their pairs.

    Raises:
        ExchangeError: A damaged file.
    """
    files = _files(folder)
    scans = tuple(sorted({scan for couple in files for scan in couple}))
    number = {scan: index for index, scan in enumerate(scans)}
    ends: list[np.ndarray] = []
    for (one, other), path in files.items():
        pairs = read_pairs(path)
        for scan, columns in ((one, pairs[:, :2]), (other, pairs[:, 2:])):
            ends.append(np.column_stack([np.full(len(pairs), number[scan]), columns]))
    if not ends:
        return ReadTies(ExchangeTies.none(), ())
    firsts, seconds = np.concatenate(ends[::2]), np.concatenate(ends[1::2])
    rays, places = np.unique(np.concatenate([firsts, seconds]), axis=0, return_inverse=True)
    return _chained(scans, rays, places.reshape(2, -1))


def _files(folder: Path) -> dict[tuple[str, str], Path]:
    """Files by their two scans; the binary one where there are both."""
    found: dict[tuple[str, str], Path] = {}
    for ending in (".txt", ".dat"):
        for path in sorted(folder.glob(f"{PREFIX}*/*{ending}")):
            found[path.parent.name.removeprefix(PREFIX), path.name.removesuffix(ending)] = path
    return found


def _chained(
    scans: tuple[str, ...], rays: Float64[np.ndarray, "rays 3"], links: Int[np.ndarray, "2 pairs"]
) -> ReadTies:
    """Tie points of rays (scan, column, row) that pairs link."""
    count = len(rays)
    graph = coo_matrix((np.ones(links.shape[1]), (links[0], links[1])), shape=(count, count))
    _, chain = connected_components(graph, directed=False)
    photo = rays[:, 0].astype(np.int64)
    # A chain that meets one scan twice leads two places together: nobody knows which is right.
    _, first, times = np.unique(
        np.column_stack([chain, photo]), axis=0, return_index=True, return_counts=True
    )
    wrong = np.unique(chain[first[times > 1]])
    kept = ~np.isin(chain, wrong)
    _, point = np.unique(chain[kept], return_inverse=True)
    order = np.lexsort([photo[kept], point])
    pixels = rays[kept][:, 1:] + HALF_PIXEL
    ties = ExchangeTies(scans, point[order], photo[kept][order], pixels[order])
    notes = ()
    if len(wrong):
        notes = (
            say(
                "{count:# tie point meets|# tie points meet} a scan in two places and "
                "{count:is|are} left out.",
                count=len(wrong),
            ),
        )
    return ReadTies(ties, notes)


def read_pairs(path: Path) -> Pairs:
    """Pairs of a file, text or binary, as they stand there.

    Raises:
        ExchangeError: Damaged.
    """
    pairs = _binary(path) if path.suffix == ".dat" else _text(path)
    if not np.isfinite(pairs).all():
        raise ExchangeError(path, "A pair holds a number that is not finite.", AGAIN)
    return pairs


def _binary(path: Path) -> Pairs:
    """Pairs of a binary file."""
    content = read_bytes(path)
    count = int(np.frombuffer(content, "<i4", 1, 4)[0]) if len(content) >= HEAD else -1
    if count < 0 or len(content) != HEAD + count * RECORD.itemsize:
        raise ExchangeError(path, "It is cut off, or no file of tie points of MicMac.", AGAIN)
    records = np.frombuffer(content, RECORD, count, HEAD)
    if np.frombuffer(content, "<i4", 1)[0] != PLACES or (records["places"] != PLACES).any():
        raise ExchangeError(path, "It is cut off, or no file of tie points of MicMac.", AGAIN)
    return np.array(records["pixels"], dtype=np.float64).reshape(-1, 4)


def _text(path: Path) -> Pairs:
    """Pairs of a text: four numbers a line, perhaps a weight."""
    rows: list[list[float]] = []
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        words = line.split()
        if not words:
            continue
        try:
            rows.append([float(word) for word in words[:4]])
        except ValueError:
            words = []
        if len(words) not in COLUMNS:
            raise ExchangeError(
                path, "Line {number} is not of four numbers and a weight.", AGAIN, number=number
            )
    return np.array(rows, dtype=np.float64).reshape(-1, 4)


def write_homol(
    folder: Path, ties: ExchangeTies, files: Mapping[str, str], text: bool = False
) -> list[tuple[str, str]]:
    """Write tie points by pairs, both ways round.

    Args:
        folder: The Homol folder.
        ties: The tie points.
        files: File names of the scans by photo.
        text: Writes text, which MicMac reads with ExpTxt=1; else binary.

    Returns:
        The couples of scans that share tie points.
    """
    scans = [files[name] for name in ties.photo_ids]
    shape = (int(ties.point.max(initial=-1)) + 1, len(scans))
    couples: list[tuple[str, str]] = []
    seen = csr_matrix((np.ones(len(ties.point)), (ties.point, ties.photo)), shape=shape)
    shared = (seen.T @ seen).tocoo()
    rays = [np.flatnonzero(ties.photo == photo) for photo in range(len(scans))]
    for one, other in sorted(zip(shared.row.tolist(), shared.col.tolist(), strict=True)):
        if one == other:
            continue
        _, here, there = np.intersect1d(
            ties.point[rays[one]], ties.point[rays[other]], return_indices=True
        )
        left, right = ties.pixels[rays[one][here]], ties.pixels[rays[other][there]]
        pairs = np.column_stack([left, right]) - HALF_PIXEL
        _write_pairs(folder / f"{PREFIX}{scans[one]}" / scans[other], pairs, text)
        if one < other:
            couples.append((scans[one], scans[other]))
    return couples


def _write_pairs(path: Path, pairs: Pairs, text: bool) -> None:
    """One file; its ending is added."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if text:
        lines = (" ".join(map(repr, row)) + " 1\n" for row in pairs.tolist())
        path.with_name(f"{path.name}.txt").write_text("".join(lines), encoding="utf-8")
        return
    records = np.zeros(len(pairs), RECORD)
    records["places"], records["weight"], records["pixels"] = PLACES, 1.0, pairs
    head = np.array([PLACES, len(pairs)], dtype="<i4").tobytes()
    path.with_name(f"{path.name}.dat").write_bytes(head + records.tobytes())


def read_couples(path: Path) -> list[tuple[str, str]]:
    """Couples of scans of a file such as img_pairs.xml.

    Raises:
        ExchangeError: Damaged, or a couple that is not of two names.
    """
    found: list[tuple[str, str]] = []
    for one in read_xml(path, COUPLES).iter(COUPLE):
        words = trimmed(one).split()
        if len(words) != 2:
            raise ExchangeError(path, "{text!r} is no couple.", AGAIN, text=trimmed(one)[:60])
        found.append((words[0], words[1]))
    return found


def write_couples(path: Path, couples: Iterable[tuple[str, str]]) -> None:
    """Write couples of scans for Tapioca File."""
    root = ElementTree.Element(COUPLES)
    for one, other in couples:
        add(root, COUPLE, f"{one} {other}")
    write_xml(path, root)
