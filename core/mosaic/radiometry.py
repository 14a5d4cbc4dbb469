"""Tone of every photo, so that neighbours agree where they overlap.

One least-squares problem for the block (METHODS 8) over cells that two photos share. A corrected
gray value is gain * V * gray + offset + tilt * place, with
V = 1 + v1 (r^2 - m1) + v2 (r^4 - m2) + sx x + sy y for all photos of a camera: (x, y) from the
principal point and r their length in half diagonals of the frame, m the means over a square frame.
Priors hold gain 1 and all else 0, which are also the means over the block.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np
from jaxtyping import Float32, Float64
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import spsolve
from shapely import STRtree, box

from core.arrays import Scalars
from core.block import Photo
from core.frames import HALF_PIXEL
from core.geometry.camera import Camera
from core.geometry.robust import CAUCHY_LIMIT, cauchy_weights, solve_robustly
from core.mosaic.overview import Overview, common_cells
from core.raster.files import LUMINANCE
from core.raster.grid import Grid

Unknowns = Float64[np.ndarray, "unknowns"]
"""Gain, offset, tilt to east and north of each photo; then v1, v2, sx and sy of each camera."""
Gray = Float32[np.ndarray, "rows columns"]
# design: so many unknowns
OF_PHOTO, OF_CAMERA = 4, 4
# design: a quarter of a gray value of 8 bits, which are rounded to one
SMALLEST_SCALE = 1e-3
# design: loose: nearly half a stop of exposure; overlaps decide
SIGMA_GAIN = 0.3
"""Prior standard deviation of a gain about 1."""
# design: loose: a veil of a seventh of the range; overlaps decide
SIGMA_OFFSET_SHARE = 0.15
"""Prior standard deviation of an offset about 0, as a share of the full scale."""
# design: half as loose; tilts growing along a block imitate vignetting, which is to be preferred
SIGMA_TILT_SHARE = 0.075
"""Prior standard deviation of a tilt over half a photo about 0, as a share of the full scale."""
HELD = 1e-6  # design: far below a step
"""Prior standard deviation of what is not estimated."""
SIGMA_FALLOFF = 0.3  # design: loose: corners a third darker than the middle
"""Prior standard deviation of a coefficient of vignetting about 0."""
SIGMA_SLOPE = 0.1  # design: loose: one edge of the film a seventh brighter than the other
"""Prior standard deviation of a slope of V over half a diagonal about 0."""
# source: means of r^2 and r^4 over a square whose half diagonal is 1
MEANS = (1 / 3, 7 / 45)
# design: the mean of so many is known to a fortieth of the noise of one
SAMPLES_PER_PAIR = 2000
"""Cells of one overlap that are used at most."""
# design: light, haze and growth differ alike over a quarter of an overlap
INDEPENDENT = 4
"""So many independent ones all samples of an overlap count as: errors add up over many photos."""
SAMPLES_AT_ONCE = 250_000  # design: a hundred megabytes of derivatives
"""Samples that are put into normal equations at a time."""
# design: a corner of a neighbour; what hangs on so little says nothing of the block
LEAST_COMPARED = 0.1
"""Share of the usual cells of a photo that it is compared in, at least, to count for the block."""
ITERATIONS = 20  # design: a limit of time
"""Reweighted solutions."""
# design: a quarter of a gray value of 8 bits; a photo that moved a little does not move others
STEPS = (1 / 512, 0.25 / 255)
"""Gain and falloff, and shares of the full scale are rounded to multiples of these."""
# design: within so few pixels vignetting changes by less than a tenth of a gray value
FALLOFF_CELL_PX = 4
"""Side of the cells over which vignetting is taken as constant, pixels."""


@dataclass(frozen=True, slots=True)
class FilmPlane:
    """Where level ground lies on a photo's film."""

    camera: str
    """Name of the camera."""
    nadir: tuple[float, float]
    """Easting and northing that coordinates count from, metres."""
    film_from_ground: tuple[tuple[float, ...], ...]
    """Homography (3 by 3): metres from the nadir to half diagonals from the principal point."""
    frame: tuple[float, float]
    """Half the width and the height of the picture area, half diagonals."""

    def film(
        self, eastings: Float64[np.ndarray, "..."], northings: Float64[np.ndarray, "..."]
    ) -> Float64[np.ndarray, "... 2"]:
        """Where places on the ground lie from the principal point, x and y in half diagonals."""
        east, north = eastings - self.nadir[0], northings - self.nadir[1]
        x, y, depth = (a * east + b * north + c for a, b, c in self.film_from_ground)
        return np.stack([x, y], axis=-1) / depth[..., None]

    def reaches(self, easting: float, northing: float) -> bool:
        """Whether a place on the ground lies in the picture area."""
        east, north = easting - self.nadir[0], northing - self.nadir[1]
        x, y, depth = (a * east + b * north + c for a, b, c in self.film_from_ground)
        return abs(x) <= abs(depth) * self.frame[0] and abs(y) <= abs(depth) * self.frame[1]


