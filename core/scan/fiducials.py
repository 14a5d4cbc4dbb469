"""Fiducials measured to a fraction of a pixel; one that is missing or in doubt says so."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float32

from core.doubts import Doubt, Failure
from core.geometry.camera import Camera
from core.geometry.transforms import PlaneTransform, apply_affine, fit_similarity
from core.scan.centring import (
    Centre,
    Gray,
    Shift,
    Weights,
    centre_by_symmetry,
    correlation,
    disc_weights,
    match_mark,
    sample_about,
)
from core.scan.constellation import Constellation, ConstellationOptions, find_constellation
from core.scan.film_area import FilmArea
from core.scan.marks import Mark, draw_mark, resized
from core.scan.raster import ScanFile, photo_id_of, read_window


@dataclass(frozen=True, slots=True)
class FiducialOptions:
    """When a measured mark stands."""

    max_disagreement_px: float = 0.5
    """Greatest distance between the matched and the symmetric middle, pixels."""
    min_correlation: float = 0.55
    """Correlation with the drawn mark below which a place is no mark."""
    sigma_floor_px: float = 0.03
    """No mark is believed better than this, pixels."""
    search: ConstellationOptions = field(default_factory=ConstellationOptions)
    """How the marks are looked for."""


@dataclass(frozen=True, slots=True)
class FiducialMeasurement:
    """One fiducial in one scan."""

    name: str
    """Its name in the camera's certificate."""
    column: float
    """Pixels, outer corner of the first pixel (0, 0)."""
    row: float
    """Pixels."""
    sigma_px: float
    """Standard deviation per axis, pixels."""
    correlation: float
    """Likeness to the drawn mark, 0 to 1."""
    disagreement_px: float
    """Distance between its matched and its symmetric middle, pixels."""
    kind: str
    """Shape of the mark."""


@dataclass(frozen=True, slots=True, eq=False)
class _Spot:
    """A full resolution window about one mark."""

    name: str
    corner: tuple[int, int]
    gray: Float32[np.ndarray, "rows columns"]
    start: tuple[float, float]
    """Approximate middle, window pixels."""
    found: bool
    """False where the place only follows from the other marks."""


@dataclass(frozen=True, slots=True, eq=False)
class _Drawn:
    """The mark as it is matched in this scan."""

    mark: Mark
    template: Weights
    weights: Weights
    bright: bool


def measure_fiducials(
    scan: ScanFile,
    camera: Camera,
    scan_pixel_mm: float,
    area: FilmArea,
    options: FiducialOptions | None = None,
) -> tuple[tuple[FiducialMeasurement, ...], tuple[Doubt, ...]]:
    """Find and measure the camera's fiducials in a scan.

    Args:
        scan: The scan.
        camera: Camera with its certified fiducials.
        scan_pixel_mm: Nominal size of a scan pixel, millimetres.
        area: The exposed picture.
        options: When a mark stands.

    Returns:
        The marks that stand, in the order of the certificate, and a doubt for each that does not.
    """
    options = options or FiducialOptions()
    photo_id = photo_id_of(scan.path)
    found = find_constellation(scan, camera, scan_pixel_mm, area, options.search)
    if isinstance(found, Failure):
        return (), (_nothing_found(photo_id, len(camera.fiducials_mm)),)
    spots = _spots(scan, camera, found, scan_pixel_mm)
    sure = [spot for spot in spots.values() if spot.found]
    drawn = _fitted_mark(sure, found, scan_pixel_mm)
    measurements: list[FiducialMeasurement] = []
    doubts: list[Doubt] = []
    for name in camera.fiducials_mm:
        result: FiducialMeasurement | Failure = Failure("It lies outside the scan.")
        if name in spots:
            result = _measure(spots[name], drawn, scan_pixel_mm, options)
        if isinstance(result, Failure):
            doubts.append(_doubtful(photo_id, name, found.predicted[name], result))
        else:
            measurements.append(result)
    if not measurements:
        return (), (_nothing_found(photo_id, len(camera.fiducials_mm)),)
    return tuple(measurements), tuple(doubts)


def _spots(
    scan: ScanFile, camera: Camera, found: Constellation, scan_pixel_mm: float
) -> Mapping[str, _Spot]:
    """Full resolution windows about all marks; those not found yet where the others put them."""
    half = int(np.ceil((found.mark.reach_mm * 1.8 + 0.6) / scan_pixel_mm)) + 8
    places = _all_places(camera, found)
    spots: dict[str, _Spot] = {}
    for name, (column, row) in places.items():
        corner = (round(column) - half, round(row) - half)
        gray = read_window(scan, *corner, 2 * half, 2 * half, outside="edge")
        middle = gray[half - 3 : half + 3, half - 3 : half + 3]
        inside = 0 < column < scan.size_px[0] and 0 < row < scan.size_px[1]
        if inside and np.isfinite(middle).all():
            start = (column - corner[0], row - corner[1])
            spots[name] = _Spot(name, corner, gray, start, name in found.names)
    return spots


def _all_places(camera: Camera, found: Constellation) -> Mapping[str, tuple[float, float]]:
    """Where each mark was found, or where a similarity through the found ones puts it."""
    film = np.array([camera.fiducials_mm[name] for name in found.names], dtype=np.float64)
    fit = fit_similarity(film, found.pixels, mirrored=True)
    places = dict(found.predicted)
    if isinstance(fit, PlaneTransform):
        for name, mm in camera.fiducials_mm.items():
            column, row = apply_affine(fit.matrix, np.array([mm], dtype=np.float64))[0].tolist()
            places[name] = (column, row)
    for name, (column, row) in zip(found.names, found.pixels.tolist(), strict=True):
        places[name] = (column, row)
    return places


