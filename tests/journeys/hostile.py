"""Ways to spoil any file or folder: what a bad disk, a bad copy or a bad neighbour may hand in."""

import gzip
import io
import json
import os
import re
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

Rng = np.random.Generator
ABSURD_NUMBERS = (
    "nan", "inf", "-inf", "1e308", "-1e308", "1e400", "-0", "0", "5e-324", "-1", "1e18",
    "2147483648", "18446744073709551616", "99999999999999999999999999", "9" * 5000, "0x1F", "1_000",
    "1,5", "12.5.6", "--3", "", "\u0661\u0662", "true", "None", "1e5", "0.000001", "999999", "3.5",
)  # fmt: skip
"""Written in the place of a number."""
ABSURD_WORDS = (
    "", " ", "a" * 5000, "../../../etc/passwd", "-rf", "příliš žluťoučký kůň", "a\nb", "\u202eabc",
    "\x1b[31m", "{0}", "{name}", "%s%n", "NULL", "\ufeff", "\U0001f600",
    "'; DROP TABLE decisions;--",
    "/dev/zero", "C:\\scans\\1.tif", "EPSG:0", "EPSG:99999999", "EPSG:4326", "+proj=utm +zone=99",
)  # fmt: skip
"""Written in the place of a word."""
ODD_NAMES = (
    "with blanks in it", "příliš žluťoučký", "two\nlines", "x" * 240, "-rf", "[a]*?", "a.b.c..d",
    "\udcff\udcfe", "%20%s", "{0}", "'quoted\"", "|layername=x", "\t",
)  # fmt: skip
"""Names of files; one of them is no text in any encoding."""
NUMBER = re.compile(rb"[-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
WORD = re.compile(rb"[A-Za-z][A-Za-z0-9_.]{2,}")
ENTITIES = (
    b'<!DOCTYPE a [<!ENTITY x "ha">%s]>'
    % b"".join(b'<!ENTITY x%d "%s">' % (n, b"&x%d;" % (n - 1) * 10) for n in range(1, 12)),
    b'<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]>',
    b'<!DOCTYPE a SYSTEM "http://127.0.0.1:9/a.dtd">',
)
"""A billion laughs, a file of the machine, a document from elsewhere."""


def files_in(folder: Path) -> list[Path]:
    """Regular files, in an order that hangs on their names alone."""
    return sorted(path for path in folder.rglob("*") if path.is_file() and not path.is_symlink())


def put(path: Path, content: bytes) -> None:
    """Another content; what the file was linked with keeps its own."""
    path.unlink()
    path.write_bytes(content)


def _of(rng: Rng, values: Any) -> Any:
    return values[int(rng.integers(len(values)))]


Change = Callable[[Rng, bytes], bytes]
"""The content of a file, spoilt."""


def _cut(rng: Rng, data: bytes) -> bytes:
    return data[: int(rng.integers(len(data) + 1))]


def _flip(rng: Rng, data: bytes) -> bytes:
    spoilt = bytearray(data)
    for _ in range(int(rng.integers(1, 20))):
        # Half of them at the beginning, where heads are.
        reach = len(data) if rng.random() < 0.5 else min(len(data), 512)
        spoilt[int(rng.integers(reach))] ^= 1 << int(rng.integers(8))
    return bytes(spoilt)


def _huge_count(rng: Rng, data: bytes) -> bytes:
    """Four or eight bytes that say a huge, negative or not finite number."""
    value = _of(rng, (b"\xff" * 8, b"\xff\xff\xff\x7f", b"\0\0\0\x80", b"\0" * 8,
                      b"\0\0\0\0\0\0\xf8\x7f",
                      b"\0\0\0\0\0\0\xf0\x7f", b"\x40\x42\x0f\0", b"\0\x0f\x42\x40"))  # fmt: skip
    place = int(rng.integers(min(len(data), 4096 if rng.random() < 0.7 else len(data))))
    return data[:place] + value + data[place + len(value) :]


def _hole(rng: Rng, data: bytes) -> bytes:
    begin = int(rng.integers(len(data)))
    length = int(rng.integers(1, max(2, len(data) // 4)))
    return data[:begin] + bytes(min(length, len(data) - begin)) + data[begin + length :]


def _lines(rng: Rng, data: bytes) -> bytes:
    """Lines dropped, doubled or in another order."""
    lines = data.split(b"\n")
    which = int(rng.integers(3))
    if which == 0:
        return b"\n".join(line for line in lines if rng.random() < 0.8)
    if which == 1:
        return b"\n".join(line for line in lines for _ in range(1 + (rng.random() < 0.2)))
    return b"\n".join(lines[i] for i in rng.permutation(len(lines)))


def _numbers(rng: Rng, data: bytes) -> bytes:
    return _replaced(rng, data, NUMBER, ABSURD_NUMBERS)


def _words(rng: Rng, data: bytes) -> bytes:
    return _replaced(rng, data, WORD, ABSURD_WORDS)


def _replaced(rng: Rng, data: bytes, what: re.Pattern[bytes], values: tuple[str, ...]) -> bytes:
    """One to three of the places, or all of one kind, written otherwise."""
    places = [found.span() for found in what.finditer(data[:200_000])]
    if not places:
        return data + _of(rng, values).encode()
    chosen = {int(rng.integers(len(places))) for _ in range(int(rng.integers(1, 4)))}
    for index in sorted(chosen, reverse=True):
        begin, end = places[index]
        data = data[:begin] + _of(rng, values).encode() + data[end:]
    return data


def _axes(rng: Rng, data: bytes) -> bytes:
    """Neighbouring numbers of every line swapped."""
    return re.sub(rb"(-?\d+\.\d+)([ ,;\t]+)(-?\d+\.\d+)", rb"\3\2\1", data)


def _encoding(rng: Rng, data: bytes) -> bytes:
    text = data.decode("latin-1")
    return _of(rng, (
        lambda: b"\xef\xbb\xbf" + data, lambda: text.encode("utf-16"),
        lambda: text.encode("utf-16-le"),
        lambda: data.replace(b"\n", b"\r\n"), lambda: data.replace(b"\n", b"\r"),
        lambda: text.encode("utf-32"), lambda: b"\xff\xfe" + data, lambda: data + b"\x9e\xe8\xff",
        lambda: data.replace(b" ", b"\0", 1), lambda: data.replace(b" ", "\u00a0".encode()),
        lambda: data.replace(b".", b","),
    ))()  # fmt: skip


def _markup(rng: Rng, data: bytes) -> bytes:
    """Entities, depth, an unknown encoding: XML, whatever the file was."""
    which, plain = int(rng.integers(5)), re.sub(rb"^\s*<\?xml.*?\?>", b"", data)
    if which == 0:
        entity = _of(rng, ENTITIES)
        return entity + plain.replace(b">", b">&x11;" if b"x11" in entity else b">&x;", 1)
    if which == 1:
        return b"<a>" * 200_000 + plain
    if which == 2:
        return (
            b'<?xml version="1.0" encoding="%s"?>' % _of(rng, (b"utf-7", b"nothing", b"idna"))
            + plain
        )
    if which == 3:
        return b"<a>" * 3000 + plain + b"</a>" * 3000
    tags = sorted(set(re.findall(rb"<(\w+)", plain))) or [b"a"]
    tag = _of(rng, tags)
    return re.sub(rb"<%s[^>]*>.*?</%s>" % (tag, tag), b"", data, count=1, flags=re.DOTALL)


WRONG_VALUES: tuple[Any, ...] = (
    None, True, -1, 0, 1e308, 10**400, float("nan"), float("inf"), "", "word", "nan", [], {}, [[]],
    [None], [1, 2, 3, 4], {"a": 1}, "a" * 3000, -0.0, "12", "\ud800",
)  # fmt: skip
"""Put into JSON in the place of another value."""


def _tree(rng: Rng, data: bytes) -> bytes:
    """JSON with another value somewhere, or far too deep."""
    if rng.random() < 0.1:
        return _of(
            rng,
            (b"[" * 100_000, b'{"a":' * 50_000 + b"1" + b"}" * 50_000, b"[1" + b"0" * 5000 + b"]"),
        )
    try:
        whole = json.loads(data)
    except (ValueError, RecursionError):
        return _numbers(rng, data)
    at: Any = whole
    while isinstance(at, dict | list) and at:
        keys = list(at) if isinstance(at, dict) else range(len(at))
        key = _of(rng, keys)
        if not isinstance(at[key], dict | list) or not at[key] or rng.random() < 0.15:
            if isinstance(at, dict) and rng.random() < 0.2:
                del at[key]
            else:
                at[key] = _of(rng, WRONG_VALUES)
            break
        at = at[key]
    return json.dumps(whole).encode()


def _bomb(rng: Rng, data: bytes) -> bytes:
    """What is small here and huge once unpacked."""
    which = int(rng.integers(4))
    if which == 0:
        return BOMBS["gzip"]
    if which == 1:
        return BOMBS["zip"]
    if which == 2:
        return tiff_claims(
            data, *_of(rng, ((10**6, 10**6), (2**31 - 1, 1), (1, 2**31 - 1), (10**5, 10**5)))
        )
    return _of(rng, VRT)


def _gzip_bomb() -> bytes:
    return gzip.compress(bytes(200_000_000), 1)


def _zip_bomb() -> bytes:
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        archive.writestr("doc.xml", bytes(200_000_000))
    return held.getvalue()


class _Bombs(dict[str, bytes]):
    """Packed when they are first asked for."""

    def __missing__(self, name: str) -> bytes:
        self[name] = {"gzip": _gzip_bomb, "zip": _zip_bomb}[name]()
        return self[name]


BOMBS = _Bombs()
VRT = tuple(
    b'<VRTDataset rasterXSize="%d" rasterYSize="%d"><VRTRasterBand dataType="Byte" band="1">'
    b'<SimpleSource><SourceFilename relativeToVRT="0">%s</SourceFilename><SourceBand>1</SourceBand>'
    b"</SimpleSource></VRTRasterBand></VRTDataset>" % claim
    for claim in (
        (10**6, 10**6, b"/dev/null"), (100, 100, b"/etc/passwd"),
        (2**31 - 1, 2**31 - 1, b"nowhere.tif"),
        (100, 100, b"/vsicurl/http://127.0.0.1:9/a.tif"),
    )
)  # fmt: skip
"""Pictures that say they lie elsewhere: GDAL knows them by their content, not by their name."""


def tiff_claims(data: bytes, width: int, height: int) -> bytes:
    """A TIFF that says it is larger than it is; anything else is left as it was."""
    order = {b"II*\0": "little", b"MM\0*": "big"}.get(data[:4])
    if order is None:
        return data
    spoilt, first = bytearray(data), int.from_bytes(data[4:8], order)
    count = int.from_bytes(data[first : first + 2], order)
    for entry in range(first + 2, first + 2 + 12 * count, 12):
        tag = int.from_bytes(data[entry : entry + 2], order)
        if tag in (256, 257):  # source: TIFF 6.0: ImageWidth, ImageLength; as LONG.
            value = width if tag == 256 else height
            spoilt[entry + 2 : entry + 4] = (4).to_bytes(2, order)
            spoilt[entry + 8 : entry + 12] = value.to_bytes(4, order)
    return bytes(spoilt)


TEXT: tuple[Change, ...] = (
    _numbers,
    _numbers,
    _words,
    _axes,
    _encoding,
    _lines,
    _markup,
    _tree,
    _tree,
)
BYTES: tuple[Change, ...] = (_cut, _flip, _hole, _huge_count, _huge_count, _bomb)


def spoil_content(rng: Rng, path: Path, others: list[Path]) -> str:
    """Another content for a file; what was done, in a word."""
    data = path.read_bytes()
    which = rng.random()
    if which < 0.04 or not data:
        put(
            path,
            _of(rng, (b"", b"\n", b" ", b"\0" * 100, bytes(rng.integers(0, 256, 3000, np.uint8)))),
        )
        return "emptied"
    if which < 0.10:
        other = _of(rng, others)
        put(path, other.read_bytes())
        return f"exchanged with {other.name}"
    is_text = b"\0" not in data[:4096]
    change = _of(rng, TEXT if is_text and rng.random() < 0.75 else BYTES)
    put(path, change(rng, data))
    return change.__name__.lstrip("_")


def spoil_place(rng: Rng, path: Path, outside: Path) -> str:
    """Something else in the place of a file or folder: a link, a folder, nothing."""
    kind = _of(rng, (
        "missing", "folder", "file", "nowhere", "circle", "circles", "outside", "zero", "null",
        "pipe", "forbidden", "parent",
    ))  # fmt: skip
    if kind == "forbidden":
        if path.is_file():
            put(path, path.read_bytes())  # a link of its own: the sample keeps its rights
        path.chmod(0)
        return kind
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink()
    other = path.with_name("other-end")
    targets: dict[str, Path] = {
        "nowhere": Path("nowhere/at/all"), "circle": path, "outside": outside,
        "zero": Path("/dev/zero"), "null": Path("/dev/null"), "parent": Path(".."),
    }  # fmt: skip
    if kind in targets:
        path.symlink_to(targets[kind])
    elif kind == "circles":
        path.symlink_to(other)
        other.symlink_to(path)
    elif kind == "folder":
        path.mkdir()
        (path / path.name).write_text("inside")
    elif kind == "file":
        path.write_text("no folder")
    elif kind == "pipe":
        os.mkfifo(path)
    return kind


def odd_name(rng: Rng, path: Path) -> Path:
    """The same file under an odd name; its ending is kept."""
    named = path.with_name(f"{_of(rng, ODD_NAMES)}{path.suffix}")
    path.rename(named)
    return named
