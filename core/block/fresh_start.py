"""The block begun anew from where its photos were found to stand, in coarse steps.

An archive's georeference leaves traces in all that is computed from it: which parts of two photos
are compared, where a search begins, how a patch is warped. None decides much, yet of eighty control
measurements a few would be others, and the block would end elsewhere by a good part of its error.
So a first look only finds out where the photos stand. Rounded to steps far wider than two first
looks ever differ, that is what everything after depends on: the same photos on the same reference
end alike to the last digit, however they came, unless a value lies on the border of two steps.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from core.block.approximation import Approximation
from core.block.block import Block, ExteriorPrior, Photo
from core.block.least_squares.positioning import MEASURED_M
from core.block.ties.pairs import ground_of
from core.geometry.crs import Bounds
from core.geometry.exterior import ExteriorOrientation

UNDER_M = 1500.0
"""The ground under a photo is what lies within this of its middle, metres."""
STEPS_FROM_M = 1000.0
"""What steps of the height are counted from: so those of `StartOptions` have their borders aside of
heights that are flown most, 1000, 1200, 1500, 1800, 2000, 2500, 3000 and 5000 m, and of photos
1 : 10 000 and 1 : 20 000 with 153 and 210 mm."""


@dataclass(frozen=True, slots=True)
class StartOptions:
    """Steps of the start, and what is known of tilts."""

    place: float = 0.2
    """Step of a photo's place along either axis, as a share of its width on the ground."""
    kappa: float = float(np.radians(5.0))
    """Step of kappa, radians."""
    height: float = 0.09
    """Step of the height over ground, as a share of it."""
    tilt: float = float(np.radians(3.0))
    """Standard deviation of omega and phi, which begin at nought, radians."""


def started_anew(
    standing: Block,
    known: Mapping[str, Approximation],
    mean_height: Callable[[Bounds], float],
    options: StartOptions | None = None,
) -> tuple[dict[str, Photo], dict[str, Approximation]]:
    """Approximate orientations of the photos that stand, rounded to coarse steps.

    Photos that do not stand, those that were placed by clicks, and those whose perspective centre
    was measured in flight keep what is known of them: it may be all that lets them stand.

    Args:
        standing: The block as a first look found it; `approximate` is what its source told.
        known: By photo, what its source told.
        mean_height: Mean height of the ground within bounds, metres; NaN where there is none.
        options: Steps.

    Returns:
        The photos, none of them oriented, and what is known of each from now on.
    """
    options = options or StartOptions()
    photos = {name: _as_it_came(photo) for name, photo in standing.photos.items()}
    found = dict(known)
    anew = {
        name: photo
        for name, photo in standing.photos.items()
        if known[name].source != "points" and _begins_anew(photo)
    }
    if not anew:
        return photos, found
    widths = [photo.width_m(standing.camera_of(name)) for name, photo in anew.items()]
    step_m = float(2.0 ** np.round(np.log2(options.place * np.median(widths))))
    usual = float(np.median([_above_m(photo) for photo in anew.values()]))
    for name, photo in anew.items():
        middle = step_m * np.round(_middle(standing, name) / step_m)
        reach = np.array([-UNDER_M, -UNDER_M, UNDER_M, UNDER_M]) + np.tile(middle, 2)
        height = mean_height((float(reach[0]), float(reach[1]), float(reach[2]), float(reach[3])))
        ground = photo.ground_height_m if np.isnan(height) else height
        # Photos of one flight stand equally high: only how high the flight was is rounded by
        # itself, or photos near the border of two steps would begin at heights of their own.
        flown = STEPS_FROM_M * _stepped(usual / STEPS_FROM_M, options.height)
        above = flown * _stepped(_above_m(photo) / usual, options.height)
        kappa = _direction(photo.exterior.kappa, options.kappa)
        exterior = ExteriorOrientation(np.array([*middle, ground + above]), 0.0, 0.0, kappa)
        prior = _prior(step_m, above, options)
        photos[name] = replace(
            photos[name],
            exterior=exterior,
            approximate=exterior,
            prior=prior,
            ground_height_m=ground,
        )
        found[name] = Approximation(exterior, prior, known[name].source, (exterior,))
    return photos, found


def _as_it_came(photo: Photo) -> Photo:
    """A photo where its source put it."""
    return photo.with_exterior(photo.approximate, oriented=False)


def _begins_anew(photo: Photo) -> bool:
    """Whether a photo stands, and nothing better than a georeference says where."""
    return photo.oriented and bool(np.any(photo.prior.sigma_centre_m > MEASURED_M))


def _above_m(photo: Photo) -> float:
    """Height of the perspective centre over the ground, metres."""
    return float(photo.exterior.centre[2]) - photo.ground_height_m


def _middle(block: Block, name: str) -> np.ndarray:
    """Ground under the principal point, easting and northing, metres: what a tilt moves least."""
    photo, camera = block.photos[name], block.camera_of(name)
    pixel = photo.interior.pixel_from_film(np.array([camera.principal_point_mm]))
    return ground_of(photo, camera, pixel)[0, :2]


def _stepped(value: float, step: float) -> float:
    """The power of 1 + step that is nearest to a value."""
    return float((1 + step) ** np.round(np.log(value) / np.log1p(step)))


def _direction(kappa: float, step: float) -> float:
    """The multiple of a step nearest to an angle; half a turn is one, whichever its sign."""
    around = round(2 * np.pi / step)
    number = round(kappa / step) % around
    return step * (number if number <= around / 2 else number - around)


def _prior(step_m: float, above_m: float, options: StartOptions) -> ExteriorPrior:
    """What rounding leaves open; a tilt also moves the perspective centre over its ground."""
    even = 1 / np.sqrt(12)
    plan = float(np.hypot(even * step_m, above_m * options.tilt))
    return ExteriorPrior(
        np.array([plan, plan, even * options.height * above_m]),
        np.array([options.tilt, options.tilt, even * options.kappa]),
    )
