"""Relative orientation: six von Gruber points, whose y-parallaxes are taken away by hand."""

import numpy as np

from app.lessons import sheet, space
from app.lessons.photo import HALF_MM, camera_with, on_ground, vertical_at
from core.arrays import FilmPoints, Scalars
from core.geometry.collinearity import film_from_object, object_from_film
from core.geometry.exterior import ExteriorOrientation, angles_from_rotation, rotation_from_angles
from core.geometry.relative import (
    RayPairs,
    RelativeOrientation,
    adjust_relative,
    coplanarity_sigma,
    parallax,
    rays_from_ideal,
)

C_MM, ABOVE_M, BASE_M = 152.0, 1500.0, 900.0
UM_ANGLE = 0.001 / C_MM
"""A micrometre on film, as an angle: the unit of the parallaxes."""
SIDE_M = 850.0
GRUBER = on_ground(
    (0, 0, 20),
    (BASE_M, 0, -10),
    (0, SIDE_M, 40),
    (BASE_M, SIDE_M, 0),
    (0, -SIDE_M, -30),
    (BASE_M, -SIDE_M, 15),
)
"""The six points in their usual order: two below the photos, four at the sides."""
NAMES = ("by", "bz", "omega", "phi", "kappa")


def orientation_of(by: float, bz: float, angles_deg: np.ndarray) -> RelativeOrientation:
    """The second photo: base in percent of bx, angles in degrees."""
    base = np.array([1.0, by / 100, bz / 100])
    turn = rotation_from_angles(*np.radians(angles_deg).tolist())
    return RelativeOrientation(base / np.linalg.norm(base), turn)


def hidden(seed: int) -> np.ndarray:
    """What is to be found: by, bz (percent), omega, phi, kappa (degrees)."""
    rng = np.random.default_rng(seed)
    return np.round(rng.uniform([-3, -3, -1.5, -1.5, -1.5], [3, 3, 1.5, 1.5, 1.5]), 2)


def measured(truth: np.ndarray, noise_um: float, seed: int) -> tuple[FilmPoints, FilmPoints]:
    """Both photos of the six points."""
    centre = np.array([BASE_M, truth[0] / 100 * BASE_M, ABOVE_M + truth[1] / 100 * BASE_M])
    second = ExteriorOrientation(centre, *np.radians(truth[2:]).tolist())
    camera, rng = camera_with(C_MM), np.random.default_rng(1000 + seed)
    films = [film_from_object(GRUBER, one, camera) for one in (vertical_at(0, ABOVE_M), second)]
    first, other = (film + rng.normal(0, noise_um / 1000, film.shape) for film in films)
    return first, other


def view(state: sheet.State) -> sheet.View:
    """The parallaxes that are left, as arrows in the first photo."""
    seed = int(state["seed"])
    truth = hidden(seed)
    first, second = measured(truth, state["noise"], seed)
    rays = RayPairs(
        rays_from_ideal(first, C_MM), rays_from_ideal(second, C_MM), (UM_ANGLE, UM_ANGLE)
    )
    hand = orientation_of(
        state["by"], state["bz"], np.array([state["omega"], state["phi"], state["kappa"]])
    )
    found = adjust_relative(rays, hand, max(3 * state["noise"], 3.0))
    shown = found if state["solve"] else hand
    # Of two coordinates that are equally good, as y on the left minus y on the right.
    left = np.sqrt(2) * parallax(rays, shown)
    ends = first + np.column_stack([np.zeros(6), state["times"] * left / 1000])
    edge = 1.12 * HALF_MM
    canvas = sheet.Canvas(
        "first",
        (-edge, -1.1 * edge, edge, edge),
        (
            sheet.shape("area", sheet.frame_of(HALF_MM), "film"),
            *(
                sheet.shape("arrow", [spot, end], "bad")
                for spot, end in zip(first.tolist(), ends.tolist(), strict=True)
            ),
            *(
                sheet.shape("dots", [spot], "given", f"{i}", number=sheet.Number(p, 0), below=p > 0)
                for i, (spot, p) in enumerate(zip(first.tolist(), left.tolist(), strict=True), 1)
            ),
        ),
        "mm",
    )
    rms, worst = float(np.sqrt(np.mean(left**2))), int(np.argmax(np.abs(left)))
    figures = {
        "rms": sheet.Number(rms, 1, "µm"), "worst": sheet.Number(worst + 1, 0),
    } | elements_of(shown, truth)  # fmt: skip
    symbols: dict[str, sheet.Number | sheet.Block] = {
        "p_i": sheet.Number(float(left[worst]), 1, "µm"),
        "u_i": sheet.block(rays.first[worst], 5),
        "v_i": sheet.block(rays.second[worst], 5),
        "b": sheet.block(shown.base, 5),
        "R": sheet.block(shown.rotation, 5),
        "σ_i": sheet.Number(1e6 * float(coplanarity_sigma(rays, shown)[worst]), 3, "·10⁻⁶/µm"),
    }
    solved = elements_of(found, truth) if state["solve"] else {}
    return sheet.View(
        figures, (canvas, scene(first, second, shown)), symbols,
        idle=dict.fromkeys(solved, "solve"),
        in_force={name: round(one.value, 2) for name, one in solved.items()},
    )  # fmt: skip


