"""XML of other programs: parsed without entities; errors name file and element."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from core.errors import ExchangeError
from core.formats.records import read_bytes

AGAIN = "Export it again from the program that wrote it."
"""What helps where a file is damaged."""
HEADING = b'<?xml version="1.0" encoding="UTF-8" ?>\n'
"""First line of what we write."""
Element = ElementTree.Element
"""One element of a parsed file."""


def read_xml(path: Path, *roots: str) -> Element:
    """The root of a file.

    Args:
        path: The file.
        roots: What its root may be called; anything, if none is given.

    Raises:
        ExchangeError: Not there, damaged, with entities or a document type, or another root.
    """
    content = read_bytes(path)
    try:
        root: Element = fromstring(content, forbid_dtd=True)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        if isinstance(error, DefusedXmlException):
            raise ExchangeError(
                path,
                "It declares entities or a document type, which no such file needs.",
                "Take the declaration out, or do not use the file.",
            ) from error
        raise ExchangeError(path, "It is no whole XML ({error}).", AGAIN, error=error) from error
    if roots and root.tag not in roots:
        raise ExchangeError(
            path,
            "Its root is {tag}, not {roots}.",
            "Choose the file that the program wrote for this purpose.",
            tag=str(root.tag)[:60],
            roots=", ".join(roots),
        )
    return root


def child(element: Element, tag: str, path: Path) -> Element:
    """The first element of that path below another.

    Raises:
        ExchangeError: There is none.
    """
    found = element.find(tag)
    if found is None:
        raise ExchangeError(
            path, "The element {tag} is missing in {where}.", AGAIN, tag=tag, where=element.tag
        )
    return found


def text_of(element: Element, tag: str, path: Path) -> str:
    """Text of a child, trimmed of blanks and quotation marks.

    Raises:
        ExchangeError: There is none, or it is empty.
    """
    text = trimmed(child(element, tag, path))
    if not text:
        raise ExchangeError(path, "The element {tag} is empty.", AGAIN, tag=tag)
    return text


def trimmed(element: Element | None) -> str:
    """Text without the blanks and quotation marks around it; empty where there is none."""
    return ("" if element is None else element.text or "").strip().strip('"').strip()


def numbers_of(element: Element, tag: str, count: int, path: Path) -> tuple[float, ...]:
    """Finite numbers of a child.

    Raises:
        ExchangeError: Missing, not so many, or no finite numbers.
    """
    return numbers_in(text_of(element, tag, path), count, tag, path)


def number_of(element: Element, tag: str, path: Path) -> float:
    """The one number of a child."""
    return numbers_of(element, tag, 1, path)[0]


def own_number(element: Element, path: Path) -> float:
    """The one number of an element itself."""
    return numbers_in(element.text or "", 1, element.tag, path)[0]


def numbers_in(text: str, count: int, tag: str, path: Path) -> tuple[float, ...]:
    """Finite numbers of a text.

    Raises:
        ExchangeError: Not so many, or no finite numbers.
    """
    try:
        values = tuple(float(word) for word in text.split())
    except ValueError:
        values = ()
    if len(values) != count or not np.isfinite(values).all():
        raise ExchangeError(
            path,
            "{tag} holds {text!r} where {count:# number|# numbers} must stand.",
            AGAIN,
            tag=tag,
            text=text[:60],
            count=count,
        )
    return values


def digits(values: Iterable[float]) -> str:
    """Numbers with all their digits, a blank between two."""
    return " ".join(repr(float(value)) for value in values)


def add(parent: Element, tag: str, text: str = "") -> Element:
    """A new child, with its text."""
    made = ElementTree.SubElement(parent, tag)
    if text:
        made.text = text
    return made


def write_xml(path: Path, root: Element) -> None:
    """Write a file, indented, UTF-8."""
    path.parent.mkdir(parents=True, exist_ok=True)
    ElementTree.indent(root, "     ")
    path.write_bytes(HEADING + ElementTree.tostring(root, encoding="utf-8") + b"\n")
