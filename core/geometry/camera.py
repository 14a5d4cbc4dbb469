"""The camera: its constants from the certificate, in the film frame (mm)."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from core.arrays import FilmPoints, Scalars


@dataclass(frozen=True, slots=True)
class Camera:
    """A frame camera with central projection and radial lens distortion."""

    name: str
    """Key of the `[camera.NAME]` table."""
    principal_distance_mm: float
    """Principal distance (camera constant), millimetres."""
    frame_mm: tuple[float, float]
    """Picture area, width and height, millimetres."""
    principal_point_mm: tuple[float, float] = (0.0, 0.0)
    """Principal point in the film frame, millimetres."""
    radial_distortion: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """k1, k2, k3 of imaged = ideal * (1 + k1 r^2 + k2 r^4 + k3 r^6), r in millimetres from the
    principal point: positive moves the image outwards, as certificates count it."""
    fiducials_mm: Mapping[str, tuple[float, float]] = field(
        default_factory=dict[str, tuple[float, float]]
    )
    """Certified fiducials by name, film frame, millimetres; empty when there are none."""
    data_strip: str = ""
    """Side of the picture on which the camera writes, in the film frame: `left`, `right`, `top`,
    `bottom`; empty when nobody said."""
    fiducial_marks: int = 0
    """How many marks the camera has where `fiducials_mm` is empty: 4 or 8; 0 when nobody said."""
    deformation_mm: tuple[float, ...] = ()
    """The 50 coefficients of `core.geometry.deformation`, those of x first; empty means none."""
    certified: "Camera | None" = None
    """The camera as it stood before its constants were adjusted; None as long as they are not."""

    @property
    def certificate(self) -> "Camera":
        """The camera as its certificate has it: the mean of every prior on its constants."""
        return self.certified or self

    def with_constants(
        self,
        principal_distance_mm: float,
        principal_point_mm: tuple[float, float],
        radial_distortion: tuple[float, float, float],
        deformation_mm: tuple[float, ...] = (),
    ) -> "Camera":
        """The same camera with adjusted constants."""
        return replace(
            self,
            principal_distance_mm=principal_distance_mm,
            principal_point_mm=principal_point_mm,
            radial_distortion=radial_distortion,
            deformation_mm=deformation_mm,
            certified=self.certificate,
        )

    @property
    def half_mm(self) -> float:
        """Half the longer side of the frame: what the deformation's coordinates are counted in."""
        return max(self.frame_mm) / 2

    @property
    def frame_corners_mm(self) -> FilmPoints:
        """The four corners of the picture area, counter-clockwise from lower left, film frame."""
        half = np.array(self.frame_mm, dtype=np.float64) / 2
        return half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]], dtype=np.float64)


def radial_factor(radius_squared: Scalars, camera: Camera) -> Scalars:
    """Factor by which the lens moves an ideal image point away from the principal point."""
    k1, k2, k3 = camera.radial_distortion
    return 1 + radius_squared * (k1 + radius_squared * (k2 + radius_squared * k3))
