"""From film to mosaic in ten pictures: one crossroads followed through the whole chain."""

from collections.abc import Callable

import numpy as np

from app.lessons import chain_flight as flown
from app.lessons import sheet
from app.lessons.chain_flight import CAMERA, DEM, MARKS, PATCH_M, REACH_M, Found, Given
from app.lessons.flight import C_MM, SCALE
from app.lessons.photo import HALF_MM, PIXEL_MM
from core.adjustment.adjusted import AdjustmentReport
from core.arrays import Matrix, ObjectPoints, PixelPoints
from core.block import Photo, footprint
from core.doubts import Failure
from core.geometry.collinearity import EARTH_RADIUS_M
from core.geometry.image_corrections import Shift, relief_displacement_mm, shifts_at
from core.geometry.intersection import OrientedRay, intersect, ray_directions
from core.geometry.resection import PhotoModel
from core.matching.patches import object_on_ground
from core.matching.peaks import level_and_spread

TIMES, MM_TIMES = 4000.0, 1500.0
"""Residuals of marks, and corrections, are drawn so many times their size on the film."""
Part = tuple[
    tuple[sheet.Canvas, ...], dict[str, sheet.Number], dict[str, sheet.Number], sheet.Equation
]
"""Drawings, figures, values of symbols, and the formula of one step."""


class Followed:
    """The point, the photo it is followed in, and what the engine found, as far as it is asked."""

    def __init__(self, state: sheet.State) -> None:
        self.given = Given(state["changed"] / 100, int(state["seed"]))
        self.point = int(state["point"]) - 1
        self.names = flown.photos_of(self.point, self.given)
        self.name = self.names[0]
        self.true = flown.true_flight(self.given).photos[self.name]
        self.rough = flown.approximate(self.given)[self.name]
        self.place: ObjectPoints = flown.true_place(self.point, self.given)
        self.true_pixel: PixelPoints = self.true.pixel_from_object(self.place, CAMERA)

    @property
    def found(self) -> Found:
        """The search in its photo."""
        return flown.searched(self.point, self.name, self.given)

    @property
    def report(self) -> AdjustmentReport:
        """The adjusted block."""
        return flown.adjusted(self.given)

    @property
    def photo(self) -> Photo:
        """Its photo as it was adjusted."""
        return self.report.block.photos[self.name]

    def miss_px(self, name: str) -> float:
        """How far the search in a photo ended from the truth, pixels."""
        true = flown.true_flight(self.given).photos[name].pixel_from_object(self.place, CAMERA)
        return float(np.hypot(*(flown.searched(self.point, name, self.given).pixel - true)[0]))


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


