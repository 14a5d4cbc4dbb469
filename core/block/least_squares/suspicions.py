"""What an adjusted block gives cause to doubt: parts without connection, classes, bent film."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float64
from scipy import stats
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from core.block.degenerate import control_doubts
from core.block.least_squares.network import Network
from core.block.least_squares.positioning import MEASURED_M
from core.block.least_squares.solution import Solution
from core.doubts import Doubt

LOOSE_M = 100.0
"""A coordinate known less well than this is not control."""
CELLS = 5
"""Cells a side in which film residuals are averaged."""
SYSTEMATIC = 5.0
"""Mean residual of a cell, in its standard deviations, that chance does not bring about."""
LARGER = 1.25
"""Residuals this many times as large as stated are told."""
UNCHECKED = 0.1
"""Redundancy number below which no other measurement would show an error."""
CLASS_WORDS = {
    "tie": "tie points in the photos",
    "control_image": "control points in the photos",
    "control_plan": "control points in plan",
    "control_height": "control points in height",
    "dem": "tie points against the terrain",
    "centre": "measured perspective centres",
    "angles": "measured angles",
}


def suspicions_of(solution: Solution) -> list[Doubt]:
    """Everything doubtful about an adjusted network."""
    return [
        *_parts(solution),
        *_control(solution),
        *_behind(solution),
        *_unchecked(solution),
        *_classes(solution),
        *_bent_film(solution),
    ]


def _parts(solution: Solution) -> list[Doubt]:
    """Photos alone, and parts of the block that no tie point joins."""
    network, names = solution.network, [p.photo_id for p in solution.network.photos]
    if len(names) == 1:
        message = "One photo alone: nothing ties it, and only its own control can show it wrong."
        return [Doubt("single-photo", names[0], message, 0.5)]
    number = _parts_of(network, solution.fit.taking_part)
    count = int(number.max()) + 1
    if count == 1:
        return []
    sizes = np.bincount(number)
    order = np.argsort(-sizes, kind="stable")
    found: list[Doubt] = []
    for part in order[1:].tolist():
        members = [name for name, own in zip(names, number, strict=True) if own == part]
        points = _control_in(solution, number == part)
        message = (
            f"{_listed(members)}: no tie point joins {'it' if len(members) == 1 else 'them'} to "
            f"the other photos. {points} control points of their own hold them"
            + (", which is too few." if points < 3 else "; nothing compares the two parts.")
        )
        evidence = {"scans": members[:50], "control_points": points, "parts": count}
        gravity = 0.9 if points < 3 else 0.6
        found.append(Doubt("block-in-parts", members[0], message, gravity, evidence))
    return found


def _parts_of(network: Network, taking_part: Bool[np.ndarray, "rays"]) -> np.ndarray:
    """Number of the connected part each photo belongs to."""
    rays, photos = network.rays, len(network.photos)
    used = taking_part & (rays.measurement < 0)
    joins = csr_array(
        (np.ones(int(used.sum())), (rays.photo[used], photos + rays.point[used])),
        shape=(photos + network.points.count,) * 2,
    )
    return connected_components(joins, directed=False)[1][:photos]


def _control_in(solution: Solution, photos: Bool[np.ndarray, "photos"]) -> int:
    """Control points that photos of a part show."""
    rays = solution.network.rays
    used = solution.fit.taking_part & (rays.measurement >= 0) & photos[rays.photo]
    return len(np.unique(rays.point[used]))


def _control(solution: Solution) -> list[Doubt]:
    """Where the control lies."""
    network, fit = solution.network, solution.fit
    points, photos = network.points, network.photos
    alive = np.bincount(network.rays.point[fit.taking_part], minlength=points.count) > 0
    if points.control and not points.known_weight[len(points.tie) :].any():
        return []  # a free network: control is there, and not meant to hold it
    known = points.known_weight > 1 / LOOSE_M
    known[: len(points.tie)] = False
    measured = (network.priors.centre_weights > 1 / MEASURED_M).all(axis=1)
    sides = [
        camera.frame_mm[0]
        / camera.principal_distance_mm
        * (float(centre[2]) - photo.ground_height_m)
        for photo, camera, centre in zip(
            photos, (network.cameras[n] for n in network.camera), fit.state.centres, strict=True
        )
    ]
    return control_doubts(
        points.known[known[:, :2].all(axis=1) & alive],
        points.known[known[:, 2] & alive],
        fit.state.centres,
        float(np.median(sides)),
        int(measured.sum()),
    )


def _behind(solution: Solution) -> list[Doubt]:
    """Rays whose point would lie behind the camera: their photo looks the wrong way."""
    network, behind = solution.network, solution.fit.lin.behind
    counts = np.bincount(network.rays.photo[behind], minlength=len(network.photos))
    return [
        Doubt(
            "point-behind-camera",
            network.photos[photo].photo_id,
            f"{counts[photo]} measured points would lie behind the camera and were left out. "
            "The orientation is upside down, or the points belong to another photo.",
            0.8,
            {"points": int(counts[photo])},
        )
        for photo in np.flatnonzero(counts).tolist()
    ]


def _unchecked(solution: Solution) -> list[Doubt]:
    """Control measurements whose error nothing would show."""
    network, rays = solution.network, solution.network.rays
    used = np.flatnonzero(solution.fit.taking_part & (rays.measurement >= 0))
    redundancy = 1 - solution.precision.rays[:, used].mean(axis=0)
    weak = used[redundancy < UNCHECKED]
    if not len(weak):
        return []
    names = [" in ".join(network.measurements[rays.measurement[ray]].key) for ray in weak]
    message = (
        f"{_listed(names)} cannot be checked by any other measurement: an error in "
        f"{'it' if len(names) == 1 else 'them'} would go into the block unseen."
    )
    return [Doubt("uncheckable-control", names[0], message, 0.4, {"measurements": names[:50]})]


def _classes(solution: Solution) -> list[Doubt]:
    """Classes whose residuals are larger than their standard deviations allow."""
    found: list[Doubt] = []
    for name, figures in solution.classes.items():
        r = figures.redundancy
        if r < 3 or figures.sigma_ratio < LARGER:
            continue
        if figures.weighted_squares > stats.chi2.ppf(0.999, r):
            message = (
                f"Residuals of {CLASS_WORDS[name]} are {figures.sigma_ratio:.1f} times as large as "
                "their standard deviations say: a systematic error, or too much trust in them."
            )
            evidence = {"ratio": figures.sigma_ratio, "redundancy": r}
            found.append(Doubt("class-too-large", name, message, 0.5, evidence))
    return found


def _bent_film(solution: Solution) -> list[Doubt]:
    """Mean residuals that stay the same at one place of the film in all photos of a camera."""
    network, fit = solution.network, solution.fit
    rays = network.rays
    found: list[Doubt] = []
    for number, camera in enumerate(network.cameras):
        used = fit.taking_part & (network.camera[rays.photo] == number)
        if int(used.sum()) < 20 * CELLS**2:
            continue
        place = (rays.film[used] / np.array(camera.frame_mm) + 0.5) * CELLS
        column, row = np.clip(place.astype(np.int64), 0, CELLS - 1).T
        cell = row * CELLS + column
        count = np.bincount(cell, minlength=CELLS**2)
        means = _means(cell, fit.lin.residuals[:, used], count)
        spread = float(np.sqrt(np.mean(fit.lin.residuals[:, used] ** 2)))
        test = np.abs(means) * np.sqrt(count) / max(spread, 1e-9)
        worst = float(test.max())
        if worst > SYSTEMATIC:
            micrometres = means * 1000 * float(np.median(rays.sigma_mm[used]))
            largest = float(np.abs(micrometres).max())
            message = (
                f"Residuals of camera {network.camera_names[number]} are the same in all photos "
                f"at some places of the film (up to {largest:.1f} micrometres): lens or film bend "
                "what the model holds straight. Self-calibration can take this up."
            )
            evidence = {"test": worst, "means_um": micrometres.round(2).tolist()}
            found.append(Doubt("film-bent", network.camera_names[number], message, 0.5, evidence))
    return found


def _means(
    cell: np.ndarray, residuals: Float64[np.ndarray, "2 rays"], count: np.ndarray
) -> Float64[np.ndarray, "2 cells"]:
    """Mean of each coordinate's residuals in every cell; nought in empty ones."""
    sums = np.stack([np.bincount(cell, axis, len(count)) for axis in residuals])
    return sums / np.maximum(count, 1)


def _listed(names: Sequence[str]) -> str:
    """The first few of many names."""
    shown = ", ".join(names[:4])
    return shown if len(names) <= 4 else f"{shown} and {len(names) - 4} more"
