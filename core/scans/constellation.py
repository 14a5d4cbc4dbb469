"""Which places in a scan are the camera's fiducials: the set of candidates that fits best.

Every kind of mark in the library is correlated with windows about the expected places; of all
peaks the set is taken that lies as the certificate says, turned by about none to three quarter
circles and scaled by the scan pixel size. A set stands only if it could not be chance: the marks
that did not determine it lie too near to where they should, or look too much like marks.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from jaxtyping import Complex128, Float64

from core.arrays import FilmPoints, PixelPoints, Scalars, locked
from core.doubts import Failure
from core.raster.scan_file import ScanFile
from core.scans.candidates import (
    MERGE_MM,
    Candidates,
    SearchWindow,
    all_candidates,
    open_windows,
)
from core.scans.centring import Centre, centre_by_symmetry, disc_weights
from core.scans.film_area import FilmArea
from core.scans.layouts import UPRIGHT, Layout, Way
from core.scans.marks import Mark
from core.scans.set_chance import (
    ConstellationOptions,
    Search,
    along_border,
    area_turn,
    log_chance_of_border,
    log_chance_of_looks,
    log_chance_of_shape,
)

Complexes = Complex128[np.ndarray, "n"]
PeakComplex = Complex128[np.ndarray, "n peaks"]
PeakValues = Float64[np.ndarray, "n peaks"]
BORDER_MM = 1.5
"""Distance from the corner of the frame within which a notch is the corner itself."""
ASYMMETRIC_WORTH = 0.5
"""Symmetry that a kind of mark without any is credited with."""


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


def find_constellation(
    scan: ScanFile,
    layouts: Sequence[Layout],
    scan_pixel_mm: float,
    area: FilmArea,
    options: ConstellationOptions | None = None,
) -> Constellation | Failure:
    """Find marks in a scan to about a tenth of a millimetre.

    Args:
        scan: The scan.
        layouts: Patterns in which they may lie: the same names, at places near each other.
        scan_pixel_mm: Nominal size of a scan pixel, millimetres.
        area: The exposed picture.
        options: How they are looked for.
    """
    options = options or ConstellationOptions()
    reach_mm = options.reach_seen_mm if area.trusted else options.reach_unseen_mm
    reaches = [layout.reach_mm for layout in layouts]
    middle = layouts[int(np.argsort(reaches)[len(reaches) // 2])]
    reach_mm += (max(reaches) - min(reaches)) / 2
    ways = middle.ways
    border = area if area.trusted and not options.beware_of_border else None
    tries = len(layouts) * len(ways)
    search = Search(scan_pixel_mm, (2 * reach_mm) ** 2, tries, options, border)
    expected = {k: _expected(middle.lying(way), area, scan_pixel_mm) for k, way in enumerate(ways)}
    column, row = area.centre[0].tolist()
    windows, owners = open_windows(
        scan, expected, (column, row), round(reach_mm / scan_pixel_mm), MERGE_MM / scan_pixel_mm,
        max(1, round(options.search_pixel_mm / scan_pixel_mm)),
    )  # fmt: skip
    kinds = all_candidates(
        windows, scan_pixel_mm * windows[0].reduction, options.peaks, options.marks,
        area_turn(area),
    )  # fmt: skip
    kinds.sort(key=lambda kind: kind.promise, reverse=True)
    sets = [
        _best_set(search, kind, owners[k], layout, way)
        for kind in _promising(kinds, options.kinds)
        for layout in layouts
        for k, way in enumerate(ways)
    ]
    found = [chosen for chosen in sets if chosen is not None]
    return _chosen(found, windows, search, area)


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
    options = search.options
    most = options.max_log_with_border if search.border else options.max_log_false_alarms
    sound = [c for c in found if c.log_false_alarms < most]
    if search.options.beware_of_border:
        limit_px = BORDER_MM / search.scan_pixel_mm
        sound = [c for c in sound if not _is_border(c, area, limit_px)]
    sound.sort(key=lambda chosen: chosen.score, reverse=True)
    rivals = _rivals(sound, 0.15 / search.scan_pixel_mm)[: search.options.rivals]
    symmetries = [_symmetry(rival, windows, search) for rival in rivals]
    if max(symmetries, default=0.0) < search.options.min_symmetry:
        return Failure(
            "No set of marks lies as the certificate says.",
            {
                "log_false_alarms": min((c.log_false_alarms for c in found), default=None),
                "symmetry": max(symmetries, default=None),
            },
        )
    worth = [rival.score * value for rival, value in zip(rivals, symmetries, strict=True)]
    best = int(np.argmax(worth))
    kinds = _other_kinds(rivals[best], sound, 0.15 / search.scan_pixel_mm)
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
    """True for notches and corners that are only the frame's own corners."""
    if chosen.mark.symmetric:
        return False
    apart = np.linalg.norm(chosen.pixels[:, None] - area.corners[None], axis=2).min(axis=1)
    return bool(np.median(apart) < limit_px)


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
        for radius_mm in (1.15 * chosen.mark.reach_mm, search.options.symmetry_mm):
            radius = max(radius_mm / cell_mm, 3.0)
            weights = disc_weights(2 * int(np.ceil(radius)) + 3, radius)
            centre = centre_by_symmetry(window.gray, weights, start, limit_px=0.3 / cell_mm + 1)
            found.append(max(centre.correlation, 0.0) if isinstance(centre, Centre) else 0.0)
    return float(np.mean(found))


def _expected(lying: FilmPoints, area: FilmArea, scan_pixel_mm: float) -> PixelPoints:
    """Where marks should be whose places in the axes of the scan are known, scan pixels."""
    turn = area_turn(area)
    cosine, sine = np.cos(turn), np.sin(turn)
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
    tolerance = search.options.fit_tolerance_mm
    fits = distance_mm < tolerance
    value = np.where(fits, worth[None] * (1 - 0.7 * (distance_mm / tolerance) ** 2), 0.0)
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
    chance += log_chance_of_looks(correlations, chosen, found)
    chance += log_chance_of_border(search, complex(starts[base]), complex(factors[base]))
    bonus = 1 + search.options.upright_bonus * (way == UPRIGHT)
    turn = float(np.angle(factors[base])) + way[0] * np.pi / 2
    return Constellation(
        tuple(layout.names[int(i)] for i in found), pixels, correlations[found, chosen[found]],
        predicted, layout, way, kind.mark, kind.bright, turn, float(total[base]) * bonus, chance,
    )  # fmt: skip


def _bases(
    search: Search, where: Complexes, places: PeakComplex
) -> tuple[Complex128[np.ndarray, "bases"], Complex128[np.ndarray, "bases"]]:
    """Similarities pixel = start + factor * film through two peaks, of the right scale and turn."""
    starts: list[np.ndarray] = []
    factors: list[np.ndarray] = []
    longest = np.abs(where[:, None] - where[None, :]).max()
    tolerance = np.radians(search.options.turn_tolerance_deg)
    for i, j in combinations(range(len(where)), 2):
        apart = where[j] - where[i]
        if abs(apart) < 0.3 * longest:
            continue
        factor = (places[j][None, :] - places[i][:, None]) / apart
        start = places[i][:, None] - factor * where[i]
        scale = np.abs(factor) * search.scan_pixel_mm
        good = np.abs(scale - 1) < search.options.scale_tolerance
        good &= np.abs(np.angle(factor)) < tolerance
        starts.append(start[good])
        factors.append(factor[good])
    if not starts:
        return np.zeros(0, dtype=np.complex128), np.zeros(0, dtype=np.complex128)
    return np.concatenate(starts), np.concatenate(factors)
