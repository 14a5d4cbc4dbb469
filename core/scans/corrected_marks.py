"""Fiducials that a person corrected after they were found: the interior orientation follows."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from core.arrays import FilmPoints, PixelPoints
from core.doubts import Doubt, Failure
from core.geometry.camera import Camera
from core.geometry.interior import InteriorOrientation, fit_interior
from core.geometry.transforms import PlaneTransform, fit_similarity
from core.scans.film_area import area_from_interior
from core.scans.hand_marks import HAND_SIGMA_PX
from core.scans.interior_doubts import doubts_of_fit
from core.scans.interior_orientation import ScanOrientation
from core.scans.measured_marks import FiducialMeasurement

FOUND_SIGMA_PX = 0.1
"""Standard deviation of a found mark whose own is not known any more, pixels."""
BY_HAND = "by hand"
"""Kind of a mark that a person measured."""
OF_FIT = frozenset(
    {
        "fiducial-left-out", "fiducials-few", "fiducial-residual", "scan-mirrored",
        "fiducials-scale", "film-shrinkage", "interior-nominal", "fiducials-of-another-camera",
        "fiducials-not-found",
    }
)  # fmt: skip
"""Doubts that are raised anew once the marks are others."""


@dataclass(frozen=True, slots=True)
class MarkChange:
    """What a person said about one fiducial of one scan."""

    place: tuple[float, float] | None = None
    """Column and row where it was measured by hand; None leaves it where it was found."""
    use: bool = True
    """False for a mark that cannot be seen, or is not to be used."""


Changes = Mapping[str, MarkChange]
"""By the name of the mark."""


def corrected_scans(
    oriented: Mapping[str, ScanOrientation],
    cameras: Mapping[str, Camera],
    pixels_mm: Mapping[str, float],
    changes: Mapping[str, Changes],
) -> dict[str, ScanOrientation]:
    """The scans of one or several cameras with corrected marks; the others stay as they are.

    Args:
        oriented: Scans by photo, as they were found.
        cameras: Camera of each photo, with the certified places of its marks.
        pixels_mm: Nominal size of a scan pixel by photo, millimetres.
        changes: What was said, by photo.
    """
    corrected = {
        name: corrected_scan(scan, cameras[name], pixels_mm[name], changes[name])
        for name, scan in oriented.items()
        if changes.get(name)
    }
    result = {**oriented, **corrected}
    for name in corrected:
        family = [one.interior for k, one in result.items() if cameras[k] is cameras[name]]
        fitted = [one for one in family if one.redundancy]
        interior = corrected[name].interior
        if len(fitted) < 2 or interior.model == "nominal":
            continue
        equations = sum(one.redundancy for one in fitted)
        factor = sum(one.variance_factor * one.redundancy for one in fitted) / equations
        result[name] = replace(corrected[name], interior=interior.with_variance_factor(factor))
    return result


def corrected_scan(
    scan: ScanOrientation, camera: Camera, pixel_mm: float, changes: Changes
) -> ScanOrientation:
    """One scan with its interior orientation from corrected marks.

    Where they do not fit their certificate the orientation stays what it was, with a doubt.
    """
    found = {mark.name: mark for mark in scan.fiducials}
    for name, change in changes.items():
        if change.place is not None and name in camera.fiducials_mm:
            found[name] = FiducialMeasurement(name, *change.place, HAND_SIGMA_PX, 1.0, 0.0, BY_HAND)
    marks = tuple(found[name] for name in camera.fiducials_mm if name in found)
    used = [mark for mark in marks if changes.get(mark.name, MarkChange()).use]
    doubts = tuple(doubt for doubt in scan.doubts if not _settled(doubt, changes))
    pixels = np.array([(mark.column, mark.row) for mark in used]).reshape(-1, 2)
    film = np.array([camera.fiducials_mm[mark.name] for mark in used]).reshape(-1, 2)
    sigmas = np.array([mark.sigma_px for mark in used])
    names = [mark.name for mark in used]
    back = _from_behind(pixels, film) if scan.interior.model == "nominal" else scan.way[1]
    fitted = fit_interior(names, pixels, film, "auto", sigmas_px=sigmas, mirrored=back)
    if isinstance(fitted, Failure):
        doubt = Doubt(
            "fiducials-corrected",
            scan.photo_id,
            f"With the corrected fiducials there is no interior orientation ({fitted.reason}): it "
            "stays what it was. Look at the marks of this scan again.",
            evidence={"fiducials": names},
        )
        return replace(scan, fiducials=marks, doubts=(*doubts, doubt))
    kept = tuple(doubt for doubt in doubts if doubt.kind not in OF_FIT)
    return replace(
        scan,
        interior=fitted,
        fiducials=marks,
        doubts=(*kept, *doubts_of_fit(scan.photo_id, fitted, used, pixel_mm)),
        area=scan.area if scan.area.seen else area_from_interior(fitted, camera),
    )


def corrected_interior(
    interior: InteriorOrientation, camera: Camera, changes: Changes
) -> InteriorOrientation:
    """An interior orientation with corrected marks; as it is where nothing of it changes.

    For a block whose scans are not at hand: marks that were found count as good as usual ones.
    """
    certified = _certified(interior, camera)
    places = dict(zip(interior.names, interior.pixels.tolist(), strict=True))
    before = dict(places)
    by_hand: set[str] = set()
    for name, change in changes.items():
        if change.place is not None and name in certified:
            places[name] = [*change.place]
            by_hand.add(name)
        if not change.use:
            places.pop(name, None)
    if places == before:
        return interior
    names = list(places)
    pixels = np.array([places[name] for name in names]).reshape(-1, 2)
    film = np.array([certified[name] for name in names]).reshape(-1, 2)
    sigmas = np.array([HAND_SIGMA_PX if n in by_hand else FOUND_SIGMA_PX for n in names])
    back = interior.mirrored if interior.names else _from_behind(pixels, film)
    fitted = fit_interior(names, pixels, film, "auto", sigmas_px=sigmas, mirrored=back)
    return interior if isinstance(fitted, Failure) else fitted


def _certified(
    interior: InteriorOrientation, camera: Camera
) -> dict[str, tuple[float, float] | list[float]]:
    """Where each mark lies on the film, millimetres; of marks in use as they were fitted."""
    fitted = interior.film_from_pixel(interior.pixels) - interior.residuals_um / 1000
    return {**camera.fiducials_mm, **dict(zip(interior.names, fitted.tolist(), strict=True))}


def _settled(doubt: Doubt, changes: Changes) -> bool:
    """True for a doubt about a mark that a person has looked at."""
    return doubt.evidence.get("fiducial") in changes


def _from_behind(pixels: PixelPoints, film: FilmPoints) -> bool:
    """Whether marks lie as in a film that was scanned from its back; two cannot tell."""
    if len(pixels) < 3:
        return False
    fits: Sequence[PlaneTransform | Failure] = [
        fit_similarity(pixels, film, mirrored=not back) for back in (False, True)
    ]
    rms = [fit.rms if isinstance(fit, PlaneTransform) else np.inf for fit in fits]
    return bool(rms[1] < rms[0])
