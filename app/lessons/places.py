"""Matching on real places of a flight: template and window laid by hand, by every operator."""

import os
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import cast

import cv2
import numpy as np

from app.experiments import Ground, open_ground
from app.lessons import sheet
from app.lessons.matching import likeness_told
from core.arrays import Mask
from core.literature.common_grid import (
    Band,
    GridPair,
    Places,
    built_up,
    grid_about,
    lay_on_grid,
    roads_on_grid,
    sizes_px,
)
from core.literature.detectors import is_installed
from core.literature.one_window import (
    FROM_SCAN,
    GridPatch,
    Kind,
    OperatorSearch,
    Sizes,
    Way,
    WindowScores,
)
from core.literature.published_chains import PublishedOptions
from core.matching.patches import OpenPhoto
from core.matching.peaks import Image, detect_peaks
from core.synthetic.archive import make_block
from core.synthetic.options import SyntheticOptions
from core.synthetic.truth import WRONG_M
from sessions.atomic_write import clean_leftovers, whole_folder
from sessions.products import digest_of

NAMES = ("ncc", "sift", "surf", "orb", "cfog", "gradient", "fused", "ncc-high-pass")
"""Operators by the number of the choice; the last two are the engine's own."""
WAYS: tuple[Way, ...] = ("hand", "d", "dd", "vd", "vdd", "k")
BANDS: tuple[Band, ...] = ("grey", "green", "nearest")
REACH_M, ROOM_M = 130.0, 60.0
"""The pictures reach so far from a junction, template and window are dragged so far, metres."""
# Fields, woods and houses are among so many; each is read once before the lesson opens.
PLACES = 9
# The best and its rivals, few enough to tell apart at a glance.
SHOWN = 5
# A road is as wide: nearer peaks show one detail.
APART_M = 5.0
"""Peaks nearer to each other than this are one, metres."""
Frame = tuple[float, float, float, float]
"""Left, lower, right, upper edge, metres."""
FLIGHT = SyntheticOptions("small", strips=1, photos_per_strip=2, scan_pixel_um=100.0)
"""Two photos of a sixth of the demo's area: made in ten seconds."""


@dataclass(frozen=True, slots=True, eq=False)
class ShownJunction:
    """A place as scan and ortho show it at one resolution."""

    ground: Ground
    """The flight."""
    opened: OpenPhoto
    """The photo."""
    pair: GridPair
    """Both pictures; the junction is in the middle."""
    roads: Image
    """Drawn roads."""
    built: Mask
    """Built-up land."""

    @property
    def middle(self) -> float:
        """Grid point of the junction, in both directions."""
        return len(self.pair.archival) / 2

    @property
    def gsd_m(self) -> float:
        """Ground sample distance, metres."""
        return self.pair.grid.ground_sample_distance_m

    def grid_point(self, east_m: float, north_m: float) -> Places:
        """Grid point of a place beside the junction, (1, 2)."""
        return np.array([[east_m, -north_m]]) / self.gsd_m + self.middle

    def metres(self, places: Places) -> np.ndarray:
        """East and north of the junction of grid points, metres."""
        return (places - self.middle) * [self.gsd_m, -self.gsd_m]

    @property
    def frame(self) -> Frame:
        """What the pictures cover about the junction, to the outer edges of their pixels."""
        grid = self.pair.grid
        low, high = self.metres(np.array([[0.0, grid.rows], [grid.columns, 0.0]])).tolist()
        return (low[0], low[1], high[0], high[1])

    def shown_at(self, places: Places) -> Places:
        """Grid points of the ortho at which lies what the scan truly shows at grid points."""
        grid, truth = self.pair.grid, self.ground.truth
        shown, pixels = grid.object_from_grid(places), self.pair.scan_pixels(places)
        # Where the ground is decides its height, and its height where it is.
        for _ in range(2):
            flat = np.column_stack([shown, self.ground.reference.dem.heights(shown)])
            heights = truth.heights_at(flat)
            shown = truth.ground_of(self.opened.photo.photo_id, pixels, heights)
        return grid.grid_from_object(shown)

    def true_place(self, template: GridPatch, way: Way) -> Places:
        """Where the template really lies in the other picture, a grid point."""
        if way in FROM_SCAN:
            return self.shown_at(template.place)
        # What the georeference is off changes little over some metres.
        place = template.place
        for _ in range(3):
            place = place - (self.shown_at(place) - template.place)
        return place


