"""Where surveyed points lie in the photos that show them, and how well that is known, in pixels.

With the film point x = p(d, X) of a photo and camera d and a point X, and J their derivatives,

    C = J_d C_d J_d^T + J_X C_X J_X^T

is the covariance of the prediction. C_d is that of the adjusted photo and its camera's constants,
or of the prior where the photo took no part. A point that has already steered the block is taken as
if it had not: the ellipse is then somewhat too large. Additional parameters are left out.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from core.adjustment.equations import Rows
from core.adjustment.influence import Influence
from core.adjustment.network import CONSTANTS
from core.arrays import Flags, ObjectPoints, PixelPoints, Position, Scalars
from core.block import Block, Measurement, Photo, SurveyedPoint
from core.geometry.camera import Camera
from core.geometry.collinearity import FilmPartials, film_partials

Covariance = Float64[np.ndarray, "told told"]
"""Of centre (metres), rotation increments (radians) and, told is 11, of the principal distance,
principal point (millimetres), k1 and k2; for a sigma nought of one."""
Covariances = Mapping[str, Covariance]
"""By photo; those that took no part in the adjustment are not in it."""
# design: what one does not know well oneself, one does not call better than it was said to be.
LEAST_UNIT = 1.0
"""Sigma nought is taken as no less than this."""
# design: half the width of a mark's window; there is nothing to see beside it.
EDGE_MM = 2.0
"""So near the border of the frame a point is looked at last."""


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """One surveyed point in one photo."""

    point_id: str
    """The surveyed point."""
    photo_id: str
    """The photo."""
    column: float
    """Pixels, corner origin."""
    row: float
    """Pixels, corner origin."""
    covariance: Float64[np.ndarray, "2 2"]
    """Of column and row, square pixels."""
    nadir_angle: float
    """Between the ray and the plumb line, radians."""
    margin_mm: float
    """Distance to the border of the frame, millimetres."""

    @property
    def key(self) -> tuple[str, str]:
        """Point and photo."""
        return self.point_id, self.photo_id

    @property
    def view(self) -> tuple[bool, float]:
        """Best view first: away from the border, then near the nadir."""
        return self.margin_mm < EDGE_MM, self.nadir_angle

    def sigmas_away(self, column: float, row: float, sigma_px: float) -> float:
        """Distance of a measured place, in standard deviations."""
        away = np.array([column - self.column, row - self.row])
        covariance = self.covariance + sigma_px**2 * np.eye(2)
        return float(np.sqrt(away @ np.linalg.solve(covariance, away)))


def covariances_of(influence: Influence) -> dict[str, Covariance]:
    """Covariance of every photo that took part, with its camera where that was estimated."""
    network, precision = influence.solution.network, influence.solution.precision
    found: dict[str, Covariance] = {}
    for row, photo in enumerate(network.photos):
        own = precision.photos[row]
        if network.lensed:
            camera = int(network.camera[row])
            told = slice(network.lens * camera, network.lens * camera + CONSTANTS)
            scale = network.scale[camera, :CONSTANTS]
            mixed = precision.mixed[row][:, told] / scale
            shared = precision.constants[told, told] / np.outer(scale, scale)
            own = np.block([[own, mixed], [mixed.T, shared]])
        found[photo.photo_id] = own
    return found


class JointErrors:
    """Errors of all photos of an adjusted block together: what photos share cancels out.

    Two photos that are off together show a place of one where the other expects it, however far
    both are off.
    """

    def __init__(self, influence: Influence, sigma_nought: float) -> None:
        """The equations, and the sigma nought of their adjustment."""
        self._equations = influence.equations
        self._photos = influence.solution.network.photos
        self._rows = {photo.photo_id: row for row, photo in enumerate(self._photos)}
        self._unit = max(LEAST_UNIT, sigma_nought) ** 2

    def know(self, photo_ids: Iterable[str]) -> bool:
        """Whether all of some photos took part in the adjustment."""
        return all(name in self._rows for name in photo_ids)

    def of_ray(
        self, photo: Photo, camera: Camera, position: Position
    ) -> tuple[Rows, Float64[np.ndarray, "2 3"]]:
        """How the pixel of a place follows all unknowns, and the place: (2, n) and (2, 3) pixels.

        Args:
            photo: One that took part.
            camera: Its camera.
            position: The place, metres.
        """
        ray = Measurement("", photo.photo_id, 0.0, 0.0, 1.0)
        by_unknowns, by_point = self._equations.of_free_ray(
            self._rows[photo.photo_id], ray, position
        )
        film = photo.interior.film_from_pixel(photo.pixel_from_object(position[None], camera))
        # A ray known to a pixel counts in its size on the film.
        to_pixels = _pixels_by_film(photo, film)[0] * photo.interior.pixel_size_mm
        return to_pixels @ by_unknowns, to_pixels @ by_point

    def covariance(self, rows: Rows) -> Float64[np.ndarray, "rows rows"]:
        """Covariance of what follows the unknowns by some rows."""
        return self._unit * rows @ self._equations.cofactors(rows)


def prior_covariance(photo: Photo) -> Covariance:
    """What was known of a photo beforehand."""
    prior = photo.prior
    return np.diag(np.concatenate([prior.sigma_centre_m, prior.sigma_angles]) ** 2)


def predict_points(
    block: Block,
    points: Sequence[SurveyedPoint],
    covariances: Covariances,
    sigma_nought: float = 1.0,
    places: Mapping[str, Float64[np.ndarray, "3 3"]] | None = None,
) -> dict[tuple[str, str], Prediction]:
    """Every point in every photo whose picture area shows it, best view of each point first.

    Args:
        block: Photos and cameras as adjusted.
        points: What is sought, with coordinates and their standard deviations.
        covariances: Of the photos that took part in the adjustment.
        sigma_nought: Of that adjustment.
        places: Covariances of points whose coordinates do not err independently, square metres.
    """
    found: list[Prediction] = []
    if not points:
        return {}
    positions = np.array([point.position for point in points])
    whole = places or {}
    spaces = np.array([whole.get(p.point_id, np.diag(p.sigma_m**2)) for p in points])
    unit = max(sigma_nought, LEAST_UNIT) ** 2
    for name, photo in block.photos.items():
        camera = block.camera_of(name)
        pixels, margins = shown_in(photo, camera, positions)
        seen = np.flatnonzero(margins > 0)
        if not len(seen):
            continue
        known = covariances.get(name)
        own = prior_covariance(photo) if known is None else unit * known
        spreads = pixel_spreads(photo, camera, positions[seen], own, spaces[seen])
        angles = _nadir_angles(photo, positions[seen])
        found += [
            Prediction(
                points[i].point_id,
                name,
                float(pixels[i, 0]),
                float(pixels[i, 1]),
                spread,
                nadir_angle=float(angle),
                margin_mm=float(margins[i]),
            )
            for i, spread, angle in zip(seen.tolist(), spreads, angles, strict=True)
        ]
    found.sort(key=lambda one: (one.point_id, one.view))
    return {one.key: one for one in found}


def shown_in(photo: Photo, camera: Camera, positions: ObjectPoints) -> tuple[PixelPoints, Scalars]:
    """Pixels of object points, and how far within the picture they lie.

    Returns:
        Pixels (n, 2), and distances to the border of the frame, millimetres: not above nought
        outside of it, beside the scan, and behind the camera.
    """
    pixels = photo.pixel_from_object(positions, camera)
    sound: Flags = np.all(np.isfinite(pixels), axis=1, keepdims=False)
    film = photo.interior.film_from_pixel(np.where(sound[:, None], pixels, 0.0))
    margins = (np.array(camera.frame_mm) / 2 - np.abs(film)).min(axis=1)
    on_scan = ((pixels > 0) & (pixels < np.array(photo.size_px))).all(axis=1)
    return pixels, np.where(sound & on_scan, margins, -np.inf)


def pixel_spreads(
    photo: Photo,
    camera: Camera,
    positions: ObjectPoints,
    own: Covariance,
    spaces: Float64[np.ndarray, "points 3 3"] | None = None,
) -> Float64[np.ndarray, "points 2 2"]:
    """Covariances of projected pixels, by those of the photo and, where they err, of the points."""
    partials = film_partials(positions, photo.exterior, camera, photo.atmosphere)
    rows = _by_told(partials, len(own))
    by_point = np.moveaxis(partials.by_centre, 2, 0)
    film = rows @ own @ np.swapaxes(rows, 1, 2)
    if spaces is not None:
        film += by_point @ spaces @ np.swapaxes(by_point, 1, 2)
    to_pixels = _pixels_by_film(photo, partials.film.T)
    return to_pixels @ film @ np.swapaxes(to_pixels, 1, 2)


def plan_errors(
    photo: Photo,
    camera: Camera,
    positions: ObjectPoints,
    own: Covariance,
    sigmas_m: Float64[np.ndarray, "3"],
) -> tuple[Float64[np.ndarray, "points 2 told"], Float64[np.ndarray, "points 2 3"]]:
    """How the place (east, north) where the ortho of a photo shows object points follows errors.

    Args:
        photo: The photo.
        camera: Its camera.
        positions: The points, metres.
        own: Covariance of the photo.
        sigmas_m: Standard deviations of the points themselves; an error of the height of the ground
            displaces them.

    Returns:
        Metres by independent errors of one standard deviation each: those of the photo, common to
        all points, and those of each point.
    """
    partials = film_partials(positions, photo.exterior, camera, photo.atmosphere)
    to_plan = np.linalg.inv(pixels_by_plan(photo, camera, positions)) @ _pixels_by_film(
        photo, partials.film.T
    )
    strengths, directions = np.linalg.eigh(own)
    # Rounding may leave what is known best a little below nought.
    independent = directions * np.sqrt(np.maximum(strengths, 0.0))
    by_point = np.moveaxis(partials.by_centre, 2, 0) * sigmas_m
    return to_plan @ _by_told(partials, len(own)) @ independent, to_plan @ by_point


def pixels_by_plan(
    photo: Photo, camera: Camera, positions: ObjectPoints
) -> Float64[np.ndarray, "points 2 2"]:
    """Scan pixels per metre east and per metre north at object points."""
    # design: a metre, over which no photo bends.
    columns = [
        photo.pixel_from_object(positions + step, camera)
        - photo.pixel_from_object(positions, camera)
        for step in np.eye(3)[:2]
    ]
    return np.stack(columns, axis=2)


def _by_told(partials: FilmPartials, told: int) -> Float64[np.ndarray, "points 2 told"]:
    """How film points follow what a covariance tells of their photo."""
    parts = [partials.by_centre, partials.by_rotation, partials.by_camera]
    return np.moveaxis(np.concatenate(parts, axis=1)[:, :told], 2, 0)


def _pixels_by_film(
    photo: Photo, film: Float64[np.ndarray, "points 2"]
) -> Float64[np.ndarray, "points 2 2"]:
    """How pixels follow film points, pixels per millimetre."""
    # design: a tenth of a millimetre is some pixels, over which no interior orientation bends.
    step = 0.1
    columns = [
        photo.interior.pixel_from_film(film + shift) - photo.interior.pixel_from_film(film - shift)
        for shift in step * np.eye(2)
    ]
    return np.stack(columns, axis=2) / (2 * step)


def _nadir_angles(photo: Photo, positions: ObjectPoints) -> Scalars:
    """Angles between rays and the plumb line, radians."""
    offsets = positions - photo.exterior.centre
    return np.arctan2(np.hypot(offsets[:, 0], offsets[:, 1]), -offsets[:, 2])
