"""Image motion: while the shutter is open the aircraft flies on, and a point becomes a line."""

import numpy as np

from app.lessons import sheet
from core.geometry.image_corrections import KM_H, image_motion_mm, photo_scale

PIXEL_UM = 15.0
"""Pixel of the archive's scans."""
GOOD_UM = 50.0
"""What the notes accept of a good photo (section on image motion)."""


def view(state: sheet.State) -> sheet.View:
    """The line a point draws over the pixels of a scan."""
    speed, c, above = state["n"], state["c"], state["H"]
    time = 1 / state["shutter"]
    moved = 1000 * image_motion_mm(speed, time, c, above)
    scale = photo_scale(c, above, 0.0)
    shutters = np.geomspace(25, 1000, 50)
    lengths = [1000 * image_motion_mm(speed, 1 / one, c, above) for one in shutters]
    edge = 6 * PIXEL_UM
    lines = [
        sheet.shape("line", line, "faint")
        for at in np.arange(-edge, edge + 1, PIXEL_UM)
        for line in ([(at, -edge), (at, edge)], [(-edge, at), (edge, at)])
    ]
    film = sheet.Canvas(
        "film",
        (-edge, -edge / 2, edge, edge / 2),
        (
            *lines,
            sheet.shape("line", [(-moved / 2, 0), (moved / 2, 0)], "bad"),
            sheet.shape(
                "arrow",
                [(-moved / 2, -1.6 * PIXEL_UM), (moved / 2, -1.6 * PIXEL_UM)],
                "estimate",
                number=sheet.Number(moved, 1, "µm"),
            ),
            sheet.shape("dots", [(-moved / 2, 0), (moved / 2, 0)], "bad"),
        ),
        "µm",
    )
    figures = {
        "moved": sheet.Number(moved, 1, "µm"),
        "pixels": sheet.Number(moved / PIXEL_UM, 1, "px"),
        "ground": sheet.Number(moved / 1e6 / scale, 2, "m"),
        "scale": sheet.Number(1 / scale, 0),
    }
    good = sheet.curve("good", [25.0, 1000.0], [GOOD_UM, GOOD_UM], "faint")
    plot = sheet.Plot(
        "shutter",
        "moved",
        (sheet.curve("moved", shutters, lengths), good),
        (state["shutter"], moved),
    )
    symbols = {
        "M": figures["moved"],
        "t": sheet.Number(time, 5, "s"),
        "k": sheet.Number(KM_H, 4),
        "H_g": sheet.Number(above, 0, "m"),
    }
    return sheet.View(figures, (film,), symbols, plot)


def ask(rng: np.random.Generator) -> sheet.Asked:
    """The example of the notes with other numbers."""
    speed, shutter = float(rng.integers(15, 41) * 10), float(rng.choice([100, 125, 200, 250, 500]))
    scale = float(rng.choice([5000, 8000, 10000, 15000, 20000]))
    c = 152.0
    moved = 1000 * image_motion_mm(speed, 1 / shutter, c, scale * c / 1000)
    return sheet.Asked({"n": speed, "shutter": shutter, "scale": scale}, moved)


LESSON = sheet.Lesson(
    "motion",
    "b",
    (
        sheet.Slider("n", 100, 700, 180, 5, "km/h", "n"),
        sheet.Slider("shutter", 25, 1000, 200, 5),
        sheet.Slider("c", 85, 310, 152, 1, "mm", "f"),
        sheet.Slider("H", 500, 8000, 1520, 10, "m", "H_g"),
    ),
    view,
    (sheet.Equation("M", sheet.over(sheet.row("k", "*", "n", "*", "t", "*", "f"), "H_g")),),
    (sheet.Question("blur", "µm", 1.5, ask),),
    order=1,
)
