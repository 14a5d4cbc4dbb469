"""From film to mosaic in ten pictures: one crossroads followed through the whole chain."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from app.lessons import chain_flight as flown
from app.lessons import sheet
from app.lessons.chain_flight import CAMERA, DEM, MARKS, PATCH_M, REACH_M, FollowedPoint, Given
from app.lessons.flight import C_MM, SCALE
from app.lessons.photo import HALF_MM, PIXEL_MM
from core.arrays import Matrix, Position
from core.block import footprint
from core.doubts import Failure
from core.geometry.collinearity import EARTH_RADIUS_M
from core.geometry.image_corrections import ImageShift, ground_displacement_m, shifts_at
from core.geometry.intersection import OrientedRay, intersect, ray_directions
from core.geometry.resection import PhotoModel
from core.literature.common_grid import grid_about
from core.matching.patches import object_on_ground
from core.matching.peaks import level_and_spread

# design: so magnified, arrows are seen and stay within the drawing.
TIMES, GROUND_TIMES = 4000.0, 600.0
"""Magnification of residuals of marks, and of errors in the block."""
# design: half a side of the block's map beyond its crossroads, so that whole photos are seen.
MAP_RIM_M = 2000.0
# design: 20 m on the ground; the search's rough place is seen beside the true one.
CLOSE_PX = 90.0
"""Half of a window of the raw scan."""
# design: two pixels of the scan, as orthos of old films have; a crossroads with its fields.
ORTHO_M, ORTHO_HALF_PX = 0.5, 90
"""Pixel of the ortho about the point, and half its side."""
Part = tuple[
    tuple[sheet.Canvas, ...], dict[str, sheet.Number], dict[str, sheet.Number], sheet.Equation
]
"""Drawings, figures, values of symbols, and the formula of one step."""


def number(value: float, digits: int, unit: str = "", truth: float | None = None) -> sheet.Number:
    """A figure with what was put in."""
    known = None if truth is None else float(truth)
    return sheet.Number(float(value), digits, unit, known)


def raster(
    name: str, values: Matrix, window: tuple[float, float, float, float],
    *marks: sheet.Shape, unit: str = "m",
) -> sheet.Canvas:  # fmt: skip
    """A picture with marks over it."""
    low, high = np.quantile(values, [0.01, 0.99])
    gray = 255 * (values - low) / max(float(high - low), 1e-9)
    return sheet.Canvas(name, window, marks, unit, picture=sheet.picture(gray, window))


def scan(point: FollowedPoint) -> Part:
    """The scan with its fiducials, and one of them from near."""
    side = point.true.size_px[0]
    middle = np.full((1, 2), side / 2)
    half = side / 2
    whole = flown.scan_values(
        point.true, flown.pixels_about(middle, half, 150), point.given
    ).reshape(150, 150)
    marks = flown.measure_marks(point.name, point.given.seed)
    corner, gray = flown.mark_window(point.true, "1", point.given.seed)
    near = np.array([corner]) + gray.shape[0] / 2
    half_near = gray.shape[0] / 2
    true = point.true.interior.pixel_from_film(np.array([MARKS["1"]]))
    exact = flown.offsets_from(near, true)
    canvases = (
        raster(
            "scan", whole, (-half, -half, half, half),
            sheet.shape("crosses", flown.offsets_from(middle, marks), "bad"),
            sheet.shape("dots", flown.offsets_from(middle, point.true_pixel), "bad", "point"),
            unit="px",
        ),
        raster(
            "mark", gray, (-half_near, -half_near, half_near, half_near),
            sheet.shape("line", sheet.ellipse(exact[0], 4 * np.eye(2)), "truth"),
            sheet.shape("crosses", flown.offsets_from(near, marks[:1]), "bad"), unit="px",
        ),
    )  # fmt: skip
    figures = {
        "mark_column": number(marks[0, 0], 2, "px", true[0, 0]),
        "mark_row": number(marks[0, 1], 2, "px", true[0, 1]),
    }
    symbols = {
        "g": number(flown.GROUND_PIXEL_M, 3, "m"),
        "p": number(PIXEL_MM / 1000, 6, "m"),
        "m": number(SCALE, 0),
    }
    return canvases, figures, symbols, sheet.Equation("g", sheet.row("p", "*", "m"))


def interior(point: FollowedPoint) -> Part:
    """Pixels become millimetres of film."""
    inner, pixel = point.rough.interior, point.search.pixel
    film = inner.film_from_pixel(pixel)[0]
    true = point.true.interior.film_from_pixel(pixel)[0]
    certified = np.array(list(MARKS.values()))
    ends = certified + TIMES * inner.residuals_um / 1000
    arrows = [
        sheet.shape("arrow", both, "bad") for both in np.stack([certified, ends], axis=1).tolist()
    ]
    edge = 1.12 * HALF_MM
    canvas = sheet.Canvas(
        "film", (-edge, -edge, edge, edge),
        (
            sheet.shape("area", sheet.frame_of(HALF_MM), "film"),
            sheet.shape("crosses", certified, "given"), *arrows,
            sheet.shape("crosses", [(0, 0)], "axis", "origin"),
            sheet.shape("dots", [film], "bad", "point"),
        ),
        "mm",
    )  # fmt: skip
    a, b, offset = inner.film_from_pixel_matrix[0]
    figures = {
        "film_x": number(film[0], 4, "mm", true[0]),
        "film_y": number(film[1], 4, "mm", true[1]),
        "rms": number(inner.rms_um, 2, "µm"),
    }
    symbols = {
        "x": number(film[0], 4), "a": number(a, 6), "b": number(b, 6), "d": number(offset, 3),
        "s": number(pixel[0, 0], 1), "r": number(pixel[0, 1], 1),
    }  # fmt: skip
    right = sheet.row("a", "*", "s", "+", "b", "*", "r", "+", "d")
    return (canvas,), figures, symbols, sheet.Equation("x", right)


def outward_length_um(shift: ImageShift, film: Matrix) -> float:
    """Length of a shift on the film, negative where it points towards the middle, micrometres."""
    return 1000 * shift.sign(film[None]) * float(np.linalg.norm(shift.film_mm))


def corrections(point: FollowedPoint) -> Part:
    """What air, Earth, lens and film did to the image point."""
    height = point.place[:, 2]
    film = point.rough.interior.film_from_pixel(point.search.pixel)[0]
    parts, truth = (
        shifts_at(
            point.search.pixel,
            height,
            PhotoModel(photo.interior, CAMERA, photo.atmosphere),
            photo.exterior,
        )
        for photo in (point.rough, point.true)
    )
    looks: dict[str, sheet.Look] = {
        "refraction": "estimate", "curvature": "bad", "distortion": "second", "film": "ray",
    }  # fmt: skip
    ends = {name: 1000 * part.film_mm[0] for name, part in parts.items()}
    arrows = [sheet.shape("arrow", [(0, 0), end], looks[name], name) for name, end in ends.items()]
    edge, near = 1.12 * HALF_MM, 1.4 * max(float(np.abs(end).max()) for end in ends.values())
    inwards = np.outer([0, -1.6 * near], film / max(float(np.hypot(*film)), 1e-9))
    spot = sheet.shape("dots", [(0, 0)], "given")
    frame = sheet.shape("area", sheet.frame_of(HALF_MM), "film")
    middle = sheet.shape("crosses", [(0, 0)], "axis", "origin")
    way = sheet.shape("line", [(0, 0), film], "faint")
    photo = (frame, middle, way, replace(spot, points=[film.tolist()], label="point", below=True))
    shifts = (sheet.shape("line", inwards, "axis", "inwards"), *arrows, spot)
    canvases = (
        sheet.Canvas("moved", (-edge, -edge, edge, edge), photo, "mm"),
        sheet.Canvas("shifts", (-near, -near, near, near), shifts, "µm"),
    )
    figures = {
        name: number(outward_length_um(part, film), 2, "µm", outward_length_um(truth[name], film))
        for name, part in parts.items()
    }
    above = float(point.rough.exterior.centre[2] - height[0])
    symbols = {
        "Δr_e": figures["curvature"], "H_g": number(above, 0, "m"),
        "r": number(float(np.hypot(*film)), 1, "mm"), "c": number(C_MM, 0, "mm"),
        "R": number(EARTH_RADIUS_M, 0, "m"),
    }  # fmt: skip
    right = sheet.row(
        "−",
        sheet.over(
            sheet.row("H_g", "*", sheet.power("r", "3")),
            sheet.row("2", "*", "R", "*", sheet.power("c", "2")),
        ),
    )
    return canvases, figures, symbols, sheet.Equation("Δr_e", right)


def search(point: FollowedPoint) -> Part:
    """The ortho of today, and how alike the old scan is wherever it is laid."""
    found, half = point.search, PATCH_M + 0.5
    best = found.peaks[0]
    true = object_on_ground(point.rough, CAMERA, point.true_pixel, DEM)[0, :2] - point.place[0, :2]
    spots = np.array([[p.column - REACH_M, REACH_M - p.row] for p in found.peaks])
    wide = REACH_M + 0.5
    canvases = (
        raster("patch", found.template, (-half, -half, half, half)),
        raster(
            "surface", found.scores, (-wide, -wide, wide, wide),
            sheet.shape("crosses", [(0, 0)], "axis", "expected"),
            sheet.shape("crosses", spots[1:], "estimate"),
            sheet.shape("dots", spots[:1], "bad", "best"),
            sheet.shape("line", sheet.ellipse(true, 4 * np.eye(2)), "truth"),
        ),
    )  # fmt: skip
    middle, spread = level_and_spread(found.scores)
    figures = {
        "east": number(spots[0, 0], 2, "m", true[0]),
        "north": number(spots[0, 1], 2, "m", true[1]),
        "alike": number(best.value, 3),
    }
    symbols = {
        "z": number(best.z, 1), "q": number(best.value, 3),
        "q_0": number(middle, 3), "σ": number(spread, 3),
    }  # fmt: skip
    right = sheet.over(sheet.row("q", "−", "q_0"), "σ")
    return canvases, figures, symbols, sheet.Equation("z", right)


def control(point: FollowedPoint) -> Part:
    """The place in the raw scan: expected, found, true."""
    found = point.search
    half, count = CLOSE_PX, 121
    values = flown.scan_values(
        point.true, flown.pixels_about(found.pixel, half, count), point.given
    )
    near = {"expected": found.expected, "measured": found.pixel, "truth": point.true_pixel}
    looks: dict[str, sheet.Look] = {"expected": "estimate", "measured": "bad", "truth": "truth"}
    marks = [
        sheet.shape(
            "crosses",
            flown.offsets_from(found.pixel, pixel),
            looks[name],
            name,
            below=name == "truth",
        )
        for name, pixel in near.items()
    ]
    canvas = raster(
        "raw", values.reshape(count, count), (-half, -half, half, half), *marks, unit="px"
    )
    off = (found.pixel - found.expected)[0]
    figures = {
        "column": number(found.pixel[0, 0], 1, "px", point.true_pixel[0, 0]),
        "row": number(found.pixel[0, 1], 1, "px", point.true_pixel[0, 1]),
        "sigma_px": number(found.sigma_px, 2, "px"),
    }
    symbols = {
        "d": number(float(np.hypot(*off)), 1, "px"),
        "Δs": number(off[0], 1), "Δr": number(off[1], 1),
    }  # fmt: skip
    right = sheet.root(sheet.row(sheet.power("Δs", "2"), "+", sheet.power("Δr", "2")))
    return (canvas,), figures, symbols, sheet.Equation("d", right)


def neighbours(point: FollowedPoint) -> Part:
    """The same ground in two photos, and where their rays meet."""
    half, count = CLOSE_PX, 91
    canvases: list[sheet.Canvas] = []
    rays, films, sigmas = list[OrientedRay](), list[Matrix](), list[float]()
    for place, (name, found) in enumerate(point.searches.items()):
        photo = point.report.block.photos[name]
        true = flown.true_flight(point.given.seed).photos[name]
        values = flown.scan_values(true, flown.pixels_about(found.pixel, half, count), point.given)
        exact = true.pixel_from_object(point.place, CAMERA)
        canvases.append(
            raster(
                ("first", "second")[place], values.reshape(count, count),
                (-half, -half, half, half),
                sheet.shape("crosses", [(0, 0)], "bad", "measured"),
                sheet.shape(
                    "crosses", flown.offsets_from(found.pixel, exact), "truth", "truth", below=True
                ), unit="px",
            )
        )  # fmt: skip
        rays.append(OrientedRay(photo.exterior, CAMERA, photo.atmosphere))
        films.append(photo.interior.film_from_pixel(found.pixel))
        sigmas.append(found.sigma_px * PIXEL_MM)
    met = intersect(np.vstack(films), np.array(sigmas), rays)
    centres = [ray.exterior.centre for ray in rays]
    base = float(np.hypot(*(centres[1] - centres[0])[:2]))
    above = float(centres[0][2] - point.place[0, 2])
    sigma = float(np.linalg.norm(sigmas))
    figures = {"base": number(base, 0, "m")}
    if not isinstance(met, Failure):
        figures["height"] = number(met.position[2], 2, "m", point.place[0, 2])
        figures["sigma_height"] = number(float(np.sqrt(met.covariance[2, 2])), 2, "m")
    symbols = {
        "H_g": number(above, 0, "m"), "B": number(base, 0, "m"), "c": number(C_MM, 0, "mm"),
        "σ_p": number(sigma, 4, "mm"),
    }  # fmt: skip
    if "sigma_height" in figures:
        symbols["σ_Z"] = figures["sigma_height"]
    right = sheet.row(sheet.over(sheet.power("H_g", "2"), sheet.row("B", "*", "c")), "*", "σ_p")
    return tuple(canvases), figures, symbols, sheet.Equation("σ_Z", right)


def adjustment(point: FollowedPoint) -> Part:
    """The block: what is left at the point, and its error ellipse."""
    report = point.report
    frames = [
        sheet.shape("line", np.array(footprint(p, CAMERA).exterior.coords), "faint")
        for p in report.block.photos.values()
    ]
    rings = [
        sheet.shape(
            "line", sheet.ellipse(place[:2], np.diag(sigma[:2] ** 2), GROUND_TIMES), "error"
        )
        for name, place in report.surveyed_positions.items()
        for sigma in [report.surveyed_sigmas_m[name]]
        if np.isfinite(sigma[:2]).all()
    ]
    known = flown.junctions()
    key, place = str(point.number), report.surveyed_positions[str(point.number)]
    off = place[:2] - point.place[0, :2]
    low, high = known.min(axis=0) - MAP_RIM_M, known.max(axis=0) + MAP_RIM_M
    canvas = sheet.Canvas(
        "block", (float(low[0]), float(low[1]), float(high[0]), float(high[1])),
        (
            *frames, sheet.shape("crosses", known, "given"), *rings,
            sheet.shape("arrow", point.place[:, :2] + np.outer([0.0, GROUND_TIMES], off), "truth"),
            sheet.shape("dots", point.place[:, :2], "bad", "point"),
        ),
    )  # fmt: skip
    centre = point.photo.exterior.centre
    figures = {
        "adjusted_east": number(place[0], 2, "m", point.place[0, 0]),
        "adjusted_north": number(place[1], 2, "m", point.place[0, 1]),
        "sigma_plan": number(float(np.hypot(*report.surveyed_sigmas_m[key][:2])), 2, "m"),
        "centre_height": number(centre[2], 2, "m", point.true.exterior.centre[2]),
    }
    if point.residual_px is not None:
        figures["residual"] = number(point.residual_px, 2, "px")
    symbols = {
        "σ_0": number(report.sigma_nought, 3),
        "Ω": number(report.sigma_nought**2 * report.redundancy, 1),
        "r": number(report.redundancy, 0),
    }
    return (canvas,), figures, symbols, sheet.Equation("σ_0", sheet.root(sheet.over("Ω", "r")))


def ray(point: FollowedPoint) -> Part:
    """From the pixel down to the DEM."""
    photo = point.photo
    ground = object_on_ground(photo, CAMERA, point.true_pixel, DEM)[0]
    film = photo.interior.film_from_pixel(point.true_pixel)
    direction = ray_directions(film, photo.exterior, CAMERA, photo.atmosphere)[0]
    plan = direction[:2] / max(float(np.hypot(*direction[:2])), 1e-9)
    reach = 60.0
    along = np.linspace(-reach, reach, 61)
    profile = ground[:2] + along[:, None] * plan
    slope = float(direction[2] / max(float(np.hypot(*direction[:2])), 1e-9))
    level = float(ground[2])
    true = float((point.place[0, :2] - ground[:2]) @ plan)
    canvas = sheet.Canvas(
        "section", (-reach, level - 12, reach, level + 30),
        (
            sheet.shape("line", np.column_stack([along, DEM.heights(profile)]), "ground", "dem"),
            sheet.shape("line", [(-reach, level - slope * reach), (0, level)], "ray", "ray"),
            sheet.shape("dots", [(0, level)], "bad", "met"),
            sheet.shape("crosses", [(true, point.place[0, 2])], "truth", "truth", below=True),
        ),
        equal=False,
    )  # fmt: skip
    centre = photo.exterior.centre
    figures = {
        "ground_east": number(ground[0], 2, "m", point.place[0, 0]),
        "ground_north": number(ground[1], 2, "m", point.place[0, 1]),
        "ground_height": number(level, 2, "m", point.place[0, 2]),
    }
    symbols = {
        "E": number(ground[0], 2, "m"), "E_0": number(centre[0], 2, "m"),
        "H": number(level, 2, "m"), "H_0": number(centre[2], 2, "m"),
        "u": number(direction[0], 5), "w": number(direction[2], 5),
    }  # fmt: skip
    drop = ["fence", sheet.row("H", "−", "H_0")]
    right = sheet.row("E_0", "+", drop, "*", sheet.over("u", "w"))
    return (canvas,), figures, symbols, sheet.Equation("E", right)


def ortho(point: FollowedPoint) -> Part:
    """The scan laid on the DEM, beside the ground as it truly was."""
    grid = grid_about(point.place[0], ORTHO_HALF_PX, ORTHO_M)
    values = flown.rectify_scan(point.photo, grid, point.true, point.given)
    truth = flown.paint_ground(flown.plan_of(grid), point.given.changed, point.given.seed).reshape(
        values.shape
    )
    shown = object_on_ground(point.photo, CAMERA, point.true_pixel, DEM)[:, :2]
    off, half = shown[0] - point.place[0, :2], grid.columns * ORTHO_M / 2
    window = (-half, -half, half, half)
    canvases = (
        raster(
            "ortho", values, window, sheet.shape("crosses", [(0, 0)], "truth", "truth"),
            sheet.shape("dots", [off], "bad", "point", below=True),
        ),
        raster("ground", truth, window, sheet.shape("crosses", [(0, 0)], "given")),
    )  # fmt: skip
    at, exact = grid.grid_from_object(np.vstack([shown, point.place[:, :2]]))
    figures = {
        "ortho_column": number(at[0], 1, "px", exact[0]),
        "ortho_row": number(at[1], 1, "px", exact[1]),
    }
    symbols = {
        "s": number(at[0], 1), "E": number(shown[0, 0], 2, "m"), "E_W": number(grid.west, 2, "m"),
        "g": number(ORTHO_M, 1, "m"),
    }  # fmt: skip
    right = sheet.over(sheet.row("E", "−", "E_W"), "g")
    return canvases, figures, symbols, sheet.Equation("s", right)


def mosaic(point: FollowedPoint) -> Part:
    """Which photo shows the point in the mosaic, and how wrong it may be there."""
    labelled, names = flown.seams(point.given)
    grid = labelled.grid
    column, row = np.floor(grid.grid_from_object(point.place[:, :2])[0]).astype(int)
    label = int(labelled.labels[row, column])
    west, south, east, north = grid.bounds
    tones = np.where(labelled.labels < 0, 0.0, 2.0 + labelled.labels)
    nadirs = [photo.exterior.centre[:2] for photo in point.report.block.photos.values()]
    # Where no photo shows the point there is no ray to it, and nothing to say of it.
    rays = [sheet.shape("line", [nadirs[label], point.place[0, :2]], "ray")] if label >= 0 else []
    canvas = raster(
        "mosaic", tones, (west, south, east, north),
        *(
            sheet.shape("crosses", [place], "given", number=number(count, 0))
            for count, place in enumerate(nadirs, 1)
        ),
        *rays, sheet.shape("dots", point.place[:, :2], "bad", "point"),
    )  # fmt: skip
    error = float(DEM.heights(point.place[:, :2])[0] - point.place[0, 2])
    figures = {"dem_error": sheet.Number(error, 2, "m", secret=True)}
    symbols = {"c": number(C_MM, 0, "mm")}
    right = sheet.row(sheet.over("r", "c"), "*", "Δh")
    equation = sheet.Equation("d", right)
    if label < 0:
        return (canvas,), figures, symbols, equation
    close, shown, radius_mm = tile(point, names[label])
    figures = {
        "photo": number(label + 1, 0),
        "mosaic_east": number(shown[0], 2, "m", point.place[0, 0]),
        "mosaic_north": number(shown[1], 2, "m", point.place[0, 1]),
    } | figures
    return (canvas, close), figures, symbols | {"r": number(radius_mm, 1, "mm")}, equation


def tile(point: FollowedPoint, name: str) -> tuple[sheet.Canvas, Position, float]:
    """The mosaic about the point from a photo, where that shows it, and its radius there, mm."""
    photo, true = point.report.block.photos[name], flown.true_flight(point.given.seed).photos[name]
    pixel = true.pixel_from_object(point.place, CAMERA)
    shown = object_on_ground(photo, CAMERA, pixel, DEM)[0]
    near = grid_about(point.place[0], ORTHO_HALF_PX, ORTHO_M)
    values = flown.rectify_scan(photo, near, true, point.given)
    half = near.columns * ORTHO_M / 2
    close = raster(
        "tile", values, (-half, -half, half, half),
        sheet.shape("crosses", [(0, 0)], "truth", "truth"),
        sheet.shape("dots", [shown[:2] - point.place[0, :2]], "bad", "point", below=True),
    )  # fmt: skip
    return close, shown, float(np.hypot(*photo.interior.film_from_pixel(pixel)[0]))


STEPS: tuple[Callable[[FollowedPoint], Part], ...] = (
    scan, interior, corrections, search, control, neighbours, adjustment, ray, ortho, mosaic,
)  # fmt: skip


def view(state: sheet.State) -> sheet.View:
    """The picture of a step."""
    step = STEPS[int(state["step"]) - 1]
    given = Given(state["changed"] / 100, int(state["seed"]))
    point = FollowedPoint(int(state["point"]) - 1, given)
    canvases, figures, symbols, equation = step(point)
    return sheet.View(figures, canvases, symbols, step=step.__name__, equations=(equation,))


def ask(rng: np.random.Generator) -> sheet.Asked:
    """How far a wrong height of the DEM moves the point in the mosaic."""
    radius, error = float(rng.integers(4, 16) * 10), float(rng.integers(1, 9))
    c_mm = float(rng.choice([152, 210, 300]))
    moved = ground_displacement_m(radius, error, c_mm)
    return sheet.Asked({"r": radius, "h": error, "c": c_mm}, moved)


LESSON = sheet.Lesson(
    "chain",
    "l",
    (
        sheet.Slider("step", 1, len(STEPS), 1, 1),
        sheet.Slider("point", 1, len(flown.junctions()), 1, 1),
        sheet.Slider("changed", 0, 100, 60, 10, "%"),
        sheet.SEED,
    ),
    view,
    (sheet.Equation("g", sheet.row("p", "*", "m")),),
    (sheet.Question("height", "m", 0.15, ask, 2),),
    hides_truth=True,
)