class LessonGround:
    """The ground of the lesson, opened once, and its places."""

    def __init__(self, folder: Callable[[], Path]) -> None:
        self._folder = folder
        self._lock = threading.Lock()
        self._opened: tuple[Ground, list[tuple[OpenPhoto, int]]] | None = None
        self.site = lru_cache(maxsize=32)(self._site)

    def opened(self) -> tuple[Ground, list[tuple[OpenPhoto, int]]]:
        """Ground, and photo and junction of each place.

        Raises:
            PhotogrammetryError: The block cannot be used, or shows no junction well.
        """
        with self._lock:
            if self._opened is None:
                ground = open_ground(self._folder())
                self._opened = ground, visible_junctions(ground)
            return self._opened

    def _site(self, number: int, gsd_m: float, band: Band) -> ShownJunction:
        ground, places = self.opened()
        opened, junction = places[number % len(places)]
        return site_of(ground, opened, junction, gsd_m, band)


def site_of(
    ground: Ground, opened: OpenPhoto, junction: int, gsd_m: float, band: Band = "grey"
) -> ShownJunction:
    """A junction and what is around it."""
    grid = grid_about(ground.junctions[junction], round(REACH_M / gsd_m), gsd_m)
    reference = ground.reference
    pair = lay_on_grid(opened, reference.ortho, reference.dem, grid, 0.0, band)
    return ShownJunction(
        ground, opened, pair, roads_on_grid(reference, grid), built_up(ground.roads, grid)
    )


def visible_junctions(ground: Ground) -> list[tuple[OpenPhoto, int]]:
    """Junctions that photos show with all their surroundings, those in the middle first.

    Raises:
        LessonError: There is none.
    """
    found: list[list[tuple[OpenPhoto, int]]] = []
    for opened in ground.photos:
        pixels = opened.photo.pixel_from_object(ground.junctions, opened.camera)
        # A grid of pixels of the coarsest resolution tells it as well.
        room = REACH_M * 2**0.5 / opened.ground_pixel_m
        size = np.array(opened.photo.size_px)
        inside = ((pixels > room) & (pixels < size - room)).all(axis=1)
        order = np.argsort(np.linalg.norm(pixels - size / 2, axis=1))
        found.append(
            [
                (opened, junction)
                for junction in order[np.isin(order, np.flatnonzero(inside))].tolist()
                if site_of(ground, opened, junction, 2.0).pair.seen.all()
            ][:PLACES]
        )
    turns = range(max((len(own) for own in found), default=0))
    mixed = [own[turn] for turn in turns for own in found if turn < len(own)][:PLACES]
    if not mixed:
        raise sheet.LessonError(
            ground.truth.folder,
            "no photo shows a road junction with {reach} m around it.",
            "Name another block with truth, such as one of `gruber demo`.",
            reach=round(REACH_M),
        )
    return mixed


def cache_folder() -> Path:
    """What can be made again lies here."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "gruber"


def teaching_flight() -> Path:
    """The teaching flight, in the user's cache; made where it is not there.

    Raises:
        StorageError: It cannot be written.
    """
    cache = cache_folder()
    folder = cache / f"teach-{digest_of('teach', 1, FLIGHT)[:12]}"
    clean_leftovers(cache)
    if not folder.is_dir():
        # Whoever makes it at the same time makes the same.
        with whole_folder(folder) as temporary:
            make_block(temporary, FLIGHT)
    return folder


@dataclass(frozen=True, slots=True, eq=False)
class PatchSearch:
    """What a state of the sliders finds."""

    site: ShownJunction
    """Where."""
    name: str
    """Operator."""
    way: Way
    """How."""
    sizes: Sizes
    """Patch and search, pixels."""
    centre: Places
    """Middle of the window, (1, 2)."""
    template: GridPatch | None
    """What is sought, if a point is there."""
    likeness: WindowScores
    """How alike the places of the window are."""
    measure: tuple[Kind, float] = ("likeness", 1.0)
    """What that is, and by what its scores are multiplied to be that."""

    @property
    def half_m(self) -> float:
        """How far the window reaches, metres."""
        return self.sizes.half * self.site.gsd_m

    def from_centre(self, places: Places) -> np.ndarray:
        """East and north of the window's middle, metres."""
        return self.site.metres(places) - self.site.metres(self.centre)


