"""Which places in a scan are the camera's fiducials: the best-fitting set of candidates.

Every kind of mark in the library is correlated with windows about the expected places. Of all
peaks, the set is taken that lies as certified, rotated by about none to three quarter circles and
scaled by the scan pixel size. A set is accepted only if it could not be chance: the marks that did
not determine it lie too close to their places, or look too much like marks.

Corner marks and side marks may be of different kinds; all lie on one film.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Complex128, Float64

from core.arrays import FilmPoints, PixelPoints, Scalars, locked
from core.doubts import Failure
from core.geometry.transforms import PlaneTransform, apply_affine, fit_similarity
from core.raster.scan_file import ScanFile
from core.scans.candidates import (
    MERGE_MM,
    Candidates,
    SearchWindow,
    all_candidates,
    candidates_at,
    evened,
    open_windows,
)
from core.scans.centring import LEAST_RADIUS_PX, Centre, centre_by_symmetry, disc
from core.scans.chance import (
    KINDS,
    LARGEST_TURN_DEG,
    PEAKS,
    SEARCH_PIXEL_MM,
    Search,
    along_border,
    log_chance_of_border,
    log_chance_of_looks,
    log_chance_of_rectangle,
    log_chance_of_shape,
)
from core.scans.film_area import OPPOSITE, FilmArea
from core.scans.marks import Mark, library
from core.scans.naming import UPRIGHT, Layout, OpenLayout, Way
from core.scans.rectangles import Rectangles, fit_rectangles

Complexes = Complex128[np.ndarray, "n"]
PeakComplex = Complex128[np.ndarray, "n peaks"]
# design: certificate and frame differ, scans are cut off
REACH_SEEN_MM, REACH_UNSEEN_MM = 7.0, 16.0
"""Half width of a window where the picture's border was seen, and where it was not."""
LARGEST_SCALE = 0.015  # design: twice what prints and shrunk film of the Canberra archive differ by
"""How far the scale may differ from the nominal scan pixel size, as a share."""
FIT_MM = 1.0  # design: scanners shear, film shrinks, certificates are of a sister camera
"""How far a mark may lie from where two others put it."""
UNSQUARE_MM = 3.0  # design: what frames and prints of the archives looked at differ by
"""How much further out marks may lie along one axis than along the other."""
FIT_WORTH = 0.7  # design: at that distance a mark counts less than a third
"""How much less a mark counts that lies FIT_MM off."""
LEAST_BASE = 0.3  # design: a shorter base would let noise turn the set by degrees
"""Share of the longest distance between marks from which two of them are a base."""
RIVALS = 8  # design: time; the ninth set by score was never the most symmetric by far
"""Sets at different places that are compared by their symmetry."""
SEARCH_OFF_MM = 0.3  # design: four cells of the search
"""How far the middle of a mark may be from the peak that found it."""
APART_MM = 0.15  # design: two cells of the search
"""Sets whose marks lie nearer to each other than this are at the same place."""
SYMMETRY_MM = 1.5  # design: marks and their housings
"""Radius within which a mark and its housing should be symmetric."""
SHORTEST_REACH = 1.15  # design: a little more than the mark itself
"""Radius within which a mark itself should be symmetric, in its reach."""
MIN_SYMMETRY = 0.45  # design: half way between texture and a mark under scratches
"""Mean symmetry, 0 to 1, below which a set is refused."""
ASYMMETRIC_WORTH = 0.5  # design: what a good set of marks has under dirt
"""Symmetry that a kind of mark without any is credited with."""
FRAME_CORNER_MM = 1.5  # design: rounded corners, and how well they are found
"""Distance from the corner of the frame within which a notch is the corner itself."""
UPRIGHT_BONUS = 0.05  # design: more than noise changes a score, less than a lost mark
"""Advantage of an upright scan over a turned one that fits as well, as a share of the score:
the certificate of symmetric marks cannot tell them apart."""
AGREE_MM = 1.5  # design: certificates of corners and sides are measured on one plate
"""How far corner marks and marks of the sides may disagree about each other's places."""
AROUND_MM = 3.0  # design: the window must hold marks, numbers and housings whole
"""Half width of a window beyond AGREE_MM where another set says where the marks are."""
LIBRARY = library()
"""Kinds and sizes of marks that are looked for."""