def scan(f: Followed) -> Part:
    """The scan with its fiducials, and one of them from near."""
    side = f.true.size_px[0]
    middle = np.full((1, 2), side / 2)
    half = side / 2
    whole = flown.scan_values(f.true, flown.pixels_about(middle, half, 150), f.given).reshape(
        150, 150
    )
    marks = flown.measured_marks(f.name, f.given.seed)
    corner, gray = flown.mark_window(f.true, "1", f.given.seed)
    near = np.array([corner]) + gray.shape[0] / 2
    half_near = gray.shape[0] / 2
    true = f.true.interior.pixel_from_film(np.array([MARKS["1"]]))
    exact = flown.seen_from(near, true)
    canvases = (
        raster(
            "scan", whole, (-half, -half, half, half),
            sheet.shape("crosses", flown.seen_from(middle, marks), "bad"),
            sheet.shape("dots", flown.seen_from(middle, f.true_pixel), "bad", "point"), unit="px",
        ),
        raster(
            "mark", gray, (-half_near, -half_near, half_near, half_near),
            sheet.shape("line", sheet.ellipse(exact[0], 4 * np.eye(2)), "truth"),
            sheet.shape("crosses", flown.seen_from(near, marks[:1]), "bad"), unit="px",
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


def interior(f: Followed) -> Part:
    """Pixels become millimetres of film."""
    inner, pixel = f.rough.interior, f.found.pixel
    film = inner.film_from_pixel(pixel)[0]
    true = f.true.interior.film_from_pixel(pixel)[0]
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


def outwards_um(shift: Shift, film: Matrix) -> float:
    """Length of a shift on the film, negative where it points towards the middle, micrometres."""
    return 1000 * shift.sign(film[None]) * float(np.linalg.norm(shift.film_mm))


def corrections(f: Followed) -> Part:
    """What air, Earth, lens and film did to the image point."""
    height = f.place[:, 2]
    film = f.rough.interior.film_from_pixel(f.found.pixel)[0]
    parts, truth = (
        shifts_at(
            f.found.pixel,
            height,
            PhotoModel(photo.interior, CAMERA, photo.atmosphere),
            photo.exterior,
        )
        for photo in (f.rough, f.true)
    )
    looks: dict[str, sheet.Look] = {
        "refraction": "estimate", "curvature": "bad", "distortion": "second", "film": "ray",
    }  # fmt: skip
    arrows = [
        sheet.shape("arrow", [film, film + MM_TIMES * part.film_mm[0]], looks[name], name)
        for name, part in parts.items()
    ]
    edge = 1.12 * HALF_MM
    canvas = sheet.Canvas(
        "moved", (-edge, -edge, edge, edge),
        (
            sheet.shape("area", sheet.frame_of(HALF_MM), "film"),
            sheet.shape("crosses", [(0, 0)], "axis", "origin"),
            sheet.shape("line", [(0, 0), film], "faint"), *arrows,
            sheet.shape("dots", [film], "given", "point", below=True),
        ),
        "mm",
    )  # fmt: skip
    figures = {
        name: number(outwards_um(part, film), 2, "µm", outwards_um(truth[name], film))
        for name, part in parts.items()
    }
    above = float(f.rough.exterior.centre[2] - height[0])
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
    return (canvas,), figures, symbols, sheet.Equation("Δr_e", right)


def search(f: Followed) -> Part:
    """The ortho of today, and how alike the old scan is wherever it is laid."""
    found, half = f.found, PATCH_M + 0.5
    best = found.peaks[0]
    true = object_on_ground(f.rough, CAMERA, f.true_pixel, DEM)[0, :2] - f.place[0, :2]
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


def control(f: Followed) -> Part:
    """The place in the raw scan: expected, found, true."""
    found = f.found
    half, count = 90.0, 121
    values = flown.scan_values(f.true, flown.pixels_about(found.pixel, half, count), f.given)
    near = {"expected": found.expected, "measured": found.pixel, "truth": f.true_pixel}
    looks: dict[str, sheet.Look] = {"expected": "estimate", "measured": "bad", "truth": "truth"}
    marks = [
        sheet.shape(
            "crosses", flown.seen_from(found.pixel, pixel), looks[name], name, below=name == "truth"
        )
        for name, pixel in near.items()
    ]
    canvas = raster(
        "raw", values.reshape(count, count), (-half, -half, half, half), *marks, unit="px"
    )
    off = (found.pixel - found.expected)[0]
    figures = {
        "column": number(found.pixel[0, 0], 1, "px", f.true_pixel[0, 0]),
        "row": number(found.pixel[0, 1], 1, "px", f.true_pixel[0, 1]),
        "sigma_px": number(found.sigma_px, 2, "px"),
    }
    symbols = {
        "d": number(float(np.hypot(*off)), 1, "px"),
        "Δs": number(off[0], 1), "Δr": number(off[1], 1),
    }  # fmt: skip
    right = sheet.root(sheet.row(sheet.power("Δs", "2"), "+", sheet.power("Δr", "2")))
    return (canvas,), figures, symbols, sheet.Equation("d", right)


def neighbours(f: Followed) -> Part:
    """The same ground in two photos, and where their rays meet."""
    names = f.names[:2]
    half, count = 90.0, 91
    canvases: list[sheet.Canvas] = []
    rays, films, sigmas = list[OrientedRay](), list[Matrix](), list[float]()
    for place, name in enumerate(names):
        found, photo = flown.searched(f.point, name, f.given), f.report.block.photos[name]
        true = flown.true_flight(f.given).photos[name]
        values = flown.scan_values(true, flown.pixels_about(found.pixel, half, count), f.given)
        exact = true.pixel_from_object(f.place, CAMERA)
        canvases.append(
            raster(
                ("first", "second")[place], values.reshape(count, count),
                (-half, -half, half, half),
                sheet.shape("crosses", [(0, 0)], "bad", "measured"),
                sheet.shape(
                    "crosses", flown.seen_from(found.pixel, exact), "truth", "truth", below=True
                ), unit="px",
            )
        )  # fmt: skip
        rays.append(OrientedRay(photo.exterior, CAMERA, photo.atmosphere))
        films.append(photo.interior.film_from_pixel(found.pixel))
        sigmas.append(found.sigma_px * PIXEL_MM)
    met = intersect(np.vstack(films), np.array(sigmas), rays)
    centres = [ray.exterior.centre for ray in rays]
    base = float(np.hypot(*(centres[1] - centres[0])[:2]))
    above = float(centres[0][2] - f.place[0, 2])
    sigma = float(np.linalg.norm(sigmas))
    figures = {"base": number(base, 0, "m")}
    if not isinstance(met, Failure):
        figures["height"] = number(met.position[2], 2, "m", f.place[0, 2])
        figures["sigma_height"] = number(float(np.sqrt(met.covariance[2, 2])), 2, "m")
    symbols = {
        "H_g": number(above, 0, "m"), "B": number(base, 0, "m"), "c": number(C_MM, 0, "mm"),
        "σ_p": number(sigma, 4, "mm"),
    }  # fmt: skip
    right = sheet.row(sheet.over(sheet.power("H_g", "2"), sheet.row("B", "*", "c")), "*", "σ_p")
    return tuple(canvases), figures, symbols, sheet.Equation("σ_Z", right)


def adjustment(f: Followed) -> Part:
    """The block: what is left at the point, and its error ellipse."""
    report = f.report
    frames = [
        sheet.shape("line", np.array(footprint(p, CAMERA).exterior.coords), "faint")
        for p in report.block.photos.values()
    ]
    times = 600.0
    rings = [
        sheet.shape("line", sheet.ellipse(place[:2], np.diag(sigma[:2] ** 2), times), "error")
        for name, place in report.surveyed_positions.items()
        for sigma in [report.surveyed_sigmas_m[name]]
        if np.isfinite(sigma[:2]).all()
    ]
    known = flown.junctions()
    key, place = str(f.point), report.surveyed_positions[str(f.point)]
    off = place[:2] - f.place[0, :2]
    residual = report.residuals_px.get((key, f.name), (np.nan, np.nan))
    low, high = known.min(axis=0) - 2000, known.max(axis=0) + 2000
    canvas = sheet.Canvas(
        "block", (float(low[0]), float(low[1]), float(high[0]), float(high[1])),
        (
            *frames, sheet.shape("crosses", known, "given"), *rings,
            sheet.shape("arrow", [f.place[0, :2], f.place[0, :2] + times * off], "truth"),
            sheet.shape("dots", f.place[:, :2], "bad", "point"),
        ),
    )  # fmt: skip
    centre = f.photo.exterior.centre
    figures = {
        "residual": number(np.nan_to_num(float(np.hypot(*residual))), 2, "px"),
        "adjusted_east": number(place[0], 2, "m", f.place[0, 0]),
        "adjusted_north": number(place[1], 2, "m", f.place[0, 1]),
        "sigma_plan": number(float(np.hypot(*report.surveyed_sigmas_m[key][:2])), 2, "m"),
        "centre_height": number(centre[2], 2, "m", f.true.exterior.centre[2]),
    }
    symbols = {
        "σ_0": number(report.sigma_nought, 3),
        "Ω": number(report.sigma_nought**2 * report.redundancy, 1),
        "r": number(report.redundancy, 0),
    }
    return (canvas,), figures, symbols, sheet.Equation("σ_0", sheet.root(sheet.over("Ω", "r")))


def ray(f: Followed) -> Part:
    """From the pixel down to the DEM."""
    photo = f.photo
    ground = object_on_ground(photo, CAMERA, f.true_pixel, DEM)[0]
    film = photo.interior.film_from_pixel(f.true_pixel)
    direction = ray_directions(film, photo.exterior, CAMERA, photo.atmosphere)[0]
    plan = direction[:2] / max(float(np.hypot(*direction[:2])), 1e-9)
    reach = 60.0
    along = np.linspace(-reach, reach, 61)
    profile = ground[:2] + along[:, None] * plan
    slope = float(direction[2] / max(float(np.hypot(*direction[:2])), 1e-9))
    level = float(ground[2])
    true = float((f.place[0, :2] - ground[:2]) @ plan)
    canvas = sheet.Canvas(
        "section", (-reach, level - 12, reach, level + 30),
        (
            sheet.shape("line", np.column_stack([along, DEM.heights(profile)]), "ground", "dem"),
            sheet.shape("line", [(-reach, level - slope * reach), (0, level)], "ray", "ray"),
            sheet.shape("dots", [(0, level)], "bad", "met"),
            sheet.shape("crosses", [(true, f.place[0, 2])], "truth", "truth", below=True),
        ),
        equal=False,
    )  # fmt: skip
    centre = photo.exterior.centre
    figures = {
        "ground_east": number(ground[0], 2, "m", f.place[0, 0]),
        "ground_north": number(ground[1], 2, "m", f.place[0, 1]),
        "ground_height": number(level, 2, "m", f.place[0, 2]),
    }
    symbols = {
        "E": number(ground[0], 2, "m"), "E_0": number(centre[0], 2, "m"),
        "H": number(level, 2, "m"), "H_0": number(centre[2], 2, "m"),
        "u": number(direction[0], 5), "w": number(direction[2], 5),
    }  # fmt: skip
    drop = ["fence", sheet.row("H", "−", "H_0")]
    right = sheet.row("E_0", "+", drop, "*", sheet.over("u", "w"))
    return (canvas,), figures, symbols, sheet.Equation("E", right)


def ortho(f: Followed) -> Part:
    """The scan laid on the DEM, beside the ground as it truly was."""
    grid = flown.about(f.place[0, :2], 45.0, 0.5)
    values = flown.laid_on_dem(f.photo, grid, f.true, f.given)
    truth = flown.painted(flown.plan_of(grid), f.given.changed, f.given.seed).reshape(values.shape)
    shown = object_on_ground(f.photo, CAMERA, f.true_pixel, DEM)[:, :2]
    off, half = shown[0] - f.place[0, :2], grid.columns * 0.25
    window = (-half, -half, half, half)
    canvases = (
        raster(
            "ortho", values, window, sheet.shape("crosses", [(0, 0)], "truth", "truth"),
            sheet.shape("dots", [off], "bad", "point", below=True),
        ),
        raster("ground", truth, window, sheet.shape("crosses", [(0, 0)], "given")),
    )  # fmt: skip
    at, exact = grid.grid_from_object(np.vstack([shown, f.place[:, :2]]))
    figures = {
        "ortho_column": number(at[0], 1, "px", exact[0]),
        "ortho_row": number(at[1], 1, "px", exact[1]),
    }
    symbols = {
        "s": number(at[0], 1), "E": number(shown[0, 0], 2, "m"), "E_W": number(grid.west, 2, "m"),
        "g": number(0.5, 1, "m"),
    }  # fmt: skip
    right = sheet.over(sheet.row("E", "−", "E_W"), "g")
    return canvases, figures, symbols, sheet.Equation("s", right)


def mosaic(f: Followed) -> Part:
    """Which photo shows the point in the mosaic, and how wrong it may be there."""
    labelled, names = flown.seams(f.given)
    grid = labelled.grid
    column, row = np.floor(grid.grid_from_object(f.place[:, :2])[0]).astype(int)
    chosen = names[int(labelled.labels[row, column])]
    photo = f.report.block.photos[chosen]
    true = flown.true_flight(f.given).photos[chosen].pixel_from_object(f.place, CAMERA)
    shown = object_on_ground(photo, CAMERA, true, DEM)[0]
    west, south, east, north = grid.bounds
    tones = np.where(labelled.labels < 0, 0.0, 2.0 + labelled.labels)
    nadirs = {n: p.exterior.centre[:2] for n, p in f.report.block.photos.items()}
    canvas = raster(
        "mosaic", tones, (west, south, east, north),
        *(
            sheet.shape("crosses", [place], "given", number=number(names.index(n) + 1, 0))
            for n, place in nadirs.items()
        ),
        sheet.shape("line", [nadirs[chosen], f.place[0, :2]], "ray"),
        sheet.shape("dots", f.place[:, :2], "bad", "point"),
    )  # fmt: skip
    near = flown.about(f.place[0, :2], 45.0, 0.5)
    values = flown.laid_on_dem(photo, near, flown.true_flight(f.given).photos[chosen], f.given)
    half = near.columns * 0.25
    close = raster(
        "tile", values, (-half, -half, half, half),
        sheet.shape("crosses", [(0, 0)], "truth", "truth"),
        sheet.shape("dots", [shown[:2] - f.place[0, :2]], "bad", "point", below=True),
    )  # fmt: skip
    radius = float(np.hypot(*photo.interior.film_from_pixel(true)[0]))
    error = float(DEM.heights(f.place[:, :2])[0] - f.place[0, 2])
    figures = {
        "photo": number(names.index(chosen) + 1, 0),
        "mosaic_east": number(shown[0], 2, "m", f.place[0, 0]),
        "mosaic_north": number(shown[1], 2, "m", f.place[0, 1]),
        "dem_error": sheet.Number(error, 2, "m", secret=True),
    }
    symbols = {"r": number(radius, 1, "mm"), "c": number(C_MM, 0, "mm")}
    right = sheet.row(sheet.over("r", "c"), "*", "Δh")
    return (canvas, close), figures, symbols, sheet.Equation("ΔE", right)


STEPS: tuple[Callable[[Followed], Part], ...] = (
    scan, interior, corrections, search, control, neighbours, adjustment, ray, ortho, mosaic,
)  # fmt: skip


def view(state: sheet.State) -> sheet.View:
    """The picture of a step."""
    step = STEPS[int(state["step"]) - 1]
    canvases, figures, symbols, equation = step(Followed(state))
    return sheet.View(figures, canvases, symbols, step=step.__name__, equations=(equation,))


def ask(rng: np.random.Generator) -> sheet.Asked:
    """How far a wrong height of the DEM moves the point in the mosaic."""
    radius, error = float(rng.integers(4, 16) * 10), float(rng.integers(1, 9))
    c = float(rng.choice([152, 210, 300]))
    # A point at flying height c (in metres) over ground: displacements on film are those there.
    moved = relief_displacement_mm(np.array([radius]), np.array([error]), c)
    return sheet.Asked({"r": radius, "h": error, "c": c}, float(moved[0]))


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