def seek(flight: LessonGround, state: sheet.State) -> PatchSearch:
    """Template and window where the sliders put them, and the likeness in it."""
    gsd, way = state["gsd"], WAYS[int(state["way"]) - 1]
    site = flight.site(int(state["place"]) - 1, gsd, BANDS[int(state["band"]) - 1])
    name = NAMES[int(state["operator"]) - 1]
    window = state["size"] + 2 * state["half"]
    options = PublishedOptions(gsd_m=gsd, template=state["size"], window=window)
    sizes = Sizes(*sizes_px(options))
    land = site.built if state["built"] else None
    room = np.array([REACH_M - gsd - sizes.inner * gsd, REACH_M - gsd - window / 2])
    places = [
        site.grid_point(*np.clip([state[f"{end}x"], state[f"{end}y"]], -most, most))
        for end, most in zip("tw", room, strict=True)
    ]
    centre = np.floor(places[1]) + 0.5
    nothing = WindowScores(np.zeros((0, 2)), np.zeros(0), None)
    if not is_installed(name):
        return PatchSearch(site, name, way, sizes, centre, None, nothing)
    search = OperatorSearch(name, way, site.pair, sizes, land, site.roads)
    template = search.template_at(places[0])
    likeness = nothing if template is None else search.likeness(template, centre)
    return PatchSearch(site, name, way, sizes, centre, template, likeness, search.measure)


def view_of(flight: LessonGround, state: sheet.State) -> sheet.View:
    """Scan, ortho and likeness, with the peaks."""
    found = seek(flight, state)
    site, way = found.site, found.way
    peaks = best_places(found)
    true = None if found.template is None else site.true_place(found.template, way)
    figures = figures_of(found, peaks, true)
    if state["built"]:
        figures["built"] = sheet.Number(100 * float(site.built.mean()), 0, "%")
    own, other = ("scan", "ortho") if way in FROM_SCAN else ("ortho", "scan")
    shapes = {own: template_shapes(found, state), other: window_shapes(found, peaks, true)}
    if state["built"]:
        rings = outlines(site)
        for name in shapes:
            shapes[name] = [*rings, *shapes[name]]
    canvases = [
        sheet.Canvas(name, site.frame, tuple(shapes[name]), picture=picture)
        for name, picture in zip(("scan", "ortho"), pictures_of(site), strict=True)
    ]
    canvases.append(likeness_canvas(found, peaks, true))
    side = 2 * found.sizes.half + 1
    # Of detected points only some are compared: the formula has no numbers then.
    symbols = {
        "h": sheet.Number(found.sizes.half, 0, "px"),
        "N": sheet.Number(side**2, 0),
    }
    if found.likeness.surface is None:
        symbols = {}
    return sheet.View(figures, tuple(canvases), symbols, profile_of(found))


@lru_cache(maxsize=32)
def pictures_of(site: ShownJunction) -> tuple[sheet.CanvasPicture, sheet.CanvasPicture]:
    """Scan and ortho, coded once for as long as a place is looked at."""
    pair, frame = site.pair, site.frame
    return sheet.picture(pair.archival, frame), sheet.picture(pair.reference, frame)