@dataclass(frozen=True, slots=True)
class Balance:
    """Radiometric correction of one photo: gain * V * gray + offset + tilt * place."""

    gain: float = 1.0
    """Factor."""
    offset: float = 0.0
    """Summand, gray values of the scan's type."""
    tilt: tuple[float, float] = (0.0, 0.0)
    """Growth of the summand to the east and to the north, gray values per metre."""
    middle: tuple[float, float] = (0.0, 0.0)
    """Easting and northing at which the tilt is nought, metres."""
    falloff: tuple[float, float] = (0.0, 0.0)
    """v1 and v2 of the camera."""
    plane: FilmPlane | None = None
    """Where the ground lies on the film; None where the camera's vignetting is unknown."""
    slope: tuple[float, float] = (0.0, 0.0)
    """sx and sy of the camera."""
    others: tuple["Balance", ...] = ()
    """Of the second band and those after it; empty where all bands have the same."""

    def of_band(self, band: int) -> "Balance":
        """The balance of a band, counted from 0."""
        return self.others[band - 1] if band and self.others else self

    @property
    def shading(self) -> tuple[float, ...]:
        """The coefficients of V, in the order of `_shapes`."""
        return (*self.falloff, *self.slope)

    @property
    def luminance(self) -> "Balance":
        """The balance of the luminance of colours; exact where its bands are alike."""
        if len(self.others) < len(LUMINANCE) - 1:
            return self
        bands = (self, *self.others[: len(LUMINANCE) - 1])
        shares = np.array(LUMINANCE, dtype=np.float64)
        gains = shares * np.array([one.gain for one in bands])
        shading = gains / gains.sum() @ np.array([one.shading for one in bands])
        tilt = shares @ np.array([one.tilt for one in bands])
        offset = float(shares @ np.array([one.offset for one in bands]))
        return replace(
            self,
            gain=float(gains.sum()),
            offset=offset,
            tilt=(float(tilt[0]), float(tilt[1])),
            falloff=(float(shading[0]), float(shading[1])),
            slope=(float(shading[2]), float(shading[3])),
            others=(),
        )

    def corrected(self, gray: Gray, part: Grid) -> Gray:
        """Gray values of a part of an ortho after the correction."""
        factor = np.float32(self.gain)
        values = gray * (self._shaded(part) * factor if any(self.shading) else factor)
        # Counted from (0, 0), a pixel's place is the same to the last digit in whatever part.
        gsd = part.ground_sample_distance_m
        columns = round(part.west / gsd) + np.arange(part.columns)
        rows = round(-part.north / gsd) + np.arange(part.rows)
        east = self.offset + self.tilt[0] * ((columns + HALF_PIXEL) * gsd - self.middle[0])
        north = -self.tilt[1] * ((rows + HALF_PIXEL) * gsd + self.middle[1])
        values += east.astype(np.float32)[None, :] + north.astype(np.float32)[:, None]
        return values

    def _shaded(self, part: Grid) -> Gray:
        """V of each pixel, constant over small cells that lie alike whatever part is asked for."""
        assert self.plane is not None
        gsd, side = part.ground_sample_distance_m, FALLOFF_CELL_PX
        columns = (round(part.west / gsd) + np.arange(part.columns)) // side
        rows = (round(-part.north / gsd) + np.arange(part.rows)) // side
        east = (np.arange(columns[0], columns[-1] + 1) + HALF_PIXEL) * (gsd * side)
        north = -(np.arange(rows[0], rows[-1] + 1) + HALF_PIXEL) * (gsd * side)
        film = self.plane.film(east[None, :], north[:, None])
        cells = 1 + (_shapes(film) * np.array(self.shading)).sum(axis=-1)
        size = (len(cells[0]) * side, len(cells) * side)
        wide = cv2.resize(cells.astype(np.float32), size, interpolation=cv2.INTER_NEAREST)
        top, left = round(-part.north / gsd) % side, round(part.west / gsd) % side
        return np.asarray(wide)[top : top + part.rows, left : left + part.columns]


