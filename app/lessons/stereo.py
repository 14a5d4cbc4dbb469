"""Stereo: two photos, a parallax, a height; and how well it is known."""

from functools import lru_cache

import numpy as np

from app.lessons import sheet, space
from app.lessons.photo import HALF_MM, camera_with, on_ground, vertical_at
from core.arrays import FilmPoints, Matrix, Scalars
from core.doubts import Failure
from core.geometry.collinearity import VACUUM, film_from_object
from core.geometry.intersection import Intersection, OrientedRay, intersect

MOST_HEIGHT = 200.0
"""The ground point is hidden between nought and this, metres."""


def rays_of(base: float, above: float, c: float) -> list[OrientedRay]:
    """Two vertical photos, half a base to each side of the middle."""
    return [
        OrientedRay(vertical_at(east, above), camera_with(c), VACUUM)
        for east in (-base / 2, base / 2)
    ]


def seen(point: tuple[float, float, float], rays: list[OrientedRay]) -> FilmPoints:
    """Where both photos show a point."""
    ground = on_ground(point)
    return np.concatenate([film_from_object(ground, ray.exterior, ray.camera) for ray in rays])


def height_from(film: FilmPoints, rays: list[OrientedRay], sigma_um: float) -> Intersection:
    """The point where both rays meet, with its covariance."""
    found = intersect(film, np.full(2, sigma_um / 1000), rays)
    assert not isinstance(found, Failure), found.reason
    return found


@lru_cache(maxsize=4096)
def sigma_height(base: float, above: float, c: float, sigma_um: float) -> float:
    """Standard deviation of a height in the middle of the model, metres."""
    rays = rays_of(base, above, c)
    return float(np.sqrt(height_from(seen((0.0, 0.0, 0.0), rays), rays, sigma_um).covariance[2, 2]))


def view(state: sheet.State) -> sheet.View:
    """The floating mark above or below the ground, in space and in both photos."""
    base, above, c, mark = state["B"], state["H"], state["c"], state["mark"]
    sigma = max(state["noise"], 1e-3)
    rng = np.random.default_rng(int(state["seed"]))
    height = float(rng.uniform(0.1, 0.9)) * MOST_HEIGHT
    rays = rays_of(base, above, c)
    exact, marks = seen((0.0, 0.0, height), rays), seen((0.0, 0.0, mark), rays)
    measured = exact + rng.normal(0, state["noise"] / 1000, (2, 2))
    found = height_from(measured, rays, sigma)
    middle = sigma_height(base, above, c, sigma)
    parallax = float(measured[0, 0] - measured[1, 0])
    split = 1000 * (parallax - float(marks[0, 0] - marks[1, 0]))
    bases = np.geomspace(min(0.1, base / above), max(1.2, base / above), 12) * above
    figures = {
        "parallax": sheet.Number(parallax, 3, "mm"),
        "split": sheet.Number(split, 0, "µm"),
        "height": sheet.Number(float(found.position[2]), 2, "m", height, secret=True),
        "sigma_z": sheet.Number(middle, 2, "m"),
        "ratio": sheet.Number(base / above, 2),
    }
    curve = sheet.curve(
        "sigma_z", bases / above, [sigma_height(float(one), above, c, sigma) for one in bases]
    )
    plot = sheet.Plot("ratio", "sigma_z", (curve,), (base / above, middle))
    symbols = {
        "p": sheet.Number(float(marks[0, 0] - marks[1, 0]), 3, "mm"),
        "σ_Z": sheet.Number(middle, 2, "m"),
        "σ_p": sheet.Number(np.sqrt(2) * sigma / 1000, 4, "mm"),
    }
    canvases = (scene(rays, mark, height), pair(measured, marks, split))
    warning = "beyond" if np.abs(exact[:, 0]).max() > HALF_MM else ""
    return sheet.View(figures, canvases, symbols, plot, warning=warning)


