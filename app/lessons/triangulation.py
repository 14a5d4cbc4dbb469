"""Triangulation: one flight by four methods, and what is left of each as control is taken away."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from app.lessons import sheet, space
from app.lessons.flight import ABOVE_M, C_MM, KEPT, LOOSE, Flight, Plan, fly, on_hills
from app.lessons.photo import PIXEL_MM
from core.adjustment.accuracy import intersect_checks
from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block
from core.arrays import Matrix
from core.block import Block, ExteriorPrior, Measurement, Photo, SurveyedPoint, footprint
from core.doubts import Failure
from core.literature.independent_models import (
    Sights,
    StereoModel,
    form_models,
    triangulate_models,
)
from core.literature.methods import triangulate_strips
from core.literature.radial import RadialPoint, direction_error, triangulate_radially

STRIPS, PHOTOS, TIES = 2, 3, 140
EXTENT = np.array(Plan(STRIPS, PHOTOS, TIES, 0.5, 1).extent)
CONTROL = EXTENT * np.array(
    [[0.26, 0.05], [0.74, 0.95], [0.74, 0.05], [0.26, 0.95], [0.5, 0.05], [0.5, 0.95],
     [0.5, 0.52], [0.26, 0.48], [0.74, 0.5], [0.38, 0.95], [0.62, 0.05], [0.4, 0.2]]
)  # fmt: skip
"""Known points in two photos or more, corners first: the last ones are taken away first."""
GNSS_M = 0.1
"""Standard deviation of centres from GNSS, metres."""
HELD = AdjustmentOptions(estimate_cameras=False, robust=False)
TAKE_CENTRES = (3, 4)
"""Methods by their number into which measured perspective centres enter."""
RADIAL: tuple[RadialPoint, ...] = ("principal", "isocentre", "nadir")
RADIUS_MM = 80.0
"""The formula's example: a point so far from the principal point, across the tilt."""


@dataclass(frozen=True, slots=True)
class Layout:
    """What decides the observations."""

    noise_um: float
    """Of an image coordinate."""
    seed: int
    """Of all that is drawn."""
    relief_m: float
    """Hills rise and fall by so much."""
    tilt_deg: float
    """Standard deviation of the tilts."""
    control_m: float
    """Standard deviation of a known point."""


@lru_cache(maxsize=KEPT)
def observed(layout: Layout) -> Flight:
    """The flight with all its control."""
    plan = Plan(
        STRIPS, PHOTOS, TIES, layout.noise_um / 1000 / PIXEL_MM, layout.seed, layout.relief_m,
        float(np.radians(layout.tilt_deg)),
    )  # fmt: skip
    return fly(plan, CONTROL, layout.control_m)


@lru_cache(maxsize=KEPT)
def models_of(layout: Layout) -> tuple[StereoModel, ...]:
    """Its models; what is known of their points comes later."""
    return form_models(observed(layout).block, np.random.default_rng(layout.seed))


def with_control(block: Block, count: int, gnss: bool, seed: int) -> Block:
    """The block with so many of its known points, and centres as GNSS or nobody knows them."""
    kept = {name: point for name, point in block.surveyed.items() if int(name) < count}
    measured = {key: one for key, one in block.measurements.items() if key[0] in kept}
    rng, sigma = np.random.default_rng(2000 + seed), np.full(3, GNSS_M)
    told: dict[str, Photo] = {}
    for name, photo in block.photos.items():
        prior = ExteriorPrior(sigma, LOOSE.sigma_angles) if gnss else LOOSE
        off = rng.normal(0, prior.sigma_centre_m)
        start = replace(photo.exterior, centre=photo.exterior.centre + off)
        told[name] = replace(photo, prior=prior, approximate=start)
    return replace(block, surveyed=kept, measurements=measured).with_photos(told)


