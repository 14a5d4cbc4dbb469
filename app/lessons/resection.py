"""Resection: one photo on known points, and how their places decide what is known of it."""

from dataclasses import replace

import numpy as np

from app.lessons import sheet, space
from app.lessons.photo import HALF_MM, PIXEL_MM, camera_with, photo_model, vertical_at
from core.arrays import Matrix, ObjectPoints, PixelPoints
from core.geometry.collinearity import film_from_object, object_from_film
from core.geometry.exterior import ExteriorOrientation
from core.geometry.resection import PhotoModel, difference, moved

C_MM, ABOVE_M = 152.0, 1500.0
REACH_M = HALF_MM / C_MM * ABOVE_M
TIMES = 1000.0
"""Errors are drawn so many times their size."""
DRAWS = 25
"""So many photos measured anew, each with errors of its own."""
LIFTS = np.array([0.0, 1.0, -0.6, 0.4])
"""Heights of the points as shares of the relief."""
TRUTH = vertical_at(0.0, ABOVE_M)
SINGULAR = 1e-14
PLACES = ((-900, 800), (850, 850), (900, -850), (-850, -900))


def resected(model: PhotoModel, points: ObjectPoints, pixels: PixelPoints) -> ExteriorOrientation:
    """Least squares from the true orientation: two steps of Gauss and Newton."""
    exterior = TRUTH
    for _ in range(2):
        predicted, design = model.linearised(points, exterior)
        off = (pixels - predicted).ravel()
        exterior = moved(exterior, np.linalg.lstsq(design.reshape(-1, 6), off, rcond=None)[0])
    return exterior


def spread(model: PhotoModel, points: ObjectPoints, measured: np.ndarray) -> Matrix:
    """Errors in plan (m) of photos that were measured anew; none of those that go astray."""
    found: list[Matrix] = []
    for pixels in measured:
        try:
            found.append(difference(resected(model, points, pixels), TRUTH)[:2])
        except np.linalg.LinAlgError:
            # Where the points hardly fix the photo, a step may lead to where nothing is seen.
            continue
    return np.array(found).reshape(-1, 2)


def covariance_of(model: PhotoModel, points: ObjectPoints, sigma_px: float) -> Matrix:
    """Of X, Y, Z (m), omega, phi, kappa (rad); NaN where the points do not fix the photo."""
    design = model.linearised(points, TRUTH)[1].reshape(-1, 6)
    unit = 1 / np.maximum(np.linalg.norm(design, axis=0), SINGULAR)
    left = np.linalg.svd(design * unit, full_matrices=False)
    if left[1][-1] ** 2 < SINGULAR * left[1][0] ** 2:
        return np.full((6, 6), np.nan)
    scaled = left[2].T / left[1]
    return sigma_px**2 * (scaled @ scaled.T) * np.outer(unit, unit)


