"""The classical methods of aerial triangulation beside the bundle, on the same observations.

Strips are triangulated by models joined one after the other and bent onto control. Errors of
joining add up along a strip and bend it; polynomials of the second degree, conformal in plan (Schut
1967), take that out as far as control reaches.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np
from jaxtyping import Float64

from core.adjustment.accuracy import intersect_checks
from core.adjustment.adjusted import AdjustmentReport
from core.adjustment.positioning import places_along, strips_of
from core.arrays import Indices, ObjectPoints, PixelPoints, Position, Rotation, Scalars
from core.block import Block, Photo, footprint
from core.doubts import Failure
from core.geometry.exterior import (
    ExteriorOrientation,
    Similarity,
    angles_from_rotation,
    fit_similarity,
)
from core.geometry.resection import PhotoModel, moved
from core.geometry.robust import cauchy_weights, solve_robustly
from core.literature.independent_models import (
    Sights,
    StereoModel,
    Triangulated,
    compose,
    form_models,
    join_models,
    known_places,
    triangulate_models,
)

# design: the weights settle within the steps; from metres away the resection needs fewer.
STEPS = 8
FAR = 3.0  # design: beyond 3 sigma a good coordinate is one in four hundred.
"""At this many robust standard deviations a coordinate has half its weight."""
# design: the polynomial in plan has six unknowns, two a point, that in height five; with fewer than
# eight points it would bend to their errors.
QUADRATIC = 8
"""So many known points along a strip allow it to be bent; fewer only to be shifted and turned."""
# design: an error of a point of such a line comes back some fifty times as large beside it.
ON_A_LINE = 0.02
"""Points that spread across by less than this share of their length leave a strip loose."""
Left = Float64[np.ndarray, "left 3"]
"""What is left at known points: E, N, height, metres."""
Known = dict[int, Position]
"""Places of points by number, metres."""


@dataclass(frozen=True, slots=True, eq=False)
class MethodResult:
    """What one method makes of a block; all differences as RMS of X, Y, Z, metres."""

    method: str
    """`strips`, `models` or `bundle`."""
    reason: str = ""
    """Why it could not be done; empty when it was."""
    joint_m: Position | None = None
    """Left where strips or models meet each other and the control."""
    control_m: Position | None = None
    """Control points, intersected, minus known."""
    check_m: Position | None = None
    """Check points, intersected, minus known; None without any."""
    centres_m: Position | None = None
    """Perspective centres minus those of the bundle."""


def compare_methods(report: AdjustmentReport) -> tuple[MethodResult, ...]:
    """Orient an adjusted block again by strips and by independent models.

    The oriented photos with their used control; cameras are those of the bundle.
    """
    bundle = report.block
    oriented = {name: photo for name, photo in bundle.photos.items() if photo.oriented}
    measured = {key: m for key, m in bundle.measurements.items() if m.photo_id in oriented}
    block = replace(bundle, photos=oriented, measurements=measured)
    sights = Sights.of(block)
    models = form_models(block, np.random.default_rng(0))
    methods = {"strips": triangulate_strips, "models": triangulate_models}
    results = [
        _judged(name, method(block, models, sights) if models else _NONE, block)
        for name, method in methods.items()
    ]
    return (*results, _judged("bundle", Triangulated(block, None), block))


_NONE = Failure("no two photos make a model")


def _judged(method: str, found: Triangulated | Failure, bundle: Block) -> MethodResult:
    """The figures of one method."""
    if isinstance(found, Failure):
        return MethodResult(method, found.reason)
    block = found.block
    known = {name: replace(point, role="check") for name, point in block.surveyed.items()}
    differences: dict[str, list[Position]] = {"control": [], "check": []}
    for check in intersect_checks(replace(block, surveyed=known)):
        if check.used_scans > 1:
            role = bundle.surveyed[check.point_id].role
            differences[role].append(check.difference_m)
    centres = [
        photo.exterior.centre - bundle.photos[name].exterior.centre
        for name, photo in block.photos.items()
    ]
    control, checks = _rms(differences["control"]), _rms(differences["check"])
    return MethodResult(method, "", found.joint_m, control, checks, _rms(centres))


def _rms(differences: list[Position]) -> Position | None:
    """Root mean square by axis; None without any."""
    if not differences:
        return None
    return np.asarray(np.sqrt(np.mean(np.square(differences), axis=0)))


@dataclass(frozen=True, slots=True, eq=False)
class _Strip:
    """A strip joined from its models, in the first model's space."""

    photo_ids: tuple[str, ...]
    rotations: Mapping[str, Rotation]
    numbers: Indices
    positions: ObjectPoints


