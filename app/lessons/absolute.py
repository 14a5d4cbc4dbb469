"""Absolute orientation: a model is turned, scaled and laid on known points."""

import numpy as np

from app.lessons import sheet, space
from app.lessons.flight import SCALE, on_hills
from core.geometry import exterior

NAMES = ("scale", "omega", "phi", "kappa")
PLAN = np.array([[0, 0], [9, 17], [9, 0], [0, 17], [4.5, 8.5], [0, 8.5], [9, 8.5], [4, 16]]) * 100
"""Known points, metres, corners first."""
GROUND = on_hills(PLAN.astype(float), 60.0)
MIDDLE = GROUND.mean(axis=0)


def body(scale: float, omega: float, phi: float, kappa: float) -> exterior.Similarity:
    """A model's change of scale (percent) and turns (degrees), about the middle of the points."""
    turn = exterior.rotation_from_angles(*np.radians([omega, phi, kappa]).tolist())
    return exterior.Similarity(1 + scale / 100, turn, np.zeros(3))


def view(state: sheet.State) -> sheet.View:
    """The model above its known points, and what is left between them."""
    rng, count = np.random.default_rng(int(state["seed"])), int(state["n"])
    truth = np.round(rng.uniform([-4, -3, -3, -6], [4, 3, 3, 6]), 2)
    hidden = body(*truth.tolist())
    off = rng.normal(0, 1, GROUND.shape) * state["noise"] / 1e6 * SCALE
    model = (GROUND - MIDDLE + off) @ hidden.rotation / hidden.scale
    target, counts = GROUND - MIDDLE, range(3, len(GROUND) + 1)
    fits = [exterior.fit_similarity(model[:n], target[:n], np.ones(n)) for n in counts]
    shown = fits[count - 3] if state["solve"] else body(*(state[name] for name in NAMES))
    laid = shown.moved(model)
    # Shifts are found by themselves: the known points keep their middle.
    shift = (target - laid)[:count].mean(axis=0) + MIDDLE
    laid = laid + shift
    left = laid[:count] - GROUND[:count]
    found = [
        100 * (shown.scale - 1),
        *np.degrees(exterior.angles_from_rotation(shown.rotation)).tolist(),
    ]
    figures = {
        "plan": sheet.Number(float(np.sqrt(np.mean(np.sum(left[:, :2] ** 2, axis=1)))), 2, "m"),
        "height": sheet.Number(float(np.sqrt(np.mean(left[:, 2] ** 2))), 2, "m"),
    } | {
        name: sheet.Number(value, 2, "%" if name == "scale" else "°", put)
        for name, value, put in zip(NAMES, found, truth.tolist(), strict=True)
    }
    ends = GROUND[:count] + state["times"] * left
    shapes = [*space.ground(-100, -100, 1000, 1800, lambda plan: on_hills(plan, 60.0)[:, 2])]
    shapes += [sheet.shape("arrow", pair, "bad") for pair in zip(GROUND, ends, strict=False)]
    places = enumerate(GROUND[:count], 1)
    shapes += [sheet.shape("crosses", [place], "given", f"{i}") for i, place in places]
    scene = sheet.Canvas("scene", (-100, -100, 150, 1000, 1800, 450), tuple(shapes))
    rms = [np.sqrt(np.mean(np.sum((one.moved(model) - target) ** 2, axis=1))) for one in fits]
    plot = sheet.Plot(
        "n", "error", (sheet.curve("error", counts, rms),), (count, float(rms[count - 3]))
    )
    symbols: dict[str, sheet.Number | sheet.Block] = {
        "X_1": sheet.block(laid[0], 1, "m"),
        "λ": sheet.Number(shown.scale, 4),
        "R": sheet.block(shown.rotation, 4),
        "x_1": sheet.block(model[0], 1),
        "X_0": sheet.block(shift, 1, "m"),
    }
    solved = dict(zip(NAMES, found, strict=True)) if state["solve"] else {}
    return sheet.View(
        figures, (scene,), symbols, plot, idle=dict.fromkeys(solved, "solve"),
        in_force={name: round(value, 2) for name, value in solved.items()},
    )  # fmt: skip


def ask(rng: np.random.Generator) -> sheet.Asked:
    """How much a tilt lifts a point beside the axis."""
    tilt, away = float(rng.integers(2, 21)) / 10, float(rng.integers(3, 15) * 100)
    lifted = body(0, tilt, 0, 0).moved(np.array([[0.0, away, 0.0]]))[0, 2]
    return sheet.Asked({"tilt": tilt, "away": away}, float(lifted))


TURNS = [sheet.Slider(name, -8, 8, 0, 0.02, "°") for name in NAMES[1:]]
LESSON = sheet.Lesson(
    "absolute",
    "f",
    (
        sheet.Slider("scale", -8, 8, 0, 0.02, "%"), *TURNS, sheet.Slider("solve", 0, 1, 0, 1),
        sheet.Slider("n", 3, len(GROUND), 5, 1), sheet.Slider("times", 1, 2000, 1, 1),
        sheet.NOISE, sheet.SEED,
    ),
    view,
    (sheet.Equation("X_1", sheet.row("λ", "*", "R", "*", "x_1", "+", "X_0")),),
    (sheet.Question("lift", "m", 0.5, ask),),
    hides_truth=True,
    order=2,
)  # fmt: skip