def view(state: sheet.State) -> sheet.View:
    """Points in plan, with the error ellipses of the nadir and of the frame's corners."""
    model = photo_model(C_MM)
    count = 4 if state["fourth"] else 3
    plan = np.array([[state[f"x{i}"], state[f"y{i}"]] for i in range(1, count + 1)])
    points = np.column_stack([plan, state["relief"] * LIFTS[:count]])
    sigma = max(state["noise"], 0.1) / 1000 / PIXEL_MM
    covariance = covariance_of(model, points, sigma)
    rng = np.random.default_rng(int(state["seed"]))
    exact = model.pixels(points, TRUTH)
    fixed = bool(np.isfinite(covariance).all())
    spots = spread(model, points, exact + rng.normal(0, sigma, (DRAWS * fixed, *exact.shape)))
    corners = object_from_film(np.array(sheet.frame_of(HALF_MM)), np.zeros(4), TRUTH, model.camera)
    ground_pixel = PIXEL_MM / C_MM * ABOVE_M
    slopes = model.linearised(corners, TRUTH)[1] * ground_pixel
    at_corners = slopes @ covariance @ np.swapaxes(slopes, 1, 2)
    ellipses = [
        sheet.shape("line", sheet.ellipse(place[:2], matrix, TIMES), "error")
        for place, matrix in zip(corners, at_corners, strict=True)
        if fixed
    ]
    if fixed:
        around = sheet.ellipse((0, 0), covariance[:2, :2], TIMES)
        ellipses.append(sheet.shape("line", around, "estimate"))
    edge = 1.25 * REACH_M
    canvas = sheet.Canvas(
        "plan",
        (-edge, -edge, edge, edge),
        (
            sheet.shape("area", corners[:, :2], "film"),
            *circle_through(plan[:3]),
            sheet.shape("dots", TIMES * spots, "faint"),
            *ellipses,
            sheet.shape("crosses", [(0, 0)], "given", "N"),
            *(
                sheet.shape("dots", [place], "ray", f"{i}", handle=(f"x{i}", f"y{i}"))
                for i, place in enumerate(plan.tolist(), 1)
            ),
        ),
    )
    figures = figures_of(covariance, at_corners)
    shares = np.append(np.geomspace(0.15, 1.0, 9), 1.12)
    closer = [covariance_of(model, points * s, sigma) for s in shares]
    curve = sheet.curve("corner", shares, [worst_of(slopes, one) for one in closer])
    plot = sheet.Plot("share", "corner", (curve,), (1.0, figures["corner"].value))
    return sheet.View(
        figures,
        (canvas, scene(plan, points, covariance)),
        symbols_of(count) | first_point(points) | covariance_symbols(covariance, sigma),
        plot if fixed else None,
        warning="" if fixed else "undetermined",
    )


def scene(plan: Matrix, points: ObjectPoints, covariance: Matrix) -> sheet.Canvas:
    """The photo above its points, the cylinder through three of them, and the centre's errors."""
    edge = 1.25 * REACH_M
    planes = ((0, 1), (0, 2), (1, 2))
    ovals: list[sheet.Shape] = []
    for plane in planes if np.isfinite(covariance).all() else ():
        oval = np.tile(TRUTH.centre, (41, 1))
        oval[:, plane] = sheet.ellipse(
            TRUTH.centre[list(plane)], covariance[np.ix_(plane, plane)], TIMES
        )
        ovals.append(sheet.shape("line", oval, "estimate"))
    return sheet.Canvas(
        "scene",
        (-edge, -edge, 0.0, edge, edge, 1.15 * ABOVE_M),
        (
            *space.ground(-edge, -edge, edge, edge),
            *cylinder(plan[:3]),
            *space.photo(TRUTH, C_MM, 0.25 * ABOVE_M / C_MM * 1000, "O"),
            *space.rays(TRUTH.centre, points),
            *ovals,
            *(sheet.shape("dots", [place], "ray", f"{i}") for i, place in enumerate(points, 1)),
        ),
    )


def cylinder(places: np.ndarray) -> list[sheet.Shape]:
    """The upright cylinder over the circle of three points, as high as the camera."""
    turned = [np.array(one.points) for one in circle_through(places)]
    rings = [
        np.column_stack([circle, np.full(len(circle), height)])
        for circle in turned
        for height in (0.0, ABOVE_M)
    ]
    sides = [np.array(pair) for pair in zip(*(ring[:-1:10] for ring in rings), strict=True)]
    return [sheet.shape("line", line, "axis") for line in (*rings, *sides)]


def worst_of(slopes: np.ndarray, covariance: Matrix) -> float:
    """Standard deviation of the ground at the worst of some places, metres."""
    variances = np.trace(slopes @ covariance @ np.swapaxes(slopes, 1, 2), axis1=1, axis2=2)
    return float(np.sqrt(variances.max()))