@lru_cache(maxsize=KEPT)
def errors_of(
    layout: Layout, count: int, method: int, about: int, *, gnss: bool
) -> tuple[Flight, Matrix | None]:
    """Estimated minus true places of the ties (E, N, height), NaN where a method has none.

    None where the method cannot be done with so little control.
    """
    flight = observed(layout)
    block = with_control(flight.block, count, gnss, layout.seed)
    off = np.full((len(flight.ties), 3), np.nan)
    if method == 1:
        found = triangulate_radially(block, RADIAL[about - 1])
        if isinstance(found, Failure):
            return flight, None
        off[found.numbers, :2] = found.places - flight.ties[found.numbers, :2]
        return flight, off
    if method == 4:
        return flight, adjust_block(block, HELD).tie_positions - flight.ties
    sights = Sights.of(flight.block)
    fewer = {number: name for number, name in sights.control.items() if name in block.surveyed}
    triangulate = triangulate_strips if method == 2 else triangulate_models
    done = triangulate(block, models_of(layout), replace(sights, control=fewer))
    if isinstance(done, Failure):
        return flight, None
    for check in intersect_checks(ties_as_checks(done.block, flight)):
        if check.used_scans > 1:
            off[int(check.point_id)] = check.difference_m
    return flight, off if np.isfinite(off).any() else None


def ties_as_checks(block: Block, flight: Flight) -> Block:
    """The block with its ties as points whose truth is known."""
    ties = block.ties
    points = {
        f"{i}": SurveyedPoint(f"{i}", place, np.full(3, 0.001), "check", "surveyed")
        for i, place in enumerate(flight.ties)
    }
    rays = zip(ties.point.tolist(), ties.photo.tolist(), ties.pixels.tolist(), strict=True)
    measured = [
        Measurement(f"{point}", ties.photo_ids[photo], column, row, 1.0)
        for point, photo, (column, row) in rays
    ]
    oriented = {name: replace(photo, oriented=True) for name, photo in block.photos.items()}
    return replace(
        block, photos=oriented, surveyed=points, measurements={one.key: one for one in measured}
    )


def view(state: sheet.State) -> sheet.View:
    """Errors of the ties over the block, and along the strips."""
    layout = Layout(
        state["noise"], int(state["seed"]), state["relief"], state["tilt"], state["known"]
    )
    count = int(state["control"])
    flight, off = errors_of(
        layout, count, int(state["method"]), int(state["about"]), gnss=bool(state["gnss"])
    )
    frames = [
        np.array(footprint(photo, flight.block.cameras["lesson"]).exterior.coords)
        for photo in flight.photos.values()
    ]
    shapes = [sheet.shape("line", frame, "faint") for frame in frames]
    shapes += [
        sheet.shape("dots", flight.ties[:, :2], "faint"),
        sheet.shape("crosses", CONTROL[:count], "given"),
    ]
    if state["gnss"] and int(state["method"]) in TAKE_CENTRES:
        centres = [photo.exterior.centre[:2] for photo in flight.photos.values()]
        shapes.append(sheet.shape("dots", centres, "given"))
    tilt = float(np.tan(np.radians(state["tilt"])))
    turned = direction_error(
        np.array([state["relief"]]), ABOVE_M, np.array([C_MM * tilt, 0.0]),
        np.array([[0.0, RADIUS_MM]]),
    )  # fmt: skip
    delta = sheet.Number(60 * float(np.degrees(turned[0])), 2, "′")
    symbols = {
        "δ": delta,
        "H": sheet.Number(ABOVE_M, 0, "m"),
        "c": sheet.Number(C_MM, 0, "mm"),
        "r": sheet.Number(RADIUS_MM, 0, "mm"),
    }
    figures = {"delta": delta}
    plot = None
    if off is None:
        middle = (EXTENT / 2).tolist()
        label = "strips_need" if state["method"] == 2 else "impossible"
        shapes.append(sheet.shape("text", [middle], "bad", label))
    else:
        figures |= figures_of(off)
        shapes += arrows(flight, off, state["times"])
        plot = along(flight, off)
    length, width = EXTENT.tolist()
    room = 0.06 * length
    canvas = sheet.Canvas("plan", (-room, -room, length + room, width + room), tuple(shapes))
    idle, warning = limits_of(state)
    return sheet.View(
        figures, (canvas, scene(flight, off, state)), symbols, plot, idle=idle, warning=warning
    )


def limits_of(state: sheet.State) -> tuple[dict[str, str], str]:
    """Sliders that a method does not know, and what it leaves open."""
    method, idle = int(state["method"]), dict[str, str]()
    if method != 1:
        idle["about"] = "radial_only"
    if method not in TAKE_CENTRES:
        return idle | {"gnss": "directions" if method == 1 else "joined"}, ""
    # A body hangs on three points; about the line of two it turns.
    turns = state["control"] < 3 and not state["gnss"]
    return idle, "turns" if turns else ""