@dataclass(frozen=True, slots=True, eq=False)
class Constellation:
    """The set of places that lies as a layout says."""

    names: tuple[str, ...]
    """Fiducials that were found."""
    pixels: PixelPoints
    """Where, to about a tenth of a millimetre, scan pixels."""
    correlations: Scalars
    """Correlation of each with the drawn mark."""
    predicted: Mapping[str, tuple[float, float]]
    """Where every fiducial of the layout should be, found or not, scan pixels."""
    layout: Layout
    """The layout that was found."""
    way: Way
    """How the film lies in the scan, one of those the layout can tell apart."""
    mark: Mark
    """Kind and size that fits best."""
    bright: bool
    """True when the mark is brighter than its surroundings."""
    turn: float
    """Rotation of the film's x axis against the scan's columns, radians, counter-clockwise."""
    score: float
    """Sum of the marks' significances times their correlations."""
    log_false_alarms: float
    """log10 of the number of sets as good that chance would give."""
    symmetry: float = 0.0
    """How symmetric the places are, 0 to 1."""
    kinds: tuple[Mark, ...] = ()
    """Other kinds that fit well at the same places, best first."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "pixels", locked(self.pixels))
        object.__setattr__(self, "correlations", locked(self.correlations))

    @property
    def fit(self) -> PlaneTransform | None:
        """Similarity scan from film, as it lies, through the marks that were found."""
        film = self.layout.lying(self.way)[[self.layout.names.index(name) for name in self.names]]
        fit = fit_similarity(film, self.pixels, mirrored=True)
        return fit if isinstance(fit, PlaneTransform) else None


def find_constellation(
    scan: ScanFile,
    layout: Layout | OpenLayout,
    scan_pixel_mm: float,
    area: FilmArea,
    reach_seen_mm: float = REACH_SEEN_MM,
    marks: tuple[Mark, ...] = LIBRARY,
    sure: tuple[float, float] | None = None,
    *,
    dim: bool = False,
) -> Constellation | Failure:
    """Find marks in a scan to about a tenth of a millimetre.

    Args:
        scan: The scan.
        layout: Where they lie, or in which pattern; then the frame's own corners are no marks.
        scan_pixel_mm: Nominal size of a scan pixel, millimetres.
        area: The exposed picture.
        reach_seen_mm: Half width of a window where the picture's border was seen, millimetres.
        marks: Kinds and sizes that are looked for.
        sure: Column and row at which one of them is, for somebody said so.
        dim: True to look for figures with hardly any contrast, as if it were the same all over.
    """
    certified = isinstance(layout, Layout)
    middle = layout if certified else layout.middle
    reach_mm = _reach_mm(area, reach_seen_mm, both=not certified or sure is not None)
    reaches_mm = reach_mm + (np.zeros_like(middle.film) if certified else layout.spread_mm)
    ways = middle.ways
    border = area if area.trusted and certified else None
    area_mm2, kept = float(np.prod(2 * reaches_mm[0])), min(KINDS, len(marks))
    search = Search(
        scan_pixel_mm, scan.size_px, area_mm2, len(ways), certified, border, kept, sure is not None,
        dim,
    )  # fmt: skip
    lies = {k: middle.lying(way) for k, way in enumerate(ways)}
    expected = {k: expected_places(film, area, scan_pixel_mm) for k, film in lies.items()}
    column, row = area.centre[0].tolist()
    windows, owners = open_windows(
        scan, expected, (column, row), reaches_mm / scan_pixel_mm, MERGE_MM / scan_pixel_mm,
        max(1, round(SEARCH_PIXEL_MM / scan_pixel_mm)),
    )  # fmt: skip
    if dim:
        windows = [evened(window, scan_pixel_mm * window.reduction) for window in windows]
    kinds = all_candidates(windows, scan_pixel_mm * windows[0].reduction, PEAKS, marks, area.turn)
    if sure is not None:
        kinds = [candidates_at(sure, kind, windows) for kind in kinds]
    kinds.sort(key=lambda kind: kind.promise, reverse=True)
    sets = [
        _best_set(search, kind, owners[k], layout, way)
        if isinstance(layout, Layout)
        else _best_rectangle(search, kind, owners[k], layout)
        for kind in _promising(kinds, KINDS)
        for k, way in enumerate(ways)
    ]
    found = [chosen for chosen in sets if chosen is not None]
    return _chosen(found, windows, search, area)


def _reach_mm(area: FilmArea, reach_seen_mm: float, *, both: bool) -> Float64[np.ndarray, "2"]:
    """Half width and half height of windows; of `both`, a direction is seen at its two sides."""
    if not both:
        return np.full(2, reach_seen_mm if area.trusted else REACH_UNSEEN_MM)
    # A border that is seen at one side only may be another edge of the film.
    seen = np.array([set(pair) <= set(area.seen) for pair in OPPOSITE])
    return np.where(area.trusted & seen, reach_seen_mm, REACH_UNSEEN_MM)


def _promising(kinds: Sequence[Candidates], count: int) -> list[Candidates]:
    """The best of kinds that are sorted by their promise, and the best of every shape."""
    firsts: dict[tuple[str, bool], Candidates] = {}
    for kind in kinds:
        firsts.setdefault((kind.mark.shape, kind.bright), kind)
    tried = list(kinds[:count])
    return tried + [kind for kind in firsts.values() if not any(kind is one for one in tried)]


def _chosen(
    found: Sequence[Constellation],
    windows: Sequence[SearchWindow],
    search: Search,
    area: FilmArea,
) -> Constellation | Failure:
    """Of all sets that are not chance the one that is most like marks."""
    sound = [c for c in found if c.log_false_alarms < search.most_chance]
    if not search.certified:
        limit_px = FRAME_CORNER_MM / search.scan_pixel_mm
        sound = [c for c in sound if not _is_border(c, area, limit_px)]
        sound = [c for c in sound if not _is_edge(c, search.size_px)]
    sound.sort(key=lambda chosen: chosen.score, reverse=True)
    rivals = _rivals(sound, APART_MM / search.scan_pixel_mm)[:RIVALS]
    symmetries = [_symmetry(rival, windows, search) for rival in rivals]
    if max(symmetries, default=0.0) < MIN_SYMMETRY:
        return Failure(
            "No set of marks lies as the certificate says.",
            {
                "log_false_alarms": min((c.log_false_alarms for c in found), default=None),
                "symmetry": max(symmetries, default=None),
            },
        )
    worth = [rival.score * value for rival, value in zip(rivals, symmetries, strict=True)]
    best = int(np.argmax(worth))
    kinds = _other_kinds(rivals[best], sound, APART_MM / search.scan_pixel_mm)
    return replace(rivals[best], symmetry=symmetries[best], kinds=kinds)


def _other_kinds(
    best: Constellation, sets: Sequence[Constellation], apart_px: float
) -> tuple[Mark, ...]:
    """Kinds of sets of the same polarity whose marks lie at the same places."""
    kinds: list[Mark] = []
    for other in sets:
        if (
            other.bright == best.bright
            and other.mark != best.mark
            and _apart(other, best) < apart_px
        ):
            kinds.append(other.mark)
    return tuple(kinds[: best.layout.film.shape[0] + 2])


def _apart(first: Constellation, second: Constellation) -> float:
    """Mean distance of the marks of one set from the nearest of another, pixels."""
    gaps = np.linalg.norm(first.pixels[:, None] - second.pixels[None], axis=2).min(axis=1)
    return float(np.mean(gaps))


def _is_border(chosen: Constellation, area: FilmArea, limit_px: float) -> bool:
    """True for drawn notches and corners that are only the frame's own corners."""
    if chosen.mark.symmetric or chosen.mark.picture is not None:
        return False
    apart = np.linalg.norm(chosen.pixels[:, None] - area.corners[None], axis=2).min(axis=1)
    return bool(np.median(apart) < limit_px)