def film_plane(photo: Photo, camera: Camera) -> FilmPlane:
    """Where the ground at its mean height lies on the film of an oriented photo."""
    image_from_object = photo.exterior.object_from_image.T
    down = photo.ground_height_m - photo.exterior.centre[2]
    columns = image_from_object @ np.array([[1, 0, 0], [0, 1, 0], [0, 0, down]], dtype=np.float64)
    half = float(np.hypot(*camera.frame_mm)) / 2
    columns[:2] *= -camera.principal_distance_mm / half
    rows = tuple(tuple(float(value) for value in row) for row in columns)
    nadir = (float(photo.exterior.centre[0]), float(photo.exterior.centre[1]))
    width, height = camera.frame_mm
    return FilmPlane(photo.camera, nadir, rows, (width / 2 / half, height / 2 / half))


@dataclass(frozen=True, slots=True, eq=False)
class _Samples:
    """Gray values of pairs of photos at common cells, as parallel arrays; two rows, one a photo."""

    photo: np.ndarray
    """Number of the photo."""
    gray: np.ndarray
    """Gray values, shares of the full scale."""
    place: np.ndarray
    """Easting and northing from the middle of the photo, in half its width (two, samples, 2)."""
    camera: np.ndarray
    """Number of the camera, -1 where it is unknown."""
    shapes: np.ndarray
    """What the camera's coefficients are multiplied by (two, samples, 4)."""
    worth: np.ndarray
    """How many independent samples each stands for (one, samples)."""

    def parts(self) -> "Iterator[tuple[slice, _Samples]]":
        """Some at a time, and which they are."""
        every = (self.photo, self.gray, self.place, self.camera, self.shapes, self.worth)
        for first in range(0, self.gray.shape[1], SAMPLES_AT_ONCE):
            part = slice(first, first + SAMPLES_AT_ONCE)
            yield part, _Samples(*(one[:, part] for one in every))


def balance_orthos(
    overviews: Sequence[Overview],
    full_scale: float = 255.0,
    planes: Mapping[str, FilmPlane] | None = None,
) -> Mapping[str, Balance]:
    """Tone of every photo; gain 1, offset 0 and tilt 0 in the mean of those that overlap.

    Args:
        overviews: The orthos in small, as means over cells: grain is gone there.
        full_scale: Largest gray value.
        planes: Where the ground lies on the film, of photos whose camera is to be corrected.

    Returns:
        The balance of every photo; that of nothing for one without neighbours.
    """
    planes = planes or {}
    cameras = sorted({plane.camera for plane in planes.values()})
    samples = _collect(overviews, full_scale, planes, cameras)
    photos = len(overviews)
    unknowns = _rounded(_adjust(samples, photos, len(cameras)), photos)
    shadings = unknowns[OF_PHOTO * photos :].reshape(-1, OF_CAMERA).tolist()
    found: dict[str, Balance] = {}
    for view, (gain, offset, *tilt) in zip(
        overviews, unknowns[: OF_PHOTO * photos].reshape(-1, OF_PHOTO).tolist(), strict=True
    ):
        plane, middle = planes.get(view.photo_id), _middle(view)
        shading = [0.0] * OF_CAMERA if plane is None else shadings[cameras.index(plane.camera)]
        east, north = (full_scale * one / _half_m(view) for one in tilt)
        found[view.photo_id] = Balance(
            gain,
            offset * full_scale,
            (east, north),
            middle,
            falloff=(shading[0], shading[1]),
            plane=plane,
            slope=(shading[2], shading[3]),
        )
    return found


def _rounded(unknowns: Unknowns, photos: int) -> Unknowns:
    """Gains and falloffs, offsets and tilts in whole steps."""
    steps = np.full(unknowns.shape, STEPS[0])
    for kind in range(1, OF_PHOTO):
        steps[kind : OF_PHOTO * photos : OF_PHOTO] = STEPS[1]
    return np.rint(unknowns / steps) * steps


def _middle(view: Overview) -> tuple[float, float]:
    west, south, east, north = view.grid.bounds
    return (west + east) / 2, (south + north) / 2


def _half_m(view: Overview) -> float:
    """Half the longest side of an ortho, metres."""
    return max(view.grid.columns, view.grid.rows) * view.grid.ground_sample_distance_m / 2


def _shapes(film: Float64[np.ndarray, "... 2"]) -> Float64[np.ndarray, "... 4"]:
    """r^2 and r^4 less their means, x and y."""
    squared = (film**2).sum(axis=-1)
    powers = np.stack([squared - MEANS[0], squared**2 - MEANS[1]], axis=-1)
    return np.concatenate([powers, film], axis=-1)


