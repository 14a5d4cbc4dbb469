"""A tilted photo: principal point, isocentre and nadir, the scale along the tilt, the horizon."""

import numpy as np

from app.lessons import sheet, space
from app.lessons.photo import HALF_MM, camera_with, tilted_at
from core.arrays import FilmPoints, Scalars
from core.geometry.collinearity import film_from_object, object_from_film
from core.geometry.exterior import ExteriorOrientation
from core.geometry.image_corrections import isocentre_on_film, nadir_on_film

ABOVE_M = 1500.0
"""Flying height; it only sets the size of the squares on the ground."""
SIDE_M = 250.0
FAR_M = 1e7


def scale_numbers(film: FilmPoints, exterior: ExteriorOrientation, c: float) -> Scalars:
    """Scale denominators at film points, along the parallels to the tilt's axis."""
    nadir = nadir_on_film(exterior, c)[0]
    along = np.array([-nadir[1], nadir[0]]) / max(float(np.hypot(*nadir)), 1e-12)
    step = 0.01 * along
    level = np.zeros(len(film))
    ends = [object_from_film(film + s, level, exterior, camera_with(c)) for s in (-step, step)]
    return np.linalg.norm(ends[1] - ends[0], axis=1) / 0.02 * 1000


def view(state: sheet.State) -> sheet.View:
    """The three points on the film, and on their rays in space."""
    c, tilt, direction = state["c"], np.radians(state["t"]), np.radians(state["direction"])
    exterior = tilted_at(ABOVE_M, max(float(tilt), 1e-6), float(direction))
    nadir, iso = (f(exterior, c)[0] for f in (nadir_on_film, isocentre_on_film))
    away = float(np.hypot(*nadir))
    down = nadir / max(away, 1e-12)
    axis = np.array([-down[1], down[0]])
    reach = np.linspace(-HALF_MM, HALF_MM, 60)
    scales = scale_numbers(reach[:, None] * down, exterior, c)
    shown = (scales > 0) & (scales < 6 * ABOVE_M / c * 1000)
    points = {"principal": np.zeros(2), "isocentre": iso, "nadir": nadir}
    edge = 1.45 * HALF_MM
    film = sheet.Canvas(
        "film",
        (-edge, -edge, edge, edge),
        (
            sheet.shape("area", sheet.frame_of(HALF_MM), "film"),
            *ground_squares(exterior, c, edge),
            *horizon(exterior, c, down, axis, edge),
            sheet.shape("line", [iso - 2 * edge * axis, iso + 2 * edge * axis], "second"),
            sheet.shape("line", [-2 * edge * down, 2 * edge * down], "axis"),
            sheet.shape("dots", [points["nadir"]], "bad", "N"),
            sheet.shape("dots", [points["isocentre"]], "second", "I"),
            sheet.shape("dots", [points["principal"]], "estimate", "H"),
        ),
        "mm",
    )
    found = sheet.Number(float(np.hypot(*iso)), 2, "mm")
    figures = {
        "nadir": sheet.Number(away, 2, "mm"),
        "isocentre": found,
        "halfway": sheet.Number(away / 2 - found.value, 3, "mm"),
        "scale_n": sheet.Number(float(scale_numbers(nadir[None], exterior, c)[0]), 0),
        "scale_i": sheet.Number(float(scale_numbers(iso[None], exterior, c)[0]), 0),
        "scale_h": sheet.Number(float(scale_numbers(np.zeros((1, 2)), exterior, c)[0]), 0),
    }
    at = float(down @ iso)
    plot = sheet.Plot(
        "along",
        "scale",
        (sheet.curve("scale", reach[shown], scales[shown]),),
        (at, figures["scale_i"].value),
    )
    symbols = {"n": figures["nadir"], "i": found}
    return sheet.View(figures, (scene(exterior, c), film), symbols, plot)


def ground_squares(exterior: ExteriorOrientation, c: float, edge: float) -> list[sheet.Shape]:
    """Squares of the ground as the photo shows them."""
    lines = np.arange(-12, 13) * SIDE_M
    along = np.linspace(-3000, 3000, 61)
    found: list[sheet.Shape] = []
    for at in lines:
        for x, y in ((np.full(61, at), along), (along, np.full(61, at))):
            ground = np.column_stack([x, y, np.zeros(61)])
            film = film_from_object(ground, exterior, camera_with(c))
            film[np.abs(film).max(axis=1) > edge] = np.nan
            shape = sheet.shape("line", film, "faint")
            if len(shape.points) > 1:
                found.append(shape)
    return found


def horizon(
    exterior: ExteriorOrientation, c: float, down: Scalars, axis: Scalars, edge: float
) -> list[sheet.Shape]:
    """The horizon where it lies in the drawing: the image of what is far away."""
    turn = exterior.object_from_image[:2, :2] @ -down
    far = np.append(FAR_M * turn / max(float(np.hypot(*turn)), 1e-12), 0.0)
    film = film_from_object(far[None], exterior, camera_with(c))[0]
    if not np.isfinite(film).all() or np.hypot(*film) > 1.3 * edge:
        return []
    return [sheet.shape("line", [film - 2 * edge * axis, film + 2 * edge * axis], "ray", "horizon")]


def scene(exterior: ExteriorOrientation, c: float) -> sheet.Canvas:
    """The photo above level ground, with plumb line, axis, and the line between them."""
    # The film is drawn far larger than the ground, or nothing of it would be seen.
    times = 0.5 * ABOVE_M / HALF_MM * 1000
    film = np.concatenate(
        [nadir_on_film(exterior, c), isocentre_on_film(exterior, c), np.zeros((1, 2))]
    )
    ground = object_from_film(film, np.zeros(3), exterior, camera_with(c))
    looks: tuple[sheet.Look, ...] = ("bad", "second", "estimate")
    marks = space.in_space(film, exterior, c, times)
    lines = [
        part
        for look, name, mark, end in zip(looks, "NIH", marks, ground, strict=True)
        for part in (
            sheet.shape("line", [exterior.centre, end], look),
            sheet.shape("crosses", [end], look),
            sheet.shape("dots", [mark], look, name),
        )
    ]
    wide = 0.75 * ABOVE_M
    return sheet.Canvas(
        "scene",
        (-wide, -wide, 0.0, wide, wide, 1.05 * ABOVE_M),
        (
            *space.ground(-12 * SIDE_M, -12 * SIDE_M, 12 * SIDE_M, 12 * SIDE_M),
            *space.photo(exterior, c, times, "O"),
            *lines,
        ),
    )


def ask(rng: np.random.Generator) -> sheet.Asked:
    """The nadir of a photo tilted a little."""
    c, tilt = float(rng.choice([100, 152, 210, 300])), float(rng.integers(2, 41)) / 4
    nadir = nadir_on_film(tilted_at(ABOVE_M, float(np.radians(tilt)), 0.0), c)
    return sheet.Asked({"c": c, "t": tilt}, float(np.hypot(*nadir[0])))


LESSON = sheet.Lesson(
    "tilt",
    "c",
    (
        sheet.Slider("t", 0, 60, 20, 0.5, "°", "t"),
        sheet.Slider("direction", 0, 355, 0, 5, "°"),
        sheet.Slider("c", 85, 310, 152, 1, "mm", "c"),
    ),
    view,
    (
        sheet.Equation("n", sheet.row("c", "*", "tan", "t")),
        sheet.Equation("i", sheet.row("c", "*", "tan", sheet.over("t", "2"))),
    ),
    (sheet.Question("nadir", "mm", 0.3, ask),),
)
