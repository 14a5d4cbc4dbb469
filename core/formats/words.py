"""Names as single words, for formats in which blanks part the columns."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import PurePath

from core.formats.exchange import ExchangeBlock
from core.formats.records import one_word
from core.said import say


def in_words(block: ExchangeBlock, *, scans: bool = True) -> tuple[ExchangeBlock, tuple[str, ...]]:
    """A block whose photos, scans, points and ties bear names without blanks, each its own.

    Args:
        block: The block.
        scans: Whether the files of scans are renamed, too; else they stay what they are.

    Returns:
        The block, and a sentence on what was renamed, where there is any.
    """
    photos, points = _words(block.photos), _words(block.points)
    ties = _words(block.ties.names)
    files = {
        name: one.file
        if not scans or one.file == one_word(one.file)
        else photos[name] + one_word(PurePath(one.file).suffix).strip("-")
        for name, one in block.photos.items()
    }
    named = {one.file: files[name] for name, one in block.photos.items()} if scans else photos
    renamed = named | points
    renamed = {name: word for name, word in renamed.items() if name != word}
    if not renamed and all(name == word for name, word in (photos | ties).items()):
        return block, ()
    measured = (
        replace(
            one,
            point_id=points.get(one.point_id, one_word(one.point_id)),
            photo_id=photos.get(one.photo_id, one_word(one.photo_id)),
        )
        for one in block.measurements
    )
    words = replace(
        block,
        photos={
            photos[name]: replace(one, photo_id=photos[name], file=files[name])
            for name, one in block.photos.items()
        },
        points={
            points[name]: replace(one, point_id=points[name]) for name, one in block.points.items()
        },
        measurements=tuple(measured),
        ties=replace(
            block.ties,
            photo_ids=tuple(photos.get(name, one_word(name)) for name in block.ties.photo_ids),
            names=tuple(ties[name] for name in block.ties.names),
        ),
    )
    told = say(
        "Blanks part the columns there, so {names} went out as {words}.",
        names=list(renamed),
        words=list(renamed.values()),
    )
    return words, (told,) if renamed else ()


def _words(names: Iterable[str]) -> dict[str, str]:
    """A word for every name; what is one already stays what it is."""
    every = list(dict.fromkeys(names))
    found = {name: name for name in every if name == one_word(name)}
    for name in every:
        word, count = one_word(name), 1
        while name not in found and word in found.values():
            count += 1
            word = f"{one_word(name)}_{count}"
        found.setdefault(name, word)
    return found