def triangulate_strips(
    block: Block, models: Sequence[StereoModel], sights: Sights
) -> Triangulated | Failure:
    """Orient a block strip by strip; each serves as control for those beside it.

    Args:
        block: Photos in about the right order, ties and measured control.
        models: Its models.
        sights: The count of their points.
    """
    strips = [joined_strip(names, models) for names in strip_names(block)]
    failed = next((strip for strip in strips if isinstance(strip, Failure)), None)
    if failed is not None:
        return failed
    waiting = [strip for strip in strips if isinstance(strip, _Strip)]
    known: Known = {number: place for number, (place, _) in known_places(block, sights).items()}
    left: list[Left] = []
    photos = dict(block.photos)
    while waiting:
        strip = max(waiting, key=lambda strip: _shared(strip, known))
        waiting.remove(strip)
        if _shared(strip, known) < 3:
            return Failure(
                f"the strip from {strip.photo_ids[0]} to {strip.photo_ids[-1]} has fewer than "
                "three points that are known"
            )
        if _on_a_line(strip, known):
            return Failure(
                f"the known points of the strip from {strip.photo_ids[0]} to {strip.photo_ids[-1]} "
                "lie on a line, about which it can turn"
            )
        places, turn, residual = bend_strip(strip, known)
        left.append(residual)
        placed = dict(zip(strip.numbers.tolist(), places, strict=True))
        for name in strip.photo_ids:
            start = ExteriorOrientation(
                placed[sights.centres[name]], *angles_from_rotation(turn @ strip.rotations[name])
            )
            photos[name] = resect_on_strip(block, sights, photos[name], start, placed)
        known = placed | known
    residual = np.concatenate(left)
    return Triangulated(block.with_photos(photos), np.sqrt(np.mean(residual**2, axis=0)))


def strip_names(block: Block) -> list[tuple[str, ...]]:
    """Photos of each strip from one end to the other."""
    photos = list(block.photos.values())
    sides = [float(np.sqrt(footprint(p, block.camera_of(p.photo_id)).area)) for p in photos]
    strips = strips_of(photos, sides)
    places = places_along(photos, strips)
    order = np.lexsort((places, strips))
    return [
        tuple(photos[i].photo_id for i in order.tolist() if strips[i] == number)
        for number in np.unique(strips).tolist()
    ]


def joined_strip(names: Sequence[str], models: Sequence[StereoModel]) -> _Strip | Failure:
    """The models of neighbours, each laid on the one before."""
    if len(names) < 2:
        return Failure(f"{names[0]} is a strip by itself: one photo makes no model")
    by_pair = {frozenset(model.photo_ids): model for model in models}
    pairs = [frozenset(pair) for pair in pairwise(names)]
    missing = next((pair for pair in pairs if pair not in by_pair), None)
    if missing is not None:
        return Failure(f"{' and '.join(sorted(missing))} make no model")
    own = [by_pair[pair] for pair in pairs]
    bodies = join_models(own)
    if bodies is None:
        return Failure(f"the models from {names[0]} to {names[-1]} do not hang together")
    places: Known = {}
    rotations: dict[str, np.ndarray] = {}
    for model, body in zip(own, bodies, strict=True):
        spots = body.moved(model.positions)
        places = dict(zip(model.numbers.tolist(), spots, strict=True)) | places
        for name, turn in zip(model.photo_ids, model.rotations, strict=True):
            rotations.setdefault(name, body.rotation @ turn)
    return _Strip(tuple(names), rotations, np.array(list(places)), np.array(list(places.values())))


