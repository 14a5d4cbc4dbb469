"""The form of the start page: checks single keys of `block.toml` and writes them into the file."""

import math
import tomllib
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import date
from pathlib import Path
from typing import Any, cast

from app.block_schema import TABLES, Key, keys_of, missing_reference
from app.block_sections import fiducials_of, read_block, read_camera, taken_in
from app.block_toml import Document, FieldError, Table
from app.block_writing import with_values
from app.new_block import CAMERA, Recognition, toml_of
from app.project import Project, may_have_points, project_of
from core.errors import PhotogrammetryError, ProjectError
from core.said import say
from sessions.atomic_write import whole_file

FILES = ("file", "files", "rasters")


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """A `block.toml` as it would be, and what is wrong with it."""

    text: str
    """What would be written."""
    errors: Mapping[str, str]
    """Why a field cannot be used, by `table.key`; under no name what concerns the whole file."""
    missing: tuple[str, ...]
    """Fields that still have to be filled in."""
    project: Project | None = None
    """The block, where all is there."""

    def part(self) -> dict[str, Any]:
        """As the page is told."""
        ready = self.project is not None
        return {"errors": dict(self.errors), "missing": list(self.missing), "ready": ready}


@dataclass(frozen=True, slots=True, eq=False)
class FormRead:
    """The form as it stands on the disk, completed by what was found."""

    sections: list[dict[str, Any]]
    """Tables with their fields."""
    judged: Judged
    """What is wrong with the file; of a file that is not there, with what would be proposed."""
    written: frozenset[str]
    """Keys that the file has, those of any camera under `camera`."""
    values: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """Everything the file says."""
    files: tuple[Path, ...] = ()
    """Files it names, as far as they are there."""
    scans: tuple[Path, ...] = ()
    """Its scans."""

    @property
    def project(self) -> Project | None:
        """The block, where the file describes one."""
        return self.judged.project if self.written else None

    @property
    def crs(self) -> str:
        """The block's CRS; empty where it has none."""
        block = self.values.get("block", {})
        crs = cast("dict[str, Any]", block).get("crs", "") if isinstance(block, dict) else ""
        return crs if isinstance(crs, str) else ""

    def part(self) -> dict[str, Any]:
        """As the page is told."""
        return {"sections": self.sections, **self.judged.part()}