def _collect(
    overviews: Sequence[Overview],
    full_scale: float,
    planes: Mapping[str, FilmPlane],
    cameras: Sequence[str],
) -> _Samples:
    """What pairs of photos show of the same cells."""
    parts: list[tuple[np.ndarray, ...]] = []
    for numbers in _meeting(overviews):
        views = [overviews[number] for number in numbers]
        common = common_cells(*views)
        step = max(1, len(common.first) // SAMPLES_PER_PAIR)
        places = common.places[::step]
        grays = np.stack([common.first[::step], common.second[::step]]) / full_scale
        if not len(places):
            continue
        own = [planes.get(view.photo_id) for view in views]
        sides = [_seen(*side) for side in zip(views, [places] * 2, own, strict=True)]
        by_camera = [-1 if plane is None else cameras.index(plane.camera) for plane in own]
        parts.append(
            (
                np.repeat(np.array(numbers, np.int32)[:, None], len(places), axis=1),
                grays,
                np.stack([side[0] for side in sides]),
                np.repeat(np.array(by_camera, np.int32)[:, None], len(places), axis=1),
                np.stack([side[1] for side in sides]),
                np.full((1, len(places)), min(1.0, INDEPENDENT / len(places))),
            )
        )
    if not parts:
        none, flat, number = np.zeros((2, 0, 2)), np.zeros((2, 0)), np.zeros((2, 0), np.int32)
        return _Samples(number, flat, none, number, np.zeros((2, 0, OF_CAMERA)), flat)
    return _Samples(*(np.concatenate(one, axis=1) for one in zip(*parts, strict=True)))


def _meeting(overviews: Sequence[Overview]) -> list[tuple[int, int]]:
    """Numbers of the pairs whose grids overlap, in order."""
    boxes = [box(*view.grid.bounds) for view in overviews]
    found = STRtree(boxes).query(boxes, predicate="intersects").T.tolist()
    return sorted((first, second) for first, second in found if first < second)


def _seen(
    view: Overview, places: np.ndarray, plane: FilmPlane | None
) -> tuple[np.ndarray, np.ndarray]:
    """Places in a photo from its middle, in half its width, and the shapes of V there."""
    about = (places - np.array(_middle(view))) / _half_m(view)
    if plane is None:
        return about, np.zeros((len(places), OF_CAMERA))
    return about, _shapes(plane.film(places[:, 0], places[:, 1]))


def _adjust(samples: _Samples, photos: int, cameras: int) -> Unknowns:
    """All unknowns (shares of the full scale), by reweighted Gauss-Newton steps."""
    given = np.concatenate([np.tile([1.0, 0.0, 0.0, 0.0], photos), np.zeros(OF_CAMERA * cameras)])
    # Where no vignetting is estimated, tilts growing along the block would stand in for it.
    tilt = SIGMA_TILT_SHARE if cameras else HELD
    sigmas = [SIGMA_GAIN, SIGMA_OFFSET_SHARE, tilt, tilt]
    of_camera = [SIGMA_FALLOFF, SIGMA_FALLOFF, SIGMA_SLOPE, SIGMA_SLOPE]
    every = np.concatenate([np.tile(sigmas, photos), np.tile(of_camera, cameras)])
    held = sparse.diags_array(every**-2.0) + _hold_means(samples, photos, len(given))
    unknowns = given.copy()

    def solve(weights: Scalars) -> tuple[Unknowns, Scalars]:
        nonlocal unknowns
        normal, right = held, held @ (unknowns - given)
        for where, part in samples.parts():
            scaled = weights[where] * part.worth[0]
            design = _derivatives(part, unknowns, photos)
            normal = design.T @ sparse.diags_array(scaled) @ design + normal
            right = design.T @ (scaled * _misfits(part, unknowns, photos)) + right
        step = np.array(spsolve(sparse.csc_array(normal), right), dtype=np.float64).ravel()
        unknowns = unknowns - step
        return unknowns, lengths()

    def lengths() -> Scalars:
        found = np.zeros(samples.gray.shape[1])
        for where, part in samples.parts():
            found[where] = np.abs(_misfits(part, unknowns, photos))
        return found

    # Ground that changed between two photos is no noise: it loses all its weight.
    weigh = partial(cauchy_weights, limit=CAUCHY_LIMIT)
    return solve_robustly(solve, lengths(), weigh, passes=ITERATIONS, least_scale=SMALLEST_SCALE)


def _hold_means(samples: _Samples, photos: int, unknowns: int) -> sparse.csc_array:
    """The means over the block are held: else noise would pull every gain down a little.

    A photo that next to nothing is compared with has no part in them: it could take on what all
    others are off. Photos that do not hang together have means of their own.
    """
    counts = np.bincount(samples.photo.ravel(), minlength=photos)
    usual = float(np.median(counts[counts > 0])) if counts.any() else 1.0
    fair = counts > LEAST_COMPARED * usual
    links = samples.photo[:, fair[samples.photo].all(axis=0)]
    pairs = sparse.coo_array((np.ones(links.shape[1]), (links[0], links[1])), (photos, photos))
    parts = np.asarray(connected_components(pairs, directed=False)[1])
    whole = np.unique(parts[fair])
    mean = np.zeros((OF_PHOTO * len(whole), unknowns))
    for row, part in enumerate(whole.tolist()):
        members = np.flatnonzero(fair & (parts == part))
        for kind in range(OF_PHOTO):
            mean[OF_PHOTO * row + kind, OF_PHOTO * members + kind] = 1.0
    rows = sparse.csc_array(mean)
    # design: so much heavier than all samples that the mean stays to the last digits told
    return sparse.csc_array(rows.T @ rows) * 1e13


def _shading(samples: _Samples, side: int, unknowns: Unknowns, photos: int) -> Scalars:
    """V of each sample in its first or second photo."""
    own = unknowns[OF_PHOTO * photos :].reshape(-1, OF_CAMERA)
    # The last row is that of the number -1.
    by_camera = np.vstack([own, np.zeros((1, OF_CAMERA))])
    return 1 + (by_camera[samples.camera[side]] * samples.shapes[side]).sum(axis=1)


def _misfits(samples: _Samples, unknowns: Unknowns, photos: int) -> Scalars:
    """Corrected gray of the first photo less that of the second, by the noise of both."""
    own = unknowns[: OF_PHOTO * photos].reshape(-1, OF_PHOTO)
    apart = np.zeros(samples.gray.shape[1])
    for side, sign in enumerate((1.0, -1.0)):
        photo, gray, place = samples.photo[side], samples.gray[side], samples.place[side]
        toned = own[photo, 0] * _shading(samples, side, unknowns, photos) * gray
        apart += sign * (toned + own[photo, 1] + (own[photo, 2:] * place).sum(1))
    return apart / _noise_gains(samples, unknowns, photos)


def _derivatives(samples: _Samples, unknowns: Unknowns, photos: int) -> sparse.csr_array:
    """Of the misfits, by all unknowns.

    That the correction enlarges noise is derived too: both photos have noise, and gains would else
    shrink.
    """
    count = samples.gray.shape[1]
    rows, columns, values = [], [], []
    noise, misfits = _noise_gains(samples, unknowns, photos), _misfits(samples, unknowns, photos)
    for side, sign in enumerate((1.0, -1.0)):
        photo, camera = samples.photo[side], samples.camera[side]
        place, gain = samples.place[side], unknowns[OF_PHOTO * photo]
        shading = _shading(samples, side, unknowns, photos)
        by_factor = sign * samples.gray[side] - misfits * gain * shading / (2 * noise)
        by_shape = (gain * by_factor)[:, None] * samples.shapes[side]
        by_shape = np.where(camera[:, None] < 0, 0.0, by_shape)
        first = OF_PHOTO * photos + OF_CAMERA * np.maximum(camera, 0)
        terms = [shading * by_factor, np.full(count, sign), *(sign * place).T]
        for kind, term in enumerate(terms):
            rows.append(np.arange(count))
            columns.append(OF_PHOTO * photo + kind)
            values.append(term / noise)
        for kind in range(OF_CAMERA if len(unknowns) > OF_PHOTO * photos else 0):
            rows.append(np.arange(count))
            columns.append(first + kind)
            values.append(by_shape[:, kind] / noise)
    placed = (np.concatenate(rows), np.concatenate(columns))
    return sparse.csr_array((np.concatenate(values), placed), shape=(count, len(unknowns)))


def _noise_gains(samples: _Samples, unknowns: Unknowns, photos: int) -> Scalars:
    """What gains and shading make of a sample's noise, 1 where all are 1."""
    factors = [
        unknowns[OF_PHOTO * samples.photo[side]] * _shading(samples, side, unknowns, photos)
        for side in (0, 1)
    ]
    return np.hypot(*factors) / np.sqrt(2)