def _shared(strip: _Strip, known: Known) -> int:
    """How many of a strip's points are known."""
    return int(np.isin(strip.numbers, list(known)).sum())


def _on_a_line(strip: _Strip, known: Known) -> bool:
    """Whether a strip's known points lie on one line in plan."""
    plan = np.array([known[number][:2] for number in strip.numbers.tolist() if number in known])
    long, wide = np.linalg.svd(plan - plan.mean(axis=0), compute_uv=False)
    return bool(wide < ON_A_LINE * long)


def bend_strip(strip: _Strip, known: Known) -> tuple[ObjectPoints, Rotation, Left]:
    """A strip on known points: its points, the turn that brought it there, what is left over."""
    which = np.isin(strip.numbers, list(known))
    target = np.array([known[number] for number in strip.numbers[which].tolist()])
    body = fit_similarity(strip.positions[which], target, np.ones(len(target)))
    level = compose(Similarity(1.0, np.eye(3), -target.mean(axis=0)), body)
    places = level.moved(strip.positions)
    size = float(np.abs(places[:, :2]).max())
    off = target - target.mean(axis=0) - places[which]
    curve = len(target) >= QUADRATIC
    plan = _plan_terms(places[:, 0] / size, places[:, 1] / size, curve)
    height = _height_terms(places[:, 0] / size, places[:, 1] / size, curve)
    both = plan.reshape(-1, plan.shape[2])
    shift = (
        both
        @ np.linalg.lstsq(plan[which].reshape(-1, plan.shape[2]), off[:, :2].ravel(), rcond=None)[0]
    )
    lift = height @ np.linalg.lstsq(height[which], off[:, 2], rcond=None)[0]
    better = places + np.column_stack([shift.reshape(-1, 2), lift])
    left = better[which] - (target - target.mean(axis=0))
    return better + target.mean(axis=0), body.rotation, left


def _plan_terms(x: np.ndarray, y: np.ndarray, curve: bool) -> np.ndarray:
    """Conformal polynomial in plan: (n, 2, terms), E then N."""
    place = x + 1j * y
    powers = [place**0, place, place**2][: 3 if curve else 2]
    columns = [column for power in powers for column in (power, 1j * power)]
    return np.stack([np.column_stack([c.real, c.imag]) for c in columns], axis=2)


def _height_terms(x: np.ndarray, y: np.ndarray, curve: bool) -> np.ndarray:
    """Polynomial in height (n, terms): tilts, then bending and twist."""
    terms = [np.ones_like(x), x, y, x * x, x * y]
    return np.column_stack(terms[: 5 if curve else 3])


def resect_on_strip(
    block: Block, sights: Sights, photo: Photo, start: ExteriorOrientation, placed: Known
) -> Photo:
    """A photo oriented by least squares on the strip's points that it shows."""
    which = np.isin(sights.numbers[photo.photo_id], list(placed))
    pixels: PixelPoints = sights.pixels[photo.photo_id][which]
    numbers = sights.numbers[photo.photo_id][which].tolist()
    ground = np.array([placed[number] for number in numbers])
    model = PhotoModel(photo.interior, block.camera_of(photo.photo_id), photo.atmosphere)
    exterior = start

    def solve(weights: Scalars) -> tuple[ExteriorOrientation, Scalars]:
        nonlocal exterior
        predicted, design = model.linearised(ground, exterior)
        root = np.sqrt(weights)
        rows, off = design.reshape(-1, 6) * root[:, None], (pixels - predicted).ravel() * root
        exterior = moved(exterior, np.linalg.lstsq(rows, off, rcond=None)[0])
        return exterior, np.abs(pixels - model.pixels(ground, exterior)).ravel()

    exterior = solve_robustly(
        solve, np.ones(2 * len(ground)), partial(cauchy_weights, limit=FAR), passes=STEPS
    )
    return replace(photo, exterior=exterior, oriented=True)