def best_places(found: PatchSearch) -> Places:
    """The most alike places, best first: peaks of the surface, or detected points."""
    likeness, apart = found.likeness, max(1, round(APART_M / found.site.gsd_m))
    if likeness.surface is None:
        ranked = likeness.places[np.argsort(-likeness.scores, kind="stable")]
        # A point that is detected in two sizes or directions is one place.
        _, first = np.unique(np.round(ranked), axis=0, return_index=True)
        return ranked[np.sort(first)[:SHOWN]]
    low = np.floor(found.centre[0]) - found.sizes.half
    peaks = detect_peaks(likeness.surface, SHOWN, apart)
    others = np.array([[peak.column, peak.row] for peak in peaks]).reshape(-1, 2) + low + 0.5
    # The best pixel is taken even at the rim, as the thesis does.
    away = np.linalg.norm(others - likeness.best, axis=1)
    return np.vstack([likeness.best, others[away > apart]])[:SHOWN]


def figures_of(found: PatchSearch, peaks: Places, true: Places | None) -> dict[str, sheet.Number]:
    """Likeness of the best and the second, and how the truth ranks."""
    likeness, gsd = found.likeness, found.site.gsd_m
    figures = {"compared": sheet.Number(len(likeness.places), 0)}
    if not len(peaks) or true is None:
        return figures

    def at(place: np.ndarray) -> float:
        nearest = np.linalg.norm(likeness.places - place, axis=1).argmin()
        return float(likeness.scores[nearest])

    for rank, place in zip(("best", "second"), peaks, strict=False):
        figures |= likeness_told(rank, at(place), found.measure)
    off = float(np.linalg.norm(peaks[0] - true)) * gsd
    figures["miss"] = sheet.Number(off, 1, "m", secret=True)
    if np.linalg.norm(likeness.places - true, axis=1).min() * gsd <= WRONG_M:
        higher = int((likeness.scores > at(true[0])).sum())
        figures["higher"] = sheet.Number(higher, 0, secret=True)
    return figures


def square(middle: np.ndarray, side_m: float) -> np.ndarray:
    """Corners of a square, closed."""
    corners = np.array(sheet.frame_of(side_m / 2))
    return middle + np.vstack([corners, corners[:1]])


def template_shapes(found: PatchSearch, state: sheet.State) -> list[sheet.Shape]:
    """The patch, and the handle that lays it."""
    laid = np.array([state["tx"], state["ty"]])
    if found.template is None:
        return [sheet.shape("dots", [laid], "estimate", handle=("tx", "ty"))]
    place = found.site.metres(found.template.place)[0]
    side = found.template.side * found.site.gsd_m
    shapes = [sheet.shape("line", square(place, side), "estimate", "template", below=True)]
    if found.template.point is not None:
        shapes.append(sheet.shape("line", [laid, place], "estimate"))
        return [*shapes, sheet.shape("dots", [laid], "estimate", handle=("tx", "ty"))]
    return [*shapes, sheet.shape("dots", [place], "estimate", handle=("tx", "ty"))]


def window_shapes(found: PatchSearch, peaks: Places, true: Places | None) -> list[sheet.Shape]:
    """The window, its handle, what was found, and the truth."""
    middle = found.site.metres(found.centre)[0]
    rim = square(middle, 2 * found.half_m)
    shapes = [sheet.shape("line", rim, "second", "window", below=True)]
    if len(peaks):
        shapes.append(sheet.shape("dots", found.site.metres(peaks[:1]), "bad"))
    if true is not None:
        ring = sheet.ellipse(found.site.metres(true)[0], np.eye(2) * WRONG_M**2)
        shapes.append(sheet.shape("line", ring, "truth"))
    return [*shapes, sheet.shape("dots", [middle], "second", handle=("wx", "wy"))]


def outlines(site: ShownJunction) -> list[sheet.Shape]:
    """The rim of built-up land."""
    rings, _ = cv2.findContours(site.built.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_SIMPLE)
    return [
        sheet.shape("line", site.metres(np.vstack([ring, ring[:1]]).reshape(-1, 2) + 0.5), "error")
        for ring in rings
    ]