def _is_edge(chosen: Constellation, size_px: tuple[int, int]) -> bool:
    """True for marks most of which lie on the edge of the scan: nobody can centre half a mark."""
    inside = np.minimum(chosen.pixels, np.array(size_px) - chosen.pixels).min(axis=1)
    return bool(np.median(inside) < LEAST_RADIUS_PX)


def _rivals(sets: Sequence[Constellation], apart_px: float) -> list[Constellation]:
    """The best set of each place: sets whose marks lie together are one, whatever their names."""
    kept: list[Constellation] = []
    for candidate in sets:
        if all(_apart(candidate, other) > apart_px for other in kept):
            kept.append(candidate)
    return kept


def _symmetry(chosen: Constellation, windows: Sequence[SearchWindow], search: Search) -> float:
    """How symmetric the set's places are, 0 to 1, near and farther about them.

    The end of a ray or the crossing of a ray and a ring can look like a mark on its own; the middle
    of the mark is the point about which all that belongs to it is symmetric.
    """
    if not chosen.mark.symmetric:
        return ASYMMETRIC_WORTH
    cell_px = windows[0].reduction
    cell_mm = search.scan_pixel_mm * cell_px
    found: list[float] = []
    for column, row in chosen.pixels.tolist():
        window = min(windows, key=lambda w: abs(w.middle[0] - column) + abs(w.middle[1] - row))
        start = ((column - window.corner[0]) / cell_px, (row - window.corner[1]) / cell_px)
        for radius_mm in (SHORTEST_REACH * chosen.mark.reach_mm, SYMMETRY_MM):
            radius = max(radius_mm / cell_mm, LEAST_RADIUS_PX)
            centre = centre_by_symmetry(
                window.gray, start, SEARCH_OFF_MM / cell_mm + 1, disc(radius)
            )
            found.append(max(centre.correlation, 0.0) if isinstance(centre, Centre) else 0.0)
    # Light falls off across a housing: that an example is there its copies tell, not its symmetry.
    return max(float(np.mean(found)), ASYMMETRIC_WORTH if chosen.mark.picture is not None else 0.0)