def scene(rays: list[OrientedRay], mark: float, height: float) -> sheet.Canvas:
    """Both photos, the rays through the mark, and the hidden ground."""
    first, second = (ray.exterior for ray in rays)
    base, above = float(second.centre[0] - first.centre[0]), float(first.centre[2])
    half = max(base / 2, 0.35 * above)
    c = rays[0].camera.principal_distance_mm
    times = 0.22 * above / c * 1000

    def hills(plan: Matrix) -> Scalars:
        return height + 0.03 * above * np.sin(plan[:, 0] / half * 2.2)

    return sheet.Canvas(
        "scene",
        (-1.2 * half, -half, 0.0, 1.2 * half, half, 1.05 * above),
        (
            *space.ground(-1.2 * half, -half, 1.2 * half, half),
            sheet.shape("text", [(-1.2 * half, half, 0.0)], "axis", "datum"),
            *space.ground(-1.2 * half, -half, 1.2 * half, half, hills, "truth"),
            *(shape for ray in rays for shape in space.photo(ray.exterior, c, times)),
            *(
                shape
                for ray in rays
                for shape in space.rays(ray.exterior.centre, [np.array([0.0, 0.0, mark])])
            ),
            sheet.shape(
                "line", [first.centre, second.centre], "axis", number=sheet.Number(base, 0, "m")
            ),
            sheet.shape("dots", [(0.0, 0.0, height)], "truth", "P"),
            sheet.shape("dots", [(0.0, 0.0, mark)], "bad", "mark"),
        ),
    )


def pair(measured: FilmPoints, marks: FilmPoints, split: float) -> sheet.Canvas:
    """Both photos about the point, one above the other, with the marks laid on the left image."""
    x = 1000 * (marks[:, 0] - measured[:, 0] - (marks[0, 0] - measured[0, 0]))
    reach = max(120.0, 1.3 * abs(split))
    return sheet.Canvas(
        "pair",
        (-reach, -3, reach, 3),
        (
            sheet.shape("line", [(-2 * reach, 0), (2 * reach, 0)], "faint"),
            sheet.shape("line", [(0, -3), (0, 3)], "axis"),
            sheet.shape("dots", [(0, 1.5)], "given", "left"),
            sheet.shape("crosses", [(0, 1.5)], "bad"),
            sheet.shape("dots", [(0, -1.5)], "given", "right"),
            sheet.shape(
                "crosses",
                [(float(x[1]), -1.5)],
                "bad",
                "mark",
                number=sheet.Number(split, 0, "µm"),
                below=True,
            ),
        ),
        "µm",
        equal=False,
    )


def ask(rng: np.random.Generator) -> sheet.Asked:
    """How well a height is known from the geometry of a pair."""
    c, scale = float(rng.choice([152, 210, 305])), float(rng.choice([8000, 15000, 23000]))
    sigma, overlap = float(rng.integers(4, 16)), float(rng.choice([55, 60, 65, 70]))
    above, base = scale * c / 1000, (1 - overlap / 100) * 2 * HALF_MM * scale / 1000
    values = {"c": c, "scale": scale, "sigma": sigma, "overlap": overlap}
    return sheet.Asked(values, sigma_height(base, above, c, sigma))


LESSON = sheet.Lesson(
    "stereo",
    "e",
    (
        sheet.Slider("mark", -50, 250, 0, 0.5, "m", "Z"),
        sheet.Slider("B", 200, 3000, 900, 10, "m", "B"),
        sheet.Slider("H", 600, 6000, 1800, 10, "m", "H"),
        sheet.Slider("c", 85, 310, 152, 1, "mm", "c"),
        sheet.NOISE,
        sheet.SEED,
    ),
    view,
    (
        sheet.Equation("p", sheet.over(sheet.row("B", "*", "c"), sheet.row("H", "−", "Z"))),
        sheet.Equation(
            "σ_Z",
            sheet.row(sheet.over(sheet.power("H", "2"), sheet.row("B", "*", "c")), "*", "σ_p"),
        ),
    ),
    (sheet.Question("sigma", "m", 0.03, ask, 2),),
    hides_truth=True,
)