def likeness_canvas(found: PatchSearch, peaks: Places, true: Places | None) -> sheet.Canvas:
    """The surface of likeness in the window, or the points that were compared."""
    half, likeness = found.half_m, found.likeness
    reach = half + found.site.gsd_m / 2
    window, shapes, picture = (-reach, -reach, reach, reach), list[sheet.Shape](), None
    if likeness.surface is not None:
        picture = sheet.picture(colours_of(likeness.surface), window, ".png")
    else:
        shapes.append(sheet.shape("dots", found.from_centre(likeness.places), "faint"))
    if not is_installed(found.name):
        shapes.append(sheet.shape("text", [[-half, 0.0]], "bad", "missing"))
    elif found.template is None:
        shapes.append(sheet.shape("text", [[-half, 0.0]], "bad", "nothing"))
    shapes.append(sheet.shape("crosses", found.from_centre(peaks[1:]), "given"))
    shapes.append(sheet.shape("dots", found.from_centre(peaks[:1]), "bad", "best"))
    if true is not None:
        ring = sheet.ellipse(found.from_centre(true)[0], np.eye(2) * WRONG_M**2)
        shapes.append(sheet.shape("line", ring, "truth"))
    return sheet.Canvas("likeness", window, tuple(shapes), picture=picture)


def colours_of(surface: np.ndarray) -> np.ndarray:
    """Likeness from dark to bright, over its own range."""
    low, high = float(surface.min()), float(surface.max())
    grey = (surface - low) / max(high - low, 1e-9) * 255
    return cv2.applyColorMap(grey.astype(np.uint8), cv2.COLORMAP_VIRIDIS)


def profile_of(found: PatchSearch) -> sheet.Plot | None:
    """Likeness along the row of the best place, or of the points in the order of likeness."""
    likeness, half, (kind, times) = found.likeness, found.sizes.half, found.measure
    if likeness.surface is not None:
        row = np.unravel_index(int(likeness.surface.argmax()), likeness.surface.shape)[0]
        east = np.arange(-half, half + 1) * found.site.gsd_m
        return sheet.Plot("x", kind, (sheet.curve("row", east, times * likeness.surface[row]),))
    if len(likeness.scores) < 2:
        return None
    ranked = times * np.sort(likeness.scores)[::-1]
    ranks = np.arange(1, len(ranked) + 1)
    return sheet.Plot("rank", kind, (sheet.curve("points", ranks, ranked),))


def ask(rng: np.random.Generator) -> sheet.Asked:
    """How many places a window has."""
    half, gsd = 2.0 * float(rng.integers(5, 21)), float(rng.choice([0.5, 1.0, 2.0]))
    options = PublishedOptions(gsd_m=gsd, template=51, window=51 + 2 * half)
    _, half_px = sizes_px(options)
    return sheet.Asked({"s": half, "g": gsd}, float((2 * half_px + 1) ** 2))


def lesson_on(folder: Path) -> sheet.Lesson:
    """The lesson on a block with truth."""
    flight = LessonGround(lambda: folder)

    def view(state: sheet.State) -> sheet.View:
        return view_of(flight, state)

    return replace(LESSON, view=view, prepare=lambda: cast("None", flight.opened()))


def _handles() -> list[sheet.Slider]:
    return [
        sheet.Slider(f"{end}{axis}", -ROOM_M, ROOM_M, 0, 1, "m", moved_in="scan")
        for end in "tw"
        for axis in "xy"
    ]


_USUAL = LessonGround(teaching_flight)
LESSON = sheet.Lesson(
    "places",
    "j",
    (
        sheet.Slider("operator", 1, len(NAMES), 1, 1),
        sheet.Slider("way", 1, len(WAYS), 1, 1),
        sheet.Slider("place", 1, PLACES, 1, 1),
        sheet.Slider("size", 21, 101, 51, 2, "m"),
        sheet.Slider("half", 10, 40, 29, 1, "m"),
        sheet.Slider("gsd", 0.5, 2, 1, 0.5, "m"),
        sheet.Slider("band", 1, len(BANDS), 1, 1),
        sheet.Slider("built", 0, 1, 0, 1),
        *_handles(),
    ),
    lambda state: view_of(_USUAL, state),
    (
        sheet.Equation(
            "N",
            sheet.power(["fence", sheet.row("2", "*", "h", "+", "1")], "2"),
        ),
    ),
    (sheet.Question("places", "", 0.5, ask, 0),),
    hides_truth=True,
    order=1,
    prepare=lambda: cast("None", _USUAL.opened()),
)
