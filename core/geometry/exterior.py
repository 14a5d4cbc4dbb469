"""The exterior orientation of one photo: where its perspective centre was and how it was turned."""

from dataclasses import dataclass

import numpy as np

from core.arrays import Position, Rotation, locked


@dataclass(frozen=True, slots=True, eq=False)
class ExteriorOrientation:
    """One photo's place in object space, in the block's CRS."""

    centre: Position
    """Perspective centre (easting, northing, height), metres."""
    omega: float
    """First rotation, about the x axis, radians."""
    phi: float
    """Second rotation, about the y axis, radians."""
    kappa: float
    """Third rotation, about the z axis, radians, counter-clockwise from grid east."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "centre", locked(self.centre))

    @property
    def object_from_image(self) -> Rotation:
        """R = R_omega R_phi R_kappa: turns image space into object space."""
        return rotation_from_angles(self.omega, self.phi, self.kappa)


def rotation_from_angles(omega: float, phi: float, kappa: float) -> Rotation:
    """R_x(omega) R_y(phi) R_z(kappa), METHODS 7.1: the rotation from image to object space."""
    so, co = np.sin(omega), np.cos(omega)
    sp, cp = np.sin(phi), np.cos(phi)
    sk, ck = np.sin(kappa), np.cos(kappa)
    return np.array(
        [
            [cp * ck, -cp * sk, sp],
            [co * sk + so * sp * ck, co * ck - so * sp * sk, -so * cp],
            [so * sk - co * sp * ck, so * ck + co * sp * sk, co * cp],
        ]
    )


def angles_from_rotation(rotation: Rotation) -> tuple[float, float, float]:
    """omega, phi, kappa in radians of R = R_omega R_phi R_kappa; phi within +-90 degrees."""
    phi = float(np.arcsin(np.clip(rotation[0, 2], -1.0, 1.0)))
    omega = float(np.arctan2(-rotation[1, 2], rotation[2, 2]))
    kappa = float(np.arctan2(-rotation[0, 1], rotation[0, 0]))
    return omega, phi, kappa
