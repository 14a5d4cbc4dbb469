"""How the ground a photo shows moves with orientation and camera, at its nine Gruber places."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from core.adjustment.banded import SIZE
from core.adjustment.linearised import by_scaled_camera, ray_models
from core.adjustment.network import Network, State
from core.geometry.collinearity import stacked_partials

# design: just inside the frame, where photos are still measured.
REACH = 0.9
"""Outer places, as a share of half the frame."""
# source: the nine Gruber places of a photo.
PLACES = 9

Steps = Float64[np.ndarray, "unknowns steps"]
"""Changes of all photos' and shared unknowns."""


@dataclass(frozen=True, slots=True, eq=False)
class GroundShifts:
    """Derivatives of places on the ground (at their height) by the unknowns, metres."""

    by_photo: Float64[np.ndarray, "photos 9 2 6"]
    """By each photo's centre and rotation."""
    by_camera: Float64[np.ndarray, "photos 9 2 told"]
    """By the scaled unknowns of its camera; empty when cameras are held."""
    camera_start: Float64[np.ndarray, "photos"]
    """First unknown of its camera among the shared ones."""

    def of(self, steps: Steps) -> Float64[np.ndarray, "photos 9 2 steps"]:
        """Shifts (E, N) of every place, metres."""
        photos, told = len(self.by_photo), self.by_camera.shape[3]
        own = steps[: SIZE * photos].reshape(photos, 1, SIZE, -1)
        moved = self.by_photo @ own
        if told:
            rows = self.camera_start.astype(np.int64)[:, None] + np.arange(told)
            moved = moved + self.by_camera @ steps[SIZE * photos + rows][:, None]
        return moved

    def largest(self, steps: Steps) -> Float64[np.ndarray, "steps"]:
        """Largest shift each step brings about, metres."""
        return np.linalg.norm(self.of(steps), axis=2).max(axis=(0, 1))

    def covariances(
        self,
        own: Float64[np.ndarray, "photos 6 6"],
        mixed: Float64[np.ndarray, "photos 6 shared"],
        shared: Float64[np.ndarray, "shared shared"],
    ) -> Float64[np.ndarray, "photos 9 2 2"]:
        """Covariance (E, N) of every place from that of the unknowns, square metres."""
        found = self.by_photo @ own[:, None] @ np.swapaxes(self.by_photo, 2, 3)
        told = self.by_camera.shape[3]
        if told:
            for photo in range(len(own)):
                first = int(self.camera_start[photo])
                part = slice(first, first + told)
                cross = self.by_photo[photo] @ mixed[photo][:, part]
                cross = cross @ np.swapaxes(self.by_camera[photo], 1, 2)
                found[photo] += cross + np.swapaxes(cross, 1, 2)
                camera = self.by_camera[photo]
                found[photo] += camera @ shared[part, part] @ np.swapaxes(camera, 1, 2)
        return found


def ground_shifts_of(network: Network, state: State) -> GroundShifts:
    """The nine places of every photo of a network: three by three over the frame.

    Of a film point (f = const) at fixed height: dX = f_C,plan^-1 (f_C dC + f_w dw + f_c dc).
    """
    count = len(network.photos)
    line = REACH * np.array([-1.0, 0.0, 1.0])
    grid = np.array([(x, y) for y in line[::-1] for x in line])
    half = np.array([np.array(camera.frame_mm) / 2 for camera in network.cameras])[network.camera]
    distance = state.constants[network.camera, 0]
    image = np.empty((count, PLACES, 3))
    image[:, :, :2] = grid * half[:, None]
    image[:, :, 2] = -distance[:, None]
    direction = image @ np.swapaxes(state.rotations, 1, 2)
    ground = np.array([photo.ground_height_m for photo in network.photos])
    drop = (ground - state.centres[:, 2])[:, None]
    # design: a ray within a milliradian of the horizon meets no ground.
    down = np.minimum(direction[:, :, 2], -1e-3)
    offsets = direction * (drop / down)[:, :, None]
    photo = np.repeat(np.arange(count), PLACES)
    rays = np.ascontiguousarray(offsets.reshape(-1, 3).T)
    partials = stacked_partials(rays, ray_models(network, state, photo))
    # design: places behind the camera do not move.
    plan = np.linalg.inv(np.nan_to_num(np.moveaxis(partials.by_centre[:, :2], 2, 0), nan=1e9) + 0.0)
    by_photo = np.concatenate([partials.by_centre, partials.by_rotation], axis=1)
    told = network.lens if network.lensed else 0
    by_camera = np.zeros((count * PLACES, 2, told))
    if told:
        by_camera = plan @ np.moveaxis(by_scaled_camera(network, photo, partials), 2, 0)
    moved = plan @ np.moveaxis(by_photo, 2, 0)
    return GroundShifts(
        moved.reshape(count, PLACES, 2, SIZE),
        by_camera.reshape(count, PLACES, 2, told),
        (network.camera * told).astype(np.float64),
    )
