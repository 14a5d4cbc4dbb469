"""A tilted photo: its three points, the scale along the tilt, what tilt and relief displace."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64

from app.lessons import sheet, space
from app.lessons.photo import HALF_MM, camera_with, tilted_at, vertical_at
from core.arrays import FilmPoints, ObjectPoints, Scalars
from core.geometry.collinearity import film_from_object, object_from_film
from core.geometry.exterior import ExteriorOrientation
from core.geometry.image_corrections import (
    isocentre_on_film,
    nadir_on_film,
    relief_displacement_mm,
    tilt_displacement_mm,
)

ABOVE_M = 1500.0
"""Flying height above the foot of the tower."""
SIDE_M = 250.0
LEVELS = (1, 4, 16, 64)
"""Squares are so many times larger where the next smaller ones would be too narrow to be seen."""
NARROW_MM = 5.0
ALONG_M = 125 * np.sinh(np.linspace(-8, 8, 161))
"""Places along a line of the ground, ever farther apart."""
LINES = np.arange(-24, 25)
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
    # To the right as on the film at first: towards the horizon.
    scales = scale_numbers(-reach[:, None] * down, exterior, c)
    shown = (scales > 0) & (scales < 6 * ABOVE_M / c * 1000)
    points = {"principal": np.zeros(2), "isocentre": iso, "nadir": nadir}
    tower = seen_tower(state, exterior)
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
            *(tower.shapes() if tower else ()),
            sheet.shape("dots", [(state["x"], state["y"])], "ray", "foot", handle=("x", "y")),
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
    at = -float(down @ iso)
    plot = sheet.Plot(
        "along",
        "scale",
        (sheet.curve("scale", reach[shown], scales[shown]),),
        (at, figures["scale_i"].value),
    )
    symbols = {"n": figures["nadir"], "i": found, "Z_O": sheet.Number(ABOVE_M, 0, "m")}
    if tower:
        figures |= tower.figures()
        symbols |= tower.symbols()
    warning = "" if tower else "sky"
    return sheet.View(figures, (scene(exterior, c, tower), film), symbols, plot, warning=warning)


@dataclass(frozen=True, slots=True, eq=False)
class Tower:
    """A tower on a tilted photo, and what displaces its images."""

    ground: ObjectPoints
    """Foot and top, metres."""
    film: FilmPoints
    """Their images, millimetres."""
    vertical: FilmPoints
    """Where a vertical photo from the same place shows the foot, about the same isocentre."""
    iso: Scalars
    """The isocentre on the film, millimetres."""
    nadir: Scalars
    """The nadir on the film, millimetres."""
    azimuth: float
    """Of the foot about the isocentre, from the line towards the horizon, radians."""
    by_tilt: float
    """Displacement of the foot outwards from the isocentre by the formula, millimetres."""
    by_relief: float
    """Displacement of the top outwards from the nadir by the formula, millimetres."""

    def radius(self, place: int, origin: Scalars) -> float:
        """Distance of an image (0 foot, 1 top) from a point of the film, millimetres."""
        return float(np.hypot(*(self.film[place] - origin)))

    def shapes(self) -> list[sheet.Shape]:
        """Both displacements as the formulas have them; the foot of a vertical photo is truth."""
        away = [
            (self.film[place] - origin) / max(self.radius(place, origin), 1e-9)
            for place, origin in enumerate((self.iso, self.nadir))
        ]
        foot, top = self.film
        start, lean = foot - self.by_tilt * away[0], top - self.by_relief * away[1]
        return [
            sheet.shape("arrow", [start, foot], "second", "by_tilt"),
            sheet.shape("arrow", [lean, top], "bad", "by_relief"),
            sheet.shape("dots", self.vertical, "truth", "vertical", below=True),
        ]

    def figures(self) -> dict[str, sheet.Number]:
        """Both displacements, with what collinearity says."""
        foot, top = self.film
        by_tilt = self.radius(0, self.iso) - float(np.hypot(*(self.vertical[0] - self.iso)))
        by_relief = float(np.hypot(*(top - foot)))
        return {
            "by_tilt": sheet.Number(self.by_tilt, 2, "mm", by_tilt),
            "by_relief": sheet.Number(self.by_relief, 2, "mm", by_relief),
        }

    def symbols(self) -> dict[str, sheet.Number]:
        """Values of their formulas."""
        figures = self.figures()
        return {
            "r_I": sheet.Number(self.radius(0, self.iso), 2, "mm"),
            "α": sheet.Number(float(np.degrees(self.azimuth)), 1, "°"),
            "r_N": sheet.Number(self.radius(1, self.nadir), 2, "mm"),
            "Δr_t": figures["by_tilt"],
            "Δr_h": figures["by_relief"],
        }


def seen_tower(state: sheet.State, exterior: ExteriorOrientation) -> Tower | None:
    """The tower whose foot is shown at a place of the film; none in the sky or behind."""
    c, tilt = state["c"], max(float(np.radians(state["t"])), 1e-6)
    camera, film = camera_with(c), np.array([[state["x"], state["y"]]])
    iso, nadir = isocentre_on_film(exterior, c), nadir_on_film(exterior, c)
    away, up = (film - iso)[0], -nadir[0]
    azimuth = float(np.arctan2(up[0] * away[1] - up[1] * away[0], up @ away))
    radius = np.hypot(away[:1], away[1:])
    if radius[0] * np.sin(tilt) * np.cos(azimuth) > 0.999 * c:
        return None
    foot, middle = object_from_film(np.vstack([film, iso]), np.zeros(2), exterior, camera)
    ground = np.array([foot, foot + np.array([0, 0, state["h"]])])
    shown = film_from_object(ground, exterior, camera)
    if not np.isfinite(shown).all():
        return None
    straight = vertical_at(0.0, ABOVE_M)
    plain = film_from_object(np.array([foot, middle]), straight, camera)
    leans = relief_displacement_mm(
        np.hypot(*(shown[1:] - nadir).T), np.array([state["h"]]), ABOVE_M
    )
    moved = tilt_displacement_mm(radius, np.array([azimuth]), tilt, c)
    vertical = plain[:1] - plain[1:] + iso
    return Tower(
        ground, shown, vertical, iso[0], nadir[0], azimuth, float(moved[0]), float(leans[0])
    )


def ground_squares(exterior: ExteriorOrientation, c: float, edge: float) -> list[sheet.Shape]:
    """Squares of the ground as the photo shows them, up to where they are too narrow."""
    camera = camera_with(c)
    found: list[sheet.Shape] = []
    for times in LEVELS:
        side = times * SIDE_M
        # What a larger square has as well, that draws.
        own = LINES if times == LEVELS[-1] else LINES[LINES % 4 != 0]
        at, along = np.meshgrid(own * side, ALONG_M, indexing="ij")
        for order in ((0, 1), (1, 0)):
            plan = np.stack([at, along], axis=-1)[..., order].reshape(-1, 2)
            here, east, north = (
                film_from_object(
                    np.column_stack([plan + step, np.zeros(len(plan))]), exterior, camera
                )
                for step in (np.zeros(2), np.array([side, 0]), np.array([0, side]))
            )
            gaps = [np.linalg.norm(one - here, axis=1) for one in (east, north)]
            # Beyond the drawing, so that a line ends nowhere within it.
            seen = (np.minimum(*gaps) > NARROW_MM) & (np.abs(here).max(axis=1) < 3 * edge)
            found += straight_lines(here.reshape(*at.shape, 2), seen.reshape(at.shape))
    return found


def straight_lines(
    film: Float64[np.ndarray, "lines points 2"], seen: Bool[np.ndarray, "lines points"]
) -> list[sheet.Shape]:
    """Rows of film points that lie on a line each, from the first to the last that is seen."""
    rows = np.flatnonzero(seen.sum(axis=1) > 1)
    first, last = seen[rows].argmax(axis=1), seen[rows, ::-1].argmax(axis=1)
    ends = np.stack([film[rows, first], film[rows, seen.shape[1] - 1 - last]], axis=1)
    return [sheet.shape("line", both, "faint") for both in ends]


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


def scene(exterior: ExteriorOrientation, c: float, tower: Tower | None) -> sheet.Canvas:
    """The photo above level ground, with plumb line, axis, the line between them, and the tower."""
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
            *(tower_in_space(tower, exterior) if tower else ()),
        ),
    )


def tower_in_space(tower: Tower, exterior: ExteriorOrientation) -> list[sheet.Shape]:
    """The tower and the rays of its foot and top."""
    return [
        *space.rays(exterior.centre, tower.ground),
        sheet.shape("line", tower.ground, "given", "tower"),
    ]


def ask(rng: np.random.Generator) -> sheet.Asked:
    """The nadir of a photo tilted a little."""
    c, tilt = float(rng.choice([100, 152, 210, 300])), float(rng.integers(2, 41)) / 4
    nadir = nadir_on_film(tilted_at(ABOVE_M, float(np.radians(tilt)), 0.0), c)
    return sheet.Asked({"c": c, "t": tilt}, float(np.hypot(*nadir[0])))


ALONG = ("*", "sin", "t", "*", "cos", "α")
LESSON = sheet.Lesson(
    "tilt",
    "c",
    (
        sheet.Slider("t", 0, 60, 20, 0.5, "°", "t"),
        sheet.Slider("direction", 0, 355, 0, 5, "°"),
        sheet.Slider("c", 85, 310, 152, 1, "mm", "c"),
        sheet.Slider("h", 0, 500, 200, 10, "m", "h"),
        sheet.Slider("x", -115, 115, 70, 1, "mm", moved_in="film"),
        sheet.Slider("y", -115, 115, 60, 1, "mm", moved_in="film"),
    ),
    view,
    (
        sheet.Equation("n", sheet.row("c", "*", "tan", "t")),
        sheet.Equation("i", sheet.row("c", "*", "tan", sheet.over("t", "2"))),
        sheet.Equation(
            "Δr_t",
            sheet.row(
                "−",
                sheet.over(
                    sheet.row(sheet.power("r_I", "2"), *ALONG),
                    sheet.row("c", "−", "r_I", *ALONG),
                ),
            ),
        ),
        sheet.Equation("Δr_h", sheet.over(sheet.row("r_N", "*", "h"), "Z_O")),
    ),
    (sheet.Question("nadir", "mm", 0.3, ask),),
    hides_truth=True,
)