class BlockForm:
    """The form of one `block.toml`, which need not be there yet."""

    def __init__(self, file: Path) -> None:
        self.file = file

    def read(self, recognition: Recognition) -> FormRead:
        """Values of the file; where it lacks one, the one that the folder proposes."""
        proposed = tomllib.loads(toml_of(recognition))
        try:
            document = Document(self.file) if self.file.is_file() else None
        except PhotogrammetryError as error:
            return FormRead([], Judged("", {"": error.told}, ()), frozenset({""}))
        given = proposed if document is None else document.values
        known = {} if document is None else given
        # As if nothing of it were there: what is filled in is no less required.
        needed = {
            key
            for out in ({"reference": {}}, {"reference": {"ortho": ""}})
            for key in missing_reference(given | out, brought=False)
        }
        sections = [_section(name, known, proposed, needed) for name in _tables(given)]
        for shown in (one for section in sections for one in section["fields"]):
            name = shown["key"].removesuffix("_sigma_m")
            if name != shown["key"] and name in recognition.pixels_m:
                shown["why"] = [name, recognition.pixels_m[name]]
        base = Document(self.file, toml_of(recognition)) if document is None else document
        files = dict(_files(base))
        return FormRead(
            sections,
            judged(base),
            frozenset() if document is None else frozenset(_written(document.values)),
            given,
            tuple(path for found in files.values() for path in found),
            files.get("scans.files", ()),
        )

    def save(
        self,
        values: Mapping[str, Any],
        recognition: Recognition,
        seen: Mapping[str, Any] | None,
    ) -> Judged:
        """Write the file unless a value cannot be used; arguments as for `_hold` and `judged`.

        Raises:
            ProjectError: As for `_hold` and `judged`.
            StorageError: The disk is full.
        """
        self._hold(values, recognition, seen or {})
        found = self.judged(values, recognition, seen)
        if not found.errors:
            with whole_file(self.file) as temporary:
                temporary.write_text(found.text, encoding="utf-8")
        return found

    def _hold(
        self, values: Mapping[str, Any], recognition: Recognition, seen: Mapping[str, Any]
    ) -> None:
        """Refuse fields that somebody else has saved since they were shown.

        Args:
            values: Every field, as it stands on the page.
            recognition: What the folder proposes: it is nobody's.
            seen: What the file had of the fields that a hand has changed; None where it had none.

        Raises:
            ProjectError: The file has something else by now, and the page yet another thing.
        """
        if not self.file.is_file():
            return
        now, proposed = Document(self.file).values, tomllib.loads(toml_of(recognition))
        others: list[str] = []
        for name, old in seen.items():
            table, _, key = name.rpartition(".")
            value = _value_in(now, table, key)
            was_empty = old is None and value == _proposal(proposed, table, key)
            if value not in (old, values.get(name)) and not was_empty:
                others.append(f"[{table}] {key}")
        if others:
            raise ProjectError(
                self.file,
                say("has been saved with another {fields} meanwhile.", fields=", ".join(others)),
                "Look at what it has now; save once more to replace that.",
            )

    def judged(
        self,
        values: Mapping[str, Any],
        recognition: Recognition,
        written: Collection[str] | None = None,
    ) -> Judged:
        """The file with the values of the form, judged field by field.

        Args:
            values: Every field, as it stands on the page.
            recognition: What the folder proposes: it fills what the file lacks.
            written: Fields that a hand has changed, by default all. Of the others the file may
                have a newer value by now, which stays.

        Raises:
            ProjectError: A field that is no field of the form.
        """
        text = toml_of(recognition)
        if self.file.is_file():
            text = Document(self.file).text
        now: dict[str, Any] = tomllib.loads(text)
        proposed = tomllib.loads(toml_of(recognition))
        changes: dict[tuple[str, str], Any] = {}
        twice: dict[str, str] = {}
        for name, value in values.items():
            table, _, key = name.rpartition(".")
            self._check(table, key)
            if written is not None and name not in written:
                if _value_in(now, table, key) is None and _proposal(proposed, table, key) == value:
                    changes[table, key] = value
                continue
            if keys_of(table)[key].kind == "marks" and isinstance(value, list):
                marks = Counter(mark for mark, _ in value)
                again, _ = marks.most_common(1)[0]
                twice[name] = say("Mark {name} is listed twice.", name=again)
                continue
            if _value_in(now, table, key) != value:
                changes[table, key] = value
        if _value_in(now, "scans", "camera") is None:
            cameras = [name for name in _tables(now) if name.startswith("camera.")]
            changes["scans", "camera"] = cameras[0].removeprefix("camera.")
        found = judged(Document(self.file, with_values(text, changes)))
        return (
            found if not twice else replace(found, errors={**found.errors, **twice}, project=None)
        )

    def _check(self, table: str, key: str) -> None:
        known = table in TABLES or table.startswith("camera.")
        if not known or key not in keys_of(table):
            raise ProjectError(
                self.file,
                say("{table}.{key} is no field.", table=table, key=key),
                "Open the page again.",
            )


def judged(document: Document) -> Judged:
    """What is wrong with a `block.toml`, every field by itself."""
    errors: dict[str, str] = {}
    missing: list[str] = []
    for name in _tables(document.values):
        try:
            table = document.table(*name.split("."))
        except FieldError as error:
            errors[f"{error.table}.{error.key}"] = _why(error)
            continue
        except PhotogrammetryError as error:
            errors[""] = error.told
            continue
        for key in table.keys.values():
            if key.required and not table.has(key.name):
                missing.append(f"{name}.{key.name}")
            else:
                errors |= _error_of(table, key)
        sound = not any(one.startswith(f"{name}.") for one in (*errors, *missing))
        errors |= _error_of_table(document, table, sound=sound)
    missing += [
        f"reference.{key}"
        for key in missing_reference(document.values, brought=may_have_points(document))
    ]
    project = None
    if not errors and not missing:
        try:
            project = project_of(document)
        except FieldError as error:
            errors[f"{error.table}.{error.key}"] = _why(error)
        except PhotogrammetryError as error:
            errors[""] = error.told
    return Judged(document.text, errors, tuple(missing), project)


