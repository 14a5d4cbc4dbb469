"""The page of conventions: how every format counts, one table a format, made from the code.

`python -m tests.conventions` writes docs/formats/conventions.md; tests/test_conventions.py fails
where page and code differ.
"""

from dataclasses import fields
from pathlib import Path

from core.formats.exchange import Conventions, ExchangeFormat
from core.formats.exchange_formats import FORMATS

PAGE = Path(__file__).resolve().parents[1] / "docs" / "formats" / "conventions.md"
ROWS = {
    "pixels": "pixels",
    "object_space": "object space",
    "rotation": "rotation",
    "camera": "camera",
    "sigmas": "standard deviations",
    "lost": "not held",
    "tested": "tested on",
}
"""Head of each row, by the field it shows."""
HOLDS = {
    "film": "any affine transform of a scan",
    "frame": "principal distance, principal point, affinity and skew in pixels",
    "upright": "square pixels that are not turned",
    "nothing": "nothing",
}
"""Each kind of interior orientation in words."""
HEAD = """# Conventions of the exchange formats

Written by `python -m tests.conventions` from what the code says of itself.

Our own: pixels count column right and row down from the outer corner of the first pixel; object
space is easting, northing, height in metres; R = R_x(omega) R_y(phi) R_z(kappa) turns image space
(x right, y up, z backwards) into object space. "Tested on" names the program whose files were read.
"""


def page() -> str:
    """The whole page."""
    return HEAD + "".join(_section(FORMATS[name]) for name in sorted(FORMATS))


def _section(one: ExchangeFormat) -> str:
    assert {field.name for field in fields(Conventions)} == set(ROWS)
    ways = [word for word, way in (("written", one.write), ("read", one.read)) if way is not None]
    rows = {
        "ways": " and ".join(ways) + (", as a folder" if one.folder else ", as one file"),
        "exported to": f"`results/export/{one.default_name}`" if one.write else "nowhere",
        "interior orientation": HOLDS[one.holds],
        "Earth's curvature": "left to the reader" if one.curved else "taken out of measurements",
        **{head: getattr(one.conventions, field) for field, head in ROWS.items()},
    }
    lines = [f"| {head} | {text.replace('|', chr(92) + '|')} |" for head, text in rows.items()]
    return "\n".join(["", f"## {one.title} (`{one.name}`)", "", "| | |", "|---|---|", *lines, ""])


if __name__ == "__main__":
    PAGE.parent.mkdir(parents=True, exist_ok=True)
    PAGE.write_text(page(), encoding="utf-8")
