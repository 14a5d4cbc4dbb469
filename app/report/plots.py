"""Plots of the accuracy report, drawn by Matplotlib in the page's type and colours.

It is imported with the first plot, so that no other start of the program waits for it.
"""

import hashlib
import io
import logging
import re
from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from math import hypot
from statistics import NormalDist
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from ui.words.catalogue import Teller

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Figures = dict[str, Any]
PALETTE: Mapping[str, str] = {
    "ink": "#14212b", "soft": "#5b6b78", "line": "#d5dde3", "wash": "#f4f7f9",
    "accent": "#0b5a7d", "control": "#16794f", "check": "#6d3bb0", "bad": "#b3261e",
    "tie": "#9db0bd",
}  # fmt: skip
"""Colours of the page, of its plots and of its maps."""
STYLE: dict[Any, Any] = {
    "svg.fonttype": "none", "svg.hashsalt": "plot", "font.size": 9.0,
    "text.color": PALETTE["ink"], "axes.labelcolor": PALETTE["soft"],
    "axes.edgecolor": PALETTE["soft"], "xtick.color": PALETTE["soft"],
    "ytick.color": PALETTE["soft"], "axes.spines.top": False, "axes.spines.right": False,
    "lines.linewidth": 1.4,
}  # fmt: skip
"""Words stay words, which the page sets in its own type."""
UNSAID = dict.fromkeys(("Date", "Creator", "Format", "Type"))
"""What Matplotlib would write about the file: the same figures give the same page."""
WIDE, SQUARE, FILM = (4.4, 2.1), (3.2, 3.0), (1.25, 1.25)
"""Width and height of a plot, inches; one has 96 CSS pixels."""
LONGEST = 0.9
"""The longest arrow of all photos, as a share of a cell's side."""
BAR = 0.92
"""Width of a bar, as a share of its step."""
CURVE_POINTS = 201
"""Points of a curve that looks smooth."""
LARGEST_DOT, SMALLEST_DOT = 250.0, 12.0
"""Areas of dots, square points."""
# A home that may not be written costs Matplotlib its list of fonts, and the reader nothing.
logging.getLogger("matplotlib").setLevel(logging.ERROR)


def draw_bars(counts: Mapping[str, int], tell: Teller) -> Markup:
    """A bar for every number of rays."""
    if not counts:
        return Markup("")
    rays = [int(key) for key in counts]
    with _plot(WIDE, tell) as (axes, drawn):
        bars = axes.bar(rays, list(counts.values()), color=PALETTE["accent"], width=BAR)
        axes.bar_label(bars, [tell.number(count, ",") for count in counts.values()])
        axes.set(xlabel=tell("report.rays"), xticks=rays)
        axes.yaxis.set_visible(False)
        axes.spines["left"].set_visible(False)
    return drawn[0]


def draw_reliability(bins: Sequence[Figures], tell: Teller) -> Markup:
    """Probability as stated (across) and as borne out (up); a dot's area is its proposals."""
    if not bins:
        return Markup("")
    most = max(one["proposals"] for one in bins)
    with _plot(SQUARE, tell) as (axes, drawn):
        axes.plot((0, 1), (0, 1), color=PALETTE["soft"], linewidth=1.0)
        axes.scatter(
            [one["stated"] for one in bins],
            [one["borne_out"] for one in bins],
            [SMALLEST_DOT + LARGEST_DOT * one["proposals"] / most for one in bins],
            color=PALETTE["accent"], clip_on=False, zorder=3,
        )  # fmt: skip
        axes.set(xlim=(0, 1), ylim=(0, 1), xlabel=tell("report.reliability.stated"))
        axes.set_ylabel(tell("report.reliability.seen"))
        axes.set_aspect("equal")
    return drawn[0]


def draw_histogram(figures: Figures, tell: Teller, unit: str = "px") -> Markup:
    """Residuals by size, and the normal curve of the same RMS."""
    counts, rms, reach = figures["counts"], figures[f"rms_{unit}"], figures[f"reach_{unit}"]
    edges, along = (np.linspace(-reach, reach, n) for n in (len(counts) + 1, CURVE_POINTS))
    step = edges[1] - edges[0]
    with _plot(WIDE, tell) as (axes, drawn):
        axes.bar(edges[:-1] + step / 2, counts, width=BAR * step, color=PALETTE["accent"])
        if rms:
            normal = NormalDist(sigma=rms)
            expected = [figures["count"] * step * normal.pdf(size) for size in along]
            axes.plot(along, expected, color=PALETTE["bad"])
        axes.set(xlim=(-reach, reach), xlabel=unit)
    return drawn[0]


def draw_trend(figures: Figures, unit: str, tell: Teller) -> Markup:
    """Mean radial residuals with twice their standard deviation to either side."""
    sigmas = np.array(figures["sigma_px"])
    with _plot(WIDE, tell) as (axes, drawn):
        axes.axhline(0, color=PALETTE["soft"], linewidth=1.0)
        axes.errorbar(
            figures["along"], figures["mean_px"], 2 * sigmas,
            fmt="o", markersize=4, color=PALETTE["control"],
        )  # fmt: skip
        axes.set(xlabel=unit, ylabel="px")
    return drawn[0]


def longest_mean(films: Mapping[str, Figures]) -> float:
    """The longest mean residual of all photos, micrometres: one scale for all plots."""
    lengths = [
        hypot(*cell)
        for film in films.values()
        for line in film["mean_um"]
        for cell in line
        if None not in cell
    ]
    return max(lengths, default=0.0)


def draw_film(film: Figures, longest_um: float, tell: Teller) -> Markup:
    """Mean residuals of one photo as arrows over its film."""
    means = np.array(film["mean_um"], dtype=float)
    rows, columns, _ = means.shape
    with _plot(FILM, tell) as (axes, drawn):
        axes.quiver(
            np.arange(columns), np.arange(rows), means[..., 0], -means[..., 1],
            angles="xy", scale_units="xy", scale=max(longest_um, 1e-9) / LONGEST,
            color=PALETTE["control"], width=0.014, pivot="mid",
        )  # fmt: skip
        axes.set(xlim=(-0.5, columns - 0.5), ylim=(rows - 0.5, -0.5), xticks=(), yticks=())
        axes.spines[:].set_visible(True)
    return drawn[0]


@contextmanager
def _plot(inches: tuple[float, float], tell: Teller) -> Generator[tuple["Axes", list[Markup]]]:
    """Axes to plot on, and where the finished plot lies afterwards."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    drawn: list[Markup] = []
    with rc_context(STYLE):
        figure = Figure(figsize=inches, layout="constrained")
        axes = figure.add_subplot()
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_formatter(lambda value, _: tell.number(round(value, 9), "g"))
        yield axes, drawn
        stream = io.StringIO()
        figure.savefig(stream, format="svg", transparent=True, metadata=UNSAID)
    drawn.append(_inline(stream.getvalue()))


def _inline(svg: str) -> Markup:
    """A file as a part of a page: in the page's type, and with ids that no other plot has."""
    body = svg[svg.index("<svg") :]
    body = re.sub(r"<style.*?</style>|font-family: [^;]*;|(?<=<g) id=\"[^\"]*\"", "", body)
    own = hashlib.sha256(body.encode()).hexdigest()[:8]
    body = re.sub(r'(\bid="|url\(#|href="#)', rf"\g<1>{own}", body)
    return Markup(body.replace("<svg", '<svg class="plot" aria-hidden="true"', 1))
