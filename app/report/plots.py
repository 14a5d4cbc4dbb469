"""Plots of residuals as SVG, from the report's figures alone."""

from collections.abc import Mapping
from math import erf, hypot, sqrt
from typing import Any

from markupsafe import Markup

from app.report.drawing import chart, tag
from ui.words.catalogue import Teller

Figures = dict[str, Any]
WIDE, TALL, EDGE = 380.0, 150.0, 26.0
"""Plot area of a histogram and the room below it, pixels."""
FILM = 118.0
"""Side of the film in a plot of one photo, pixels."""
LONGEST = 0.45
"""The longest arrow of all photos, as a share of a cell's side times two."""


def draw_histogram(figures: Figures, tell: Teller) -> Markup:
    """Residuals by size, and the normal curve of the same RMS."""
    counts, reach = figures["counts"], figures["reach_px"]
    expected = [_expected(figures, number) for number in range(len(counts))]
    most = max(*counts, *expected, 1)
    step = WIDE / len(counts)
    parts = [
        tag(
            "rect", x=EDGE + number * step + 0.5, y=10 + TALL * (1 - count / most),
            width=step - 1, height=max(TALL * count / most, 0.0), class_="bar",
        )
        for number, count in enumerate(counts)
    ]  # fmt: skip
    curve = " ".join(
        f"{EDGE + (number + 0.5) * step:.1f},{10 + TALL * (1 - value / most):.1f}"
        for number, value in enumerate(expected)
    )
    parts += [
        tag("polyline", points=curve, class_="curve"),
        tag("line", x1=EDGE, y1=10 + TALL, x2=EDGE + WIDE, y2=10 + TALL, class_="axis"),
        *(
            tag("text", tell.number(share * reach, "+.2g"), class_="barname",
                x=EDGE + WIDE * (1 + share) / 2, y=10 + TALL + 17)
            for share in (-1.0, -0.5, 0.5, 1.0)
        ),
        tag("text", "0 px", x=EDGE + WIDE / 2, y=10 + TALL + 17, class_="barname"),
    ]  # fmt: skip
    return chart(parts, WIDE + 2 * EDGE, TALL + 34)


def _expected(figures: Figures, number: int) -> float:
    """Residuals that a normal distribution of this RMS has in a bar; tails in the outermost."""
    bars, reach, rms = len(figures["counts"]), figures["reach_px"], figures["rms_px"]
    if not rms:
        return 0.0
    low, high = (reach * (2 * (number + side) / bars - 1) / rms / sqrt(2) for side in (0, 1))
    below = -1.0 if number == 0 else erf(low)
    above = 1.0 if number == bars - 1 else erf(high)
    return figures["count"] * (above - below) / 2


def draw_trend(figures: Figures, unit: str, tell: Teller) -> Markup:
    """Mean radial residuals with twice their standard deviation to either side."""
    along, means, sigmas = figures["along"], figures["mean_px"], figures["sigma_px"]
    reach = max(abs(m) + 2 * s for m, s in zip(means, sigmas, strict=True)) or 1.0
    low, span = along[0], along[-1] - along[0] or 1.0

    def place(at: float, value: float) -> tuple[float, float]:
        return EDGE + WIDE * (at - low) / span, 10 + TALL * (1 - value / reach) / 2

    parts = [
        tag("line", x1=EDGE, y1=10 + TALL / 2, x2=EDGE + WIDE, y2=10 + TALL / 2, class_="axis")
    ]
    for at, mean, sigma in zip(along, means, sigmas, strict=True):
        (x, top), (_, foot) = place(at, mean + 2 * sigma), place(at, mean - 2 * sigma)
        parts.append(tag("line", x1=x, y1=top, x2=x, y2=foot, class_="vector controlline"))
        parts.append(tag("circle", cx=x, cy=place(at, mean)[1], r=2.5, class_="filmdot"))
    for at in (along[0], along[-1]):
        text = f"{tell.number(at, '.0f')} {unit}"
        parts.append(tag("text", text, x=place(at, 0)[0], y=10 + TALL + 17, class_="barname"))
    for share in (1, -1):
        text = f"{tell.number(share * reach, '+.2g')} px"
        y = place(low, share * reach)[1] + 4
        parts.append(tag("text", text, x=EDGE + WIDE / 2, y=y, class_="barname"))
    return chart(parts, WIDE + 2 * EDGE, TALL + 34)


def longest_mean(films: Mapping[str, Figures]) -> float:
    """The longest mean residual of all photos, pixels: one scale for all plots."""
    lengths = [
        hypot(*cell)
        for film in films.values()
        for line in film["mean_px"]
        for cell in line
        if None not in cell
    ]
    return max(lengths, default=0.0)


def draw_film(film: Figures, longest_px: float) -> Markup:
    """Mean residuals of one photo as arrows over its film."""
    lines = film["mean_px"]
    cell = FILM / len(lines)
    scale = 2 * LONGEST * cell / max(longest_px, 1e-9)
    parts = [tag("rect", x=0.5, y=0.5, width=FILM, height=FILM, class_="film")]
    for row, line in enumerate(lines):
        for column, (across, down) in enumerate(line):
            if across is None or down is None:
                continue
            x, y = (column + 0.5) * cell, (row + 0.5) * cell
            end = {"x2": x + across * scale, "y2": y + down * scale}
            parts.append(tag("line", x1=x, y1=y, **end, class_="vector controlline"))
            parts.append(tag("circle", cx=x, cy=y, r=1.3, class_="filmdot"))
    return chart(parts, FILM + 1, FILM + 1)