def expected_places(lying: FilmPoints, area: FilmArea, scan_pixel_mm: float) -> PixelPoints:
    """Where marks should be whose places in the axes of the scan are known, scan pixels."""
    cosine, sine = np.cos(area.turn), np.sin(area.turn)
    turned = lying @ np.array([[cosine, -sine], [sine, cosine]]).T
    return area.centre + turned * np.array([1.0, -1.0]) / scan_pixel_mm


def _best_set(
    search: Search, kind: Candidates, owner: Sequence[int], layout: Layout, way: Way
) -> Constellation | None:
    """The set of one kind that fits a layout best, every pair of peaks tried as its base."""
    film = layout.lying(way)
    where = film[:, 0] + 1j * film[:, 1]
    places, worth = kind.places[list(owner)], kind.worth[list(owner)]
    starts, factors = _bases(search, where, places)
    if not len(starts):
        return None
    put = starts[:, None] + factors[:, None] * where[None, :]
    distance_mm = np.abs(put[:, :, None] - places[None, :, :]) * search.scan_pixel_mm
    fits = distance_mm < FIT_MM
    value = np.where(fits, worth[None] * (1 - FIT_WORTH * (distance_mm / FIT_MM) ** 2), 0.0)
    total = value.max(axis=2).sum(axis=1) * along_border(search, factors)
    base = int(np.argmax(total))
    chosen = value[base].argmax(axis=1)
    found = np.nonzero(value[base].max(axis=1) > 0)[0]
    at = np.asarray(places[found, chosen[found]])
    pixels = np.column_stack([np.real(at), -np.imag(at)])
    correlations = kind.correlations[list(owner)]
    predicted = {
        name: (float(place.real), float(-place.imag))
        for name, place in zip(layout.names, put[base], strict=True)
    }
    chance = log_chance_of_shape(search, len(layout.names), film[found], pixels)
    chance += log_chance_of_looks(search, kind, owner, chosen, found)
    chance += log_chance_of_border(search, complex(starts[base]), complex(factors[base]))
    bonus = 1 + UPRIGHT_BONUS * (way == UPRIGHT)
    turn = float(np.angle(factors[base])) + way[0] * np.pi / 2
    return Constellation(
        tuple(layout.names[int(i)] for i in found), pixels, correlations[found, chosen[found]],
        predicted, layout, way, kind.mark, kind.bright, turn, float(total[base]) * bonus, chance,
    )  # fmt: skip


def _bases(
    search: Search, where: Complexes, places: PeakComplex
) -> tuple[Complex128[np.ndarray, "bases"], Complex128[np.ndarray, "bases"]]:
    """Similarities pixel = start + factor * film through two peaks, of the right scale and turn."""
    first, second = np.triu_indices(len(where), 1)
    apart = where[second] - where[first]
    wide = np.abs(apart) >= LEAST_BASE * np.abs(apart).max(initial=0.0)
    first, second, apart = first[wide], second[wide], apart[wide, None, None]
    factor = (places[second][:, None, :] - places[first][:, :, None]) / apart
    good = np.abs(np.abs(factor) * search.scan_pixel_mm - 1) < LARGEST_SCALE
    good &= np.abs(np.angle(factor)) < np.radians(LARGEST_TURN_DEG)
    start = places[first][:, :, None] - factor * where[first][:, None, None]
    return start[good], factor[good]


