"""Control and its distribution: how far from the nearest point a block is still known."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from app.lessons import sheet
from app.lessons.flight import KEPT, LOOSE, Flight, Plan, fly
from core.adjustment.adjusted import AdjustmentOptions, AdjustmentReport
from core.adjustment.block_adjustment import adjust_block
from core.adjustment.equations import nine_places
from core.adjustment.influence import influence_of
from core.arrays import Matrix
from core.block import Block, ExteriorPrior, footprint
from core.geometry.collinearity import object_from_film
from core.geometry.exterior import ExteriorOrientation

STRIPS, PHOTOS, TIES = 2, 3, 300
EXTENT = Plan(STRIPS, PHOTOS, TIES, 0.5, 1).extent
SHOWN = 90
"""So many of the tie points are drawn."""
TIMES = (300, 200, 100, 50, 20, 10, 5, 2)
"""Standard deviations are drawn so many times their size: the most that leaves them in view."""
WIDEST = 0.12
"""A circle's radius at most, of the block's length."""
CORNER = 0.33
"""Part of length and width that control covers in the question: a ninth of the block."""
LOOSER = 10.0
"""How much weaker the rough orientations are made to see whether anything rests on them."""
RESTS = 1.1
"""By so much standard deviations may grow with that: they do not rest on them."""
HELD = AdjustmentOptions(estimate_cameras=False, robust=False)
DEM_M = 0.4
"""Heights of control come from a surface model that is so good (standard deviation)."""


def places(count: int, centre: tuple[float, float], spread: float) -> Matrix:
    """Control spread evenly over a part of the block, pushed inwards at its edges."""
    golden = 0.5 + 0.5 * np.sqrt(5)
    steps = np.arange(count)
    unit = np.column_stack([(steps + 0.5) / count, (steps / golden) % 1.0])
    size = np.array(EXTENT) * spread
    middle = np.clip(centre, size / 2, np.array(EXTENT) - size / 2)
    return middle + (unit - 0.5) * size * 0.94


@dataclass(frozen=True, slots=True, eq=False)
class AdjustedFlight:
    """A flight with some control, adjusted."""

    flight: Flight
    """As it was flown."""
    report: AdjustmentReport
    """Its adjustment."""
    sigmas: Matrix
    """Standard deviations (E, N) of the ground at nine places of each photo, metres."""
    errors: Matrix
    """True errors there."""
    is_held: bool
    """Whether control and ties hold it, without the rough orientations."""


@lru_cache(maxsize=KEPT)
def adjusted(
    noise_px: float, seed: int, count: int, where: tuple[float, float, float], sigma_m: float
) -> AdjustedFlight:
    """The block of a state, adjusted; `where` is the middle of the control and its spread."""
    plan = Plan(STRIPS, PHOTOS, TIES, noise_px, seed)
    flown = fly(plan, places(count, where[:2], where[2]), sigma_m, DEM_M)
    flight = replace(flown, block=roughly_known(flown.block, seed))
    report = adjust_block(flight.block, HELD)
    cofactors = ground_cofactors(report)
    looser = ExteriorPrior(LOOSER * LOOSE.sigma_centre_m, LOOSER * LOOSE.sigma_angles)
    photos = {name: replace(one, prior=looser) for name, one in report.block.photos.items()}
    freed = ground_cofactors(replace(report, block=report.block.with_photos(photos)))
    return AdjustedFlight(
        flight,
        report,
        report.sigma_nought * cofactors,
        ground_errors(flight, report),
        is_held=rms(freed) < RESTS * rms(cofactors),
    )


def roughly_known(block: Block, seed: int) -> Block:
    """The block with rough orientations that are as wrong as is said of them."""
    rng, photos = np.random.default_rng(3000 + seed), dict(block.photos)
    for name, photo in photos.items():
        true = photo.exterior
        omega, phi, kappa = rng.normal(0, LOOSE.sigma_angles)
        rough = ExteriorOrientation(
            true.centre + rng.normal(0, LOOSE.sigma_centre_m),
            true.omega + omega,
            true.phi + phi,
            true.kappa + kappa,
        )
        photos[name] = replace(photo, approximate=rough)
    return block.with_photos(photos)


def ground_cofactors(report: AdjustmentReport) -> Matrix:
    """Standard deviations (E, N) of the ground for a sigma nought of one, as `sigmas`."""
    influence = influence_of(report, HELD)
    assert influence is not None, "a block with control has photos"
    return np.concatenate(list(influence.corner_sigmas().values()))


def ground_errors(flight: Flight, report: AdjustmentReport) -> Matrix:
    """Where the adjusted photos show the ground, from where they truly do (E, N), metres."""
    errors: list[Matrix] = []
    for name, true in flight.photos.items():
        camera = flight.block.cameras[true.camera]
        film, heights = nine_places(camera.frame_mm), np.full(9, true.ground_height_m)
        found = report.block.photos[name]
        there, here = (
            object_from_film(film, heights, photo.exterior, camera) for photo in (true, found)
        )
        errors.append((here - there)[:, :2])
    return np.concatenate(errors)


def rms(values: Matrix) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.nanmean(values**2)))


def view(state: sheet.State) -> sheet.View:
    """Tie points with the standard deviations of their places, and control."""
    where = (state["x"], state["y"], state["spread"] / 100)
    found = adjusted(
        max(state["ties"], 0.05), int(state["seed"]), int(state["count"]), where, state["sigma"]
    )
    flight, report = found.flight, found.report
    sigmas = report.tie_sigmas_m
    plan = np.hypot(sigmas[:, 0], sigmas[:, 1])
    known = np.isfinite(plan)
    off = np.hypot(*(report.tie_positions - flight.ties)[:, :2].T)
    worst = float(found.sigmas.max())
    figures = {
        "rms": sheet.Number(rms(found.sigmas), 2, "m"),
        "worst": sheet.Number(worst, 2, "m"),
        "error": sheet.Number(rms(found.errors), 2, "m", secret=True),
        "ties": sheet.Number(rms(sigmas[:, :2]), 2, "m"),
        "height": sheet.Number(rms(sigmas[:, 2]), 2, "m"),
        "sigma_nought": sheet.Number(report.sigma_nought, 2),
    }
    middle = places(int(state["count"]), where[:2], where[2])
    away = np.array([np.min(np.hypot(*(middle - tie[:2]).T)) for tie in flight.ties[known]])
    order = np.argsort(away)
    parts = np.array_split(order, 9)
    curve = sheet.curve(
        "sigma", [away[p].mean() for p in parts], [plan[known][p].mean() for p in parts]
    )
    plot = sheet.Plot("away", "sigma", (curve,))
    cofactor = (worst / report.sigma_nought) ** 2
    symbols = {
        "σ_0": figures["sigma_nought"],
        "q_X": sheet.Number(cofactor, 3 if cofactor < 10 else 1, "m²"),
        "σ_X": figures["worst"],
    }
    widest = float(np.nanmax([plan[:SHOWN], off[:SHOWN]])) / np.sqrt(2)
    times = next((one for one in TIMES if one * widest < WIDEST * EXTENT[0]), 1)
    figures["times"] = sheet.Number(times, 0)
    canvas = drawing(flight, middle, (plan, off), where, times)
    warning = "" if found.is_held else "rough"
    return sheet.View(figures, (canvas,), symbols, plot, warning=warning)


def drawing(
    flight: Flight,
    control: Matrix,
    ties: tuple[np.ndarray, np.ndarray],
    where: tuple[float, float, float],
    times: float,
) -> sheet.Canvas:
    """The block in plan; of ties standard deviation and true error, so many times their size."""
    plan, off = ties
    frames = [
        np.array(footprint(photo, flight.block.cameras["lesson"]).exterior.coords)
        for photo in flight.photos.values()
    ]
    rings = [
        part
        for tie, sigma, error in zip(
            flight.ties[:SHOWN, :2], plan[:SHOWN], off[:SHOWN], strict=True
        )
        if np.isfinite(sigma)
        for part in (
            sheet.shape("line", sheet.ellipse(tie, np.eye(2) * sigma**2 / 2, times), "error"),
            sheet.shape("line", [tie, (tie[0], tie[1] + times * error / np.sqrt(2))], "truth"),
        )
    ]
    east, north = CORNER * EXTENT[0], CORNER * EXTENT[1]
    shapes = (
        sheet.shape("line", [(0, north), (east, north), (east, 0)], "axis"),
        sheet.shape("text", [(east / 2, north)], "axis", "corner"),
        *(sheet.shape("line", frame, "faint") for frame in frames),
        *rings,
        sheet.shape("crosses", control, "estimate"),
        sheet.shape("dots", [where[:2]], "ray", "control", handle=("x", "y")),
    )
    length, width = EXTENT
    room = WIDEST * length
    return sheet.Canvas("plan", (-room, -room, length + room, width + room), shapes)


def ask(rng: np.random.Generator) -> sheet.Asked:
    """How much worse one ninth of the block is than all of it."""
    middle = (EXTENT[0] / 2, EXTENT[1] / 2)
    count, flight = int(rng.integers(12, 31)), int(rng.integers(1, 100))
    spread, ninth = (
        rms(adjusted(0.5, flight, count, where, 1.0).sigmas)
        for where in ((*middle, 1.0), (0.0, 0.0, CORNER))
    )
    return sheet.Asked({"sigma": 1, "n": count, "flight": flight}, ninth / spread)


LESSON = sheet.Lesson(
    "control",
    "k",
    (
        sheet.Slider("spread", 15, 100, 100, 1, "%"),
        sheet.Slider("x", 0, round(EXTENT[0]), round(EXTENT[0] / 2), 1, "m", moved_in="plan"),
        sheet.Slider("y", 0, round(EXTENT[1]), round(EXTENT[1] / 2), 1, "m", moved_in="plan"),
        sheet.Slider("count", 4, 60, 20, 1),
        sheet.Slider("sigma", 0.1, 3, 1, 0.1, "m"),
        sheet.Slider("ties", 0.1, 2, 0.5, 0.1, "px"),
        sheet.SEED,
    ),
    view,
    (
        sheet.Equation(
            "Q",
            sheet.power(["fence", sheet.row(sheet.power("A", "T"), "*", "P", "*", "A")], "−1"),
        ),
        sheet.Equation("q_X", sheet.row(sheet.power("f", "T"), "*", "Q", "*", "f")),
        sheet.Equation("σ_X", sheet.row("σ_0", "*", sheet.root("q_X"))),
    ),
    (sheet.Question("ninth", "", 1.0, ask),),
    hides_truth=True,
)
