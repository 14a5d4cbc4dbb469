"""A `block.toml` for a folder."""

import argparse
from collections.abc import Iterable
from pathlib import Path

from app.foreign_block import new_from
from app.margin import ReadScan, accepted_values, margin_reader, read_scan
from app.new_block import Recognition, recognise, refuse_second, write_block_toml
from app.stand_ins import make_stand_ins
from app.terminal import Voice


def new(given: argparse.Namespace, voice: Voice) -> None:
    """Write the `block.toml` of a folder, and say what was recognised and what was not."""
    if given.sizes:
        refuse_second(given.folder)
        count = make_stand_ins(given.folder, given.sizes)
        voice.say(voice.tell("new.stand-ins", count=count))
    if given.format:
        made = new_from(given.folder, given.format, given.project, given.crs, given.operator)
        voice.say(voice.tell("new.written", file=made.file))
        for note in made.notes:
            voice.say(note)
        return
    found = recognise(given.folder)
    read = _read_margins(found, voice) if given.read_margin or given.accept_margin else ()
    accepted = accepted_values(read) if given.accept_margin else {}
    path = write_block_toml(found, accepted=accepted)
    tell = voice.tell
    voice.say(tell("new.written", file=path))
    for name, value in found.found:
        voice.say(tell("new.found", what=tell(f"found.{name}"), value=value))
    for gap in found.gaps:
        values = {"what": tell(f"gap.{gap.name}"), "out": tell(f"gap.out.{gap.out}")}
        voice.say(tell("new.missing", **values))
    for note in found.notes:
        voice.say(tell(f"found.note.{note.name}", **note.values))


def _read_margins(found: Recognition, voice: Voice) -> tuple[ReadScan, ...]:
    """What is written beside the pictures, told scan by scan."""
    reader = margin_reader()
    frame_mm = None if found.frame_mm is None else (found.frame_mm, found.frame_mm)
    scans = sorted({path for name in found.scans for path in _paths(found.folder, name)})
    progress, read = voice.stage("margin", voice.tell("margin.read")), []
    for path in scans:
        read.append(read_scan(path, reader, frame_mm, found.scan_pixel_um))
        progress.report(len(read), len(scans), path.name)
    for scan in read:
        for one in scan.fields:
            what = voice.tell(f"margin.{one.name}")
            values = {"scan": scan.path.name, "value": one.value, "text": one.line.text}
            voice.say(voice.tell("margin.found", what=what, **values))
        if not scan.fields:
            voice.say(voice.tell("margin.none", scan=scan.path.name))
    return tuple(read)


def _paths(folder: Path, name: str) -> Iterable[Path]:
    """The file of a path, whatever signs are in it, else those of a glob."""
    path = folder / name
    return [path] if path.is_file() else folder.glob(name)