def scene(flight: Flight, off: Matrix | None, state: sheet.State) -> sheet.Canvas:
    """The photos over their hills, with the errors of the ties in space."""
    relief = state["relief"]
    length, width = EXTENT.tolist()
    shapes = [
        *space.ground(0.0, 0.0, length, width, lambda plan: on_hills(plan, relief)[:, 2]),
        *(
            shape
            for photo in flight.photos.values()
            for shape in space.photo(photo.exterior, C_MM, 0.15 * ABOVE_M / C_MM * 1000)
        ),
        sheet.shape("crosses", on_hills(CONTROL[: int(state["control"])], relief), "given"),
    ]
    if off is not None:
        shown = state["times"] * np.nan_to_num(off)
        shapes += [
            sheet.shape("arrow", [place, place + error], "bad")
            for place, error in zip(flight.ties, shown, strict=True)
            if error.any()
        ]
    box = (0.0, 0.0, 300 - relief, length, width, 300 + ABOVE_M)
    return sheet.Canvas("scene", box, tuple(shapes))


def figures_of(off: Matrix) -> dict[str, sheet.Number]:
    """RMS errors; a method without heights has none."""
    known = np.isfinite(off[:, 0])
    plan = np.sqrt(np.mean(np.sum(off[known, :2] ** 2, axis=1)))
    figures = {
        "plan": sheet.Number(float(plan), 3, "m"),
        "worst": sheet.Number(float(np.hypot(*off[known, :2].T).max()), 3, "m"),
        "points": sheet.Number(float(known.sum()), 0),
    }
    if np.isfinite(off[:, 2]).any():
        height = np.sqrt(np.nanmean(off[:, 2] ** 2))
        figures["height"] = sheet.Number(float(height), 3, "m")
    return figures


def arrows(flight: Flight, off: Matrix, times: float) -> list[sheet.Shape]:
    """Errors in plan, magnified."""
    return [
        sheet.shape("arrow", [place[:2], place[:2] + times * error[:2]], "bad")
        for place, error in zip(flight.ties, off, strict=True)
        if np.isfinite(error[0])
    ]


def along(flight: Flight, off: Matrix) -> sheet.Plot:
    """RMS error in plan and height along the strips."""
    known = np.flatnonzero(np.isfinite(off[:, 0]))
    parts = np.array_split(known[np.argsort(flight.ties[known, 0])], 9)
    east = [flight.ties[part, 0].mean() / 1000 for part in parts]
    plan = [np.sqrt(np.mean(np.sum(off[part, :2] ** 2, axis=1))) for part in parts]
    height = [np.sqrt(np.mean(off[part, 2] ** 2)) for part in parts]
    curves = sheet.curve("plan", east, plan), sheet.curve("height", east, height, "second")
    return sheet.Plot("east", "error", tuple(one for one in curves if one.points))


def ask(rng: np.random.Generator) -> sheet.Asked:
    """How much relief turns a direction about the principal point of a tilted photo."""
    h, tilt, r = (float(rng.integers(*limits)) for limits in ((5, 41), (1, 5), (4, 11)))
    h, r = 10 * h, 10 * r
    nadir = np.array([C_MM * np.tan(np.radians(tilt)), 0.0])
    turned = direction_error(np.array([h]), ABOVE_M, nadir, np.array([[0.0, r]]))
    values = {"h": h, "H": ABOVE_M, "t": tilt, "c": C_MM, "r": r}
    return sheet.Asked(values, 60 * float(np.degrees(turned[0])))


LESSON = sheet.Lesson(
    "triangulation",
    "g",
    (
        sheet.Slider("method", 1, 4, 1, 1),
        sheet.Slider("control", 2, len(CONTROL), len(CONTROL), 1),
        sheet.Slider("about", 1, 3, 1, 1),
        sheet.Slider("gnss", 0, 1, 0, 1),
        sheet.Slider("relief", 0, 300, 40, 10, "m", "h"),
        sheet.Slider("tilt", 0, 3, 1, 0.1, "°", "t"),
        sheet.Slider("times", 10, 3000, 100, 10),
        sheet.Slider("known", 0, 0.5, 0.05, 0.01, "m"),
        replace(sheet.NOISE, start=8),
        sheet.SEED,
    ),
    view,
    (
        sheet.Equation(
            "δ",
            sheet.row(sheet.over("h", "H"), "*", sheet.over(sheet.row("c", "*", "tan", "t"), "r")),
        ),
    ),
    (sheet.Question("turn", "′", 0.5, ask),),
)
