"""`block.toml` in the engine's own terms."""

from pathlib import Path

import numpy as np

from app.project import Project
from core.block import UNKNOWN_M, SurveyedPoint
from core.control.stage import ControlStageOptions
from core.formats.csv_lists import ListedPoint, read_control_points
from core.formats.micmac_measures import read_image_measures
from core.geometry.crs import check_range, read_crs
from core.georeference.archive import Georeference
from core.literature.baselines import operator_named
from core.localisation.photo_orientation import OrientationOptions
from core.localisation.stage import LocalisationOptions
from core.matching.reference import ReferenceFiles
from core.results import BlockInput
from core.scans.stage import ScanInput


def described(project: Project) -> BlockInput:
    """What the engine is given of a project."""
    scans, reference = project.scans, project.reference
    listed = listed_points(project.control.points, project.block.crs)
    measured: dict[str, dict[str, tuple[float, float]]] = {}
    for file in scans.fiducial_measures:
        measured |= read_image_measures(file)
    control = project.control
    operators = tuple(operator_named(name, control.learned) for name in control.operators)
    orientation = OrientationOptions(operators=operators)
    return BlockInput(
        name=project.block.name,
        cameras=project.cameras,
        scans=tuple(
            ScanInput(scan.path, scan.camera, scan.scan_pixel_um, measured.get(scan.path.name, {}))
            for scan in scans.listed
        ),
        georeference=Georeference(
            scans.georeference,
            scans.footprints,
            scans.footprint_name,
            scans.exterior,
            scans.scale_number,
        ),
        reference=ReferenceFiles(
            crs=project.block.crs,
            ortho=reference.ortho,
            dem=reference.dem,
            roads=reference.roads,
            mask=reference.mask,
            bridges=reference.bridges,
            ortho_sigma_m=reference.ortho_sigma_m,
            dem_sigma_m=reference.dem_sigma_m,
        ),
        surveyed=tuple(surveyed(point) for point in listed),
        preset=project.control.preset,
        localisation=LocalisationOptions(orientation=orientation),
        control=ControlStageOptions(orientation=orientation),
        adjustment=project.adjustment,
    )


def listed_points(file: Path | None, crs: str) -> tuple[ListedPoint, ...]:
    """The user's own points; their coordinates must be possible in the block's CRS."""
    if file is None:
        return ()
    listed = read_control_points(file)
    places = np.array([(point.easting, point.northing) for point in listed]).reshape(-1, 2)
    check_range(read_crs(crs, file), places, file)
    return listed


def surveyed(point: ListedPoint) -> SurveyedPoint:
    """A point of the user's list; what its role says is not known gets no weight."""
    plan = UNKNOWN_M if point.role == "height" else point.sigma_plan_m
    height = UNKNOWN_M if point.role == "plan" else point.sigma_height_m
    return SurveyedPoint(
        point.point_id,
        np.array([point.easting, point.northing, point.height]),
        np.array([plan, plan, height]),
        "check" if point.role == "check" else "control",
        "surveyed",
    )