def scene(first: FilmPoints, second: FilmPoints, shown: RelativeOrientation) -> sheet.Canvas:
    """Both photos as they are oriented now, and where their rays pass each other."""
    left = vertical_at(0.0, ABOVE_M)
    angles = angles_from_rotation(shown.rotation)
    base = shown.base / shown.base[0] * BASE_M
    right = ExteriorOrientation(left.centre + base, *angles)
    times = 0.2 * ABOVE_M / C_MM * 1000
    shapes = [*space.photo(left, C_MM, times), *space.photo(right, C_MM, times)]
    for films in zip(first, second, strict=True):
        ends = nearest(films, (left, right))
        shapes += [
            sheet.shape("line", [one.centre, end], "ray")
            for one, end in zip((left, right), ends, strict=True)
        ]
        shapes.append(sheet.shape("line", ends, "bad"))
        shapes.append(sheet.shape("dots", ends, "bad"))
    edge = 1.1 * SIDE_M
    # Lower than the ground, which buttons would hide else.
    box = (-0.4 * BASE_M, -edge, -0.25 * ABOVE_M, 1.4 * BASE_M, edge, 1.05 * ABOVE_M)
    return sheet.Canvas("scene", box, tuple(shapes))


def nearest(
    films: tuple[Scalars, Scalars], photos: tuple[ExteriorOrientation, ExteriorOrientation]
) -> list[Scalars]:
    """Where the rays of two film points are nearest to each other: a place on each, metres."""
    camera = camera_with(C_MM)
    along = [
        object_from_film(film[None], np.zeros(1), one, camera)[0] - one.centre
        for film, one in zip(films, photos, strict=True)
    ]
    apart = photos[1].centre - photos[0].centre
    steps = np.linalg.lstsq(np.column_stack([along[0], -along[1]]), apart, rcond=None)[0]
    return [one.centre + step * way for one, step, way in zip(photos, steps, along, strict=True)]


def elements_of(shown: RelativeOrientation, truth: np.ndarray) -> dict[str, sheet.Number]:
    """The five elements, with what was put in."""
    base = 100 * shown.base[1:] / shown.base[0]
    values = [*base.tolist(), *np.degrees(angles_from_rotation(shown.rotation)).tolist()]
    units = ("%", "%", "°", "°", "°")
    return {
        name: sheet.Number(value, 2, unit, put)
        for name, value, unit, put in zip(NAMES, values, units, truth.tolist(), strict=True)
    }


def ask(rng: np.random.Generator) -> sheet.Asked:
    """The parallax, left minus right, that a small kappa makes at point 1; nothing else does."""
    kappa = float(rng.integers(2, 13)) / 10
    first, second = measured(np.array([0, 0, 0, 0, kappa]), 0.0, 1)
    # Point 1 lies below the first photo, as far from the second as the ground there is high.
    away = float(np.hypot(*second[0]))
    return sheet.Asked({"kappa": kappa, "b": away}, 1000 * float(first[0, 1] - second[0, 1]))


LESSON = sheet.Lesson(
    "relative",
    "f",
    (
        sheet.Slider("by", -5, 5, 0, 0.02, "%"),
        sheet.Slider("bz", -5, 5, 0, 0.02, "%"),
        sheet.Slider("omega", -2, 2, 0, 0.01, "°"),
        sheet.Slider("phi", -2, 2, 0, 0.01, "°"),
        sheet.Slider("kappa", -2, 2, 0, 0.01, "°"),
        sheet.Slider("solve", 0, 1, 0, 1),
        sheet.Slider("times", 5, 500, 10, 5),
        sheet.NOISE,
        sheet.SEED,
    ),
    view,
    (
        sheet.Equation(
            "p_i",
            sheet.row(
                sheet.root("2"),
                "*",
                sheet.over(
                    sheet.row("u_i", "·", sheet.fence(sheet.row("b", "×", "R", "*", "v_i"))),
                    "σ_i",
                ),
            ),
        ),
    ),
    (sheet.Question("kappa", "µm", 60.0, ask, 0, signed=True),),
    hides_truth=True,
    order=1,
)
