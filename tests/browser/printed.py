"""The words of a PDF as Chromium writes it, page by page."""

import re
import zlib
from collections.abc import Iterator, Mapping

Objects = Mapping[int, bytes]


def pages_of(pdf: bytes) -> list[str]:
    """Text of each page, in the order it is drawn, without blanks: those are not drawn."""
    objects = {int(number): body for number, body in
               re.findall(rb"(?s)(?:^|\n)(\d+) 0 obj\s(.*?)\sendobj", pdf)}  # fmt: skip
    pages = [body for body in objects.values() if re.search(rb"/Type\s*/Page\b", body)]
    return [_text(page, objects) for page in pages]


def _text(page: bytes, objects: Objects) -> str:
    fonts = {name: _signs(objects[int(number)], objects) for name, number in _fonts(page, objects)}
    drawn = _stream(objects[_number(page, rb"Contents")])
    signs: Mapping[int, str] = {}
    said: list[str] = []
    for font, shown in re.findall(rb"/(\w+) [\d.]+ Tf|<([0-9A-Fa-f]+)> Tj", drawn):
        if font:
            signs = fonts.get(font, {})
        said += [signs.get(int(shown[at : at + 4], 16), "") for at in range(0, len(shown), 4)]
    return "".join(said)


def _fonts(page: bytes, objects: Objects) -> Iterator[tuple[bytes, bytes]]:
    found = re.search(rb"/Resources (\d+) 0 R", page)
    resources = objects[int(found[1])] if found else page
    listed = re.search(rb"(?s)/Font\s*<<(.*?)>>", resources)
    return iter(re.findall(rb"/(\w+) (\d+) 0 R", listed[1] if listed else b""))


def _signs(font: bytes, objects: Objects) -> Mapping[int, str]:
    """Sign of each code of a font; none where it says nothing of them."""
    if b"/ToUnicode" not in font:
        return {}
    told = _stream(objects[_number(font, rb"ToUnicode")])
    found: dict[int, str] = {}
    for block in re.findall(rb"(?s)beginbfchar(.*?)endbfchar", told):
        for code, sign in re.findall(rb"<(\w+)> <(\w+)>", block):
            found[int(code, 16)] = bytes.fromhex(sign.decode()).decode("utf-16-be")
    for block in re.findall(rb"(?s)beginbfrange(.*?)endbfrange", told):
        for low, high, sign in re.findall(rb"<(\w+)> <(\w+)> <(\w+)>", block):
            for code in range(int(low, 16), int(high, 16) + 1):
                found[code] = chr(int(sign, 16) + code - int(low, 16))
    return found


def _number(body: bytes, name: bytes) -> int:
    found = re.search(rb"/" + name + rb" (\d+) 0 R", body)
    assert found, name
    return int(found[1])


def _stream(body: bytes) -> bytes:
    data = re.search(rb"(?s)stream\r?\n(.*)\r?\nendstream", body)
    assert data
    return zlib.decompress(data[1]) if b"FlateDecode" in body else data[1]