def _why(error: FieldError) -> str:
    """What is wrong and what to do; the field stands above it.

    Brackets and quotes of the file are not typed into a field, and what was typed stands in it.
    """
    cause, remedy = error.cause, error.remedy
    if error.numbers == 1:
        cause, remedy = say("This is not a number."), say("Write digits alone, such as 12.5.")
    elif error.numbers:
        cause = say("{count:# number belongs|# numbers belong} here.", count=error.numbers)
        remedy = say("Write digits alone and a space between numbers, such as 84.5 −0.3.")
    return say("{cause} {remedy}", cause=cause, remedy=remedy)


def _error_of(table: Table, key: Key) -> dict[str, str]:
    try:
        table.checked(key.name)
    except FieldError as error:
        return {f"{table.name}.{key.name}": _why(error)}
    except PhotogrammetryError as error:
        return {f"{table.name}.{key.name}": error.told}
    return {}


def _error_of_table(document: Document, table: Table, *, sound: bool) -> dict[str, str]:
    """What of a table cannot be, such as a principal point outside the picture.

    Of one that is not sound, in which a key is wrong or missing, what does not hang on that key.
    """
    try:
        if table.name == "scans":
            taken_in(table)
        elif table.name == "block" and sound:
            read_block(document)
        elif table.name.startswith("camera.") and sound:
            read_camera(document, table.name.removeprefix("camera."))
        elif table.name.startswith("camera."):
            fiducials_of(table, math.inf)
    except FieldError as error:
        return {f"{error.table}.{error.key}": _why(error)}
    except PhotogrammetryError as error:
        return {"": error.told}
    return {}


def _tables(values: Mapping[str, Any]) -> Iterator[str]:
    """Tables of the form, a camera's by its name."""
    for name in ("block", "camera", "scans", "reference", "control", "ortho", "sheets"):
        if name != "camera":
            yield name
            continue
        cameras: Any = values.get("camera", {})
        for camera in cameras if isinstance(cameras, dict) and cameras else {CAMERA: {}}:
            yield f"camera.{camera}"


def _section(
    name: str, given: Mapping[str, Any], proposed: Mapping[str, Any], needed: Collection[str]
) -> dict[str, Any]:
    """A table of the form with what its fields hold."""
    fields: list[dict[str, Any]] = []
    for key in keys_of(name).values():
        if key.asked == "file":
            continue
        value = _value_in(given, name, key.name)
        if key.kind == "time" and isinstance(value, dict):
            continue  # days by file are written in the file alone
        known = value is not None
        value = value if known else _proposal(proposed, name, key.name)
        unit = [] if key.unit is None else [key.unit.low, key.unit.high]
        fields.append(
            {
                "key": key.name, "kind": key.kind, "value": value, "known": known,
                "default": key.default, "range": unit,
                "required": key.required or (name == "reference" and key.name in needed),
                "choices": list(key.choices), "count": key.count, "more": key.asked == "more",
            }
        )  # fmt: skip
    return {"table": name, "kind": name.partition(".")[0], "fields": fields}


def _proposal(proposed: Mapping[str, Any], table: str, key: str) -> Any:
    """What the folder proposes for a field; to every camera the same."""
    return _value_in(proposed, f"camera.{CAMERA}" if table.startswith("camera.") else table, key)


def _value_in(values: Mapping[str, Any], table: str, key: str) -> Any:
    found: Any = values
    for part in (*table.split("."), key):
        found = found.get(part) if isinstance(found, dict) else None
    return found.isoformat() if isinstance(found, date) else found


def _written(values: Mapping[str, Any]) -> Iterator[str]:
    """Keys that a file has; a camera's under `camera`."""
    yield ""
    for name in _tables(values):
        for key in keys_of(name):
            if _value_in(values, name, key) is not None:
                yield f"{name.partition('.')[0]}.{key}"


def _files(document: Document) -> Iterator[tuple[str, tuple[Path, ...]]]:
    """Files that a `block.toml` names, by key, as far as they are there."""
    for name in _tables(document.values):
        for key in keys_of(name).values():
            with suppress(PhotogrammetryError):
                table = document.table(*name.split("."))
                if key.kind in FILES and table.has(key.name):
                    yield f"{name}.{key.name}", table.files(key.name)