def _best_rectangle(
    search: Search, kind: Candidates, owner: Sequence[int], layout: OpenLayout
) -> Constellation | None:
    """The rectangle of one kind whose marks are worth most; of four marks, or of three."""
    places, worth = kind.places[list(owner)], kind.worth[list(owner)]
    fitted = fit_rectangles(places, layout.directions)
    apart_mm = np.where(fitted.seen, fitted.apart * search.scan_pixel_mm, 0.0)
    good = (apart_mm < FIT_MM).all(axis=1) & _as_laid(search, fitted, layout)
    if not good.any():
        return None
    marks = np.arange(len(layout.names))
    value = worth[marks, fitted.chosen] * (1 - FIT_WORTH * (apart_mm / FIT_MM) ** 2)
    total = np.where(good, np.where(fitted.seen, value, 0.0).sum(axis=1), -np.inf)
    best = int(np.argmax(total))
    found = np.flatnonzero(fitted.seen[best])
    half = fitted.half[best] * search.scan_pixel_mm
    own = Layout(layout.names, layout.directions * half, (UPRIGHT,))
    at, turn = places[found, fitted.chosen[best][found]], float(fitted.turn[best])
    put = (
        fitted.middle[best]
        + np.exp(1j * turn) * (own.film @ np.array([1, 1j])) / search.scan_pixel_mm
    )
    predicted = {
        name: (float(place.real), float(-place.imag))
        for name, place in zip(layout.names, put, strict=True)
    }
    correlations = kind.correlations[list(owner)]
    rms_px = float(np.sqrt(np.mean(fitted.apart[best] ** 2) / 2))
    chance = log_chance_of_rectangle(search, rms_px, len(found))
    chance += log_chance_of_looks(search, kind, owner, fitted.chosen[best], found)
    return Constellation(
        tuple(layout.names[int(i)] for i in found), np.column_stack([np.real(at), -np.imag(at)]),
        correlations[found, fitted.chosen[best][found]], predicted, own, UPRIGHT, kind.mark,
        kind.bright, turn, float(total[best]) * (1 + UPRIGHT_BONUS), chance,
    )  # fmt: skip


def _as_laid(search: Search, fitted: Rectangles, layout: OpenLayout) -> Bool[np.ndarray, "n"]:
    """Which rectangles are of the size and shape of the frame, and lie as film is laid."""
    half = fitted.half * search.scan_pixel_mm
    good = (half > layout.least_mm * (1 - LARGEST_SCALE)).all(axis=1)
    good &= (half < layout.most_mm * (1 + LARGEST_SCALE)).all(axis=1)
    inset = half - layout.frame_mm
    good &= np.abs(inset[:, 0] - inset[:, 1]) < UNSQUARE_MM
    return good & (np.abs(fitted.turn) < np.radians(LARGEST_TURN_DEG))


def find_mark_sets(
    scan: ScanFile, layouts: Sequence[Layout], pixel_mm: float, area: FilmArea
) -> list[Constellation]:
    """One set for each layout, all agreeing: where two disagree the better one places the other.

    A layout nothing of which was seen comes with the places the best set gives its marks, and no
    names. Without any set there is none.

    Args:
        scan: The scan.
        layouts: Patterns in which marks lie, each of one kind.
        pixel_mm: Nominal size of a scan pixel, millimetres.
        area: The exposed picture.
    """
    sets = [find_constellation(scan, one, pixel_mm, area) for one in layouts]
    found = [one for one in sets if isinstance(one, Constellation)]
    if len(layouts) < 2 or not found:
        return found
    best = max(found, key=lambda one: one.score * one.symmetry)
    fit = best.fit
    result = [best]
    for layout in (one for one in layouts if one is not best.layout and fit):
        assert fit is not None
        narrow = replace(layout, ways=(best.way,))
        put = apply_affine(fit.matrix, narrow.lying(best.way))
        placed = _placed_by(fit, area, pixel_mm)
        again = find_constellation(scan, narrow, pixel_mm, placed, AGREE_MM + AROUND_MM)
        if isinstance(again, Constellation) and _agree(put, again, pixel_mm):
            result.append(again)
        else:
            result.append(_unseen(best, narrow, put))
    return result


def _placed_by(fit: PlaneTransform, area: FilmArea, pixel_mm: float) -> FilmArea:
    """The picture area moved and turned so that a found set lies in it as its layout says."""
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    half = np.ptp(area.corners, axis=0) * pixel_mm / 2
    return FilmArea(apply_affine(fit.matrix, corners * half), ("left", "right", "top"), area.scores)


def _unseen(best: Constellation, layout: Layout, put: PixelPoints) -> Constellation:
    """A layout none of whose marks was seen, placed by the best set."""
    places = zip(layout.names, put.tolist(), strict=True)
    return replace(
        best, names=(), pixels=np.zeros((0, 2)), correlations=np.zeros(0), layout=layout,
        predicted={name: (column, row) for name, (column, row) in places},
    )  # fmt: skip


def _agree(put: PixelPoints, found: Constellation, pixel_mm: float) -> bool:
    """True when the marks of a set were found where another set puts those of its layout."""
    own = [found.layout.names.index(name) for name in found.names]
    return bool(np.median(np.linalg.norm(put[own] - found.pixels, axis=1)) * pixel_mm < AGREE_MM)