def figures_of(covariance: Matrix, at_corners: np.ndarray) -> dict[str, sheet.Number]:
    """Standard deviations of the photo, and of the ground at the worst corner."""
    sigmas = np.sqrt(np.diag(covariance))
    worst = np.sqrt(np.trace(at_corners, axis1=1, axis2=2).max())
    return {
        "sigma_x": sheet.Number(float(sigmas[0]), 2, "m"),
        "sigma_y": sheet.Number(float(sigmas[1]), 2, "m"),
        "sigma_z": sheet.Number(float(sigmas[2]), 2, "m"),
        "sigma_omega": sheet.Number(float(np.degrees(sigmas[3])) * 60, 2, "′"),
        "sigma_phi": sheet.Number(float(np.degrees(sigmas[4])) * 60, 2, "′"),
        "sigma_kappa": sheet.Number(float(np.degrees(sigmas[5])) * 60, 2, "′"),
        "corner": sheet.Number(float(worst), 2, "m"),
    }


def covariance_symbols(
    covariance: Matrix, sigma_px: float
) -> dict[str, sheet.Number | sheet.Block]:
    """The covariance of the camera's place, square metres; none where nothing is known of it."""
    place = covariance[:3, :3]
    if not np.isfinite(place).all():
        return {}
    digits = max(3, 2 - int(np.floor(np.log10(np.abs(place).max()))))
    return {
        "Σ": sheet.block(place, digits),
        "Q": sheet.block(place / sigma_px**2, digits),
        "σ": sheet.Number(sigma_px, 3, "px"),
    }


def symbols_of(count: int) -> dict[str, sheet.Number]:
    """Numbers of the formula of redundancy."""
    return {"r": sheet.Number(2 * count - 6, 0), "n": sheet.Number(count, 0)}


def first_point(points: ObjectPoints) -> dict[str, sheet.Number]:
    """Point 1 on film, and from the camera along the axes of the film."""
    along = TRUTH.object_from_image.T @ (points[0] - TRUTH.centre)
    film = film_from_object(points[:1], TRUTH, camera_with(C_MM))
    return {
        "x_1": sheet.Number(float(film[0, 0]), 3, "mm"),
        "c": sheet.Number(C_MM, 0, "mm"),
        "u_1": sheet.Number(float(along[0]), 1, "m"),
        "w_1": sheet.Number(float(along[2]), 1, "m"),
    }


def circle_through(places: np.ndarray) -> list[sheet.Shape]:
    """The circle in plan through three points: with the nadir on it, they fix nothing."""
    (a, b), (c, d) = places[1] - places[0], places[2] - places[0]
    twice = 2 * (a * d - b * c)
    if abs(twice) < 1:
        return []
    first, second = a * a + b * b, c * c + d * d
    middle = np.array([d * first - b * second, a * second - c * first]) / twice
    turn = np.linspace(-0.75 * np.pi, 1.25 * np.pi, 121)
    circle = np.column_stack([np.cos(turn), np.sin(turn)]) * float(np.hypot(*middle))
    return [sheet.shape("line", places[0] + middle + circle, "axis", "cylinder", below=True)]


def ask(rng: np.random.Generator) -> sheet.Asked:
    """How many equations are left over."""
    count = int(rng.integers(4, 13))
    return sheet.Asked({"n": float(count)}, symbols_of(count)["r"].value)


NORMAL = sheet.fence(sheet.row(sheet.power("A", "T"), "*", "A"))
COFACTORS = sheet.power(NORMAL, "−1")
LESSON = sheet.Lesson(
    "resection",
    "f",
    (
        *(
            sheet.Slider(f"{axis}{i}", -1130, 1130, start, 10, "m", moved_in="plan")
            for i, place in enumerate(PLACES, 1)
            for axis, start in zip("xy", place, strict=True)
        ),
        sheet.Slider("fourth", 0, 1, 1, 1),
        sheet.Slider("relief", 0, 300, 40, 5, "m"),
        replace(sheet.NOISE, start=10),
        sheet.SEED,
    ),
    view,
    (
        sheet.Equation("x_1", sheet.row("−", "c", "*", sheet.over("u_1", "w_1"))),
        sheet.Equation("r", sheet.row("2", "*", "n", "−", "6")),
        sheet.Equation("Σ", sheet.row(sheet.power("σ", "2"), "*", sheet.named("Q", COFACTORS))),
    ),
    (sheet.Question("redundancy", "", 0.1, ask, 0),),
)