def _fitted_mark(spots: Sequence[_Spot], found: Constellation, scan_pixel_mm: float) -> _Drawn:
    """The mark's own measures: what makes the drawn mark most like the scan's, on average.

    Coordinate descent over radius and stroke; rotation is the film's.
    """
    best = _draw(found.mark, found, scan_pixel_mm)
    matched = [_matched(spot, best, scan_pixel_mm) for spot in spots]
    places = [
        (spot.gray, np.array([match.column, match.row]))
        for spot, match in zip(spots, matched, strict=True)
        if isinstance(match, Centre)
    ]
    if not places:
        return best
    likeness = _likeness(places, best)
    for step in (0.2, 0.1, 0.05):
        for _ in range(3):
            factors = ((1 + step, 1.0), (1 / (1 + step), 1.0), (1.0, 1 + 2 * step),
                       (1.0, 1 / (1 + 2 * step)))  # fmt: skip
            trials = [_draw(resized(best.mark, *pair), found, scan_pixel_mm) for pair in factors]
            values = [_likeness(places, trial) for trial in trials]
            winner = int(np.argmax(values))
            if values[winner] <= likeness + 1e-4:
                break
            likeness, best = values[winner], trials[winner]
    return best


def _draw(mark: Mark, found: Constellation, scan_pixel_mm: float) -> _Drawn:
    """The mark at the scan's scale, turned as the film is."""
    # Column to row is clockwise as seen, the film's turn is counter-clockwise.
    turn = -float((found.turn + np.pi / 4) % (np.pi / 2) - np.pi / 4)
    template = draw_mark(mark, scan_pixel_mm, turn)
    weights = disc_weights(template.shape[0], template.shape[0] / 2 - 1)
    return _Drawn(mark, template, weights, found.bright)


def _likeness(places: Sequence[tuple[Gray, Shift]], drawn: _Drawn) -> float:
    """Mean correlation with the drawn mark at places that were matched with a like one."""
    side, sign = drawn.template.shape[0], 1 if drawn.bright else -1
    return float(
        np.mean(
            [
                sign * correlation(sample_about(gray, place, side), drawn.template, drawn.weights)
                for gray, place in places
            ]
        )
    )


def _matched(spot: _Spot, drawn: _Drawn, pixel_mm: float) -> Centre | Failure:
    """The drawn mark matched in one spot; correlation positive when its polarity is right."""
    found = match_mark(
        spot.gray, drawn.template, drawn.weights, spot.start, limit_px=0.4 / pixel_mm + 2
    )
    if isinstance(found, Failure) or drawn.bright:
        return found
    return replace(found, correlation=-found.correlation)


def _measure(
    spot: _Spot, drawn: _Drawn, pixel_mm: float, options: FiducialOptions
) -> FiducialMeasurement | Failure:
    """One mark in both ways; they have to agree."""
    matched = _matched(spot, drawn, pixel_mm)
    if isinstance(matched, Failure):
        return matched
    if matched.correlation < options.min_correlation:
        return Failure(
            f"What is there is not like the mark (correlation {matched.correlation:.2f}).",
            {"correlation": matched.correlation},
        )
    radius = drawn.mark.reach_mm * 1.15 / pixel_mm + 1
    weights = disc_weights(2 * int(np.ceil(radius)) + 3, radius)
    start = (matched.column, matched.row)
    symmetric = centre_by_symmetry(spot.gray, weights, start, limit_px=0.3 / pixel_mm + 2)
    if isinstance(symmetric, Failure):
        return symmetric
    apart = float(np.hypot(matched.column - symmetric.column, matched.row - symmetric.row))
    if apart > options.max_disagreement_px:
        return Failure(
            f"The two ways to centre it differ by {apart:.2f} pixels.", {"disagreement_px": apart}
        )
    share = matched.sigma_px**2 / (matched.sigma_px**2 + symmetric.sigma_px**2 + 1e-12)
    return FiducialMeasurement(
        spot.name,
        spot.corner[0] + share * symmetric.column + (1 - share) * matched.column,
        spot.corner[1] + share * symmetric.row + (1 - share) * matched.row,
        max(float(np.hypot(symmetric.sigma_px, apart / 2)), options.sigma_floor_px),
        matched.correlation,
        apart,
        drawn.mark.shape,
    )


def _nothing_found(photo_id: str, marks: int) -> Doubt:
    """The doubt of a scan without any fiducial."""
    return Doubt(
        "fiducials-not-found",
        photo_id,
        f"None of the {marks} fiducials could be found where fiducials_mm puts them. Check "
        "fiducials_mm, frame_mm and scan_pixel_um of the camera, or measure them by hand.",
        0.9,
        {"marks": marks},
    )


def _doubtful(photo_id: str, name: str, place: tuple[float, float], failure: Failure) -> Doubt:
    """The doubt of a mark that is missing or does not stand."""
    column, row = place
    return Doubt(
        "fiducial-doubtful",
        photo_id,
        f"Fiducial {name}, expected near column {column:.0f}, row {row:.0f}, was not measured: "
        f"{failure.reason} Measure it by hand if it is there.",
        0.4,
        {"fiducial": name, "column": column, "row": row, **failure.evidence},
    )
