"""Checks of a block that take a second, made before its stages take minutes."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import shapely

from app.folder_scan import Corners, Findings, FoundRaster
from app.height_checks import height_doubts
from app.mosaic import check_guides
from app.project import Project, described
from app.run import LAST_STAGES, WHEN_ASKED, adjustment_digest, given_of, product_of
from core.errors import PhotogrammetryError, ScanError
from core.geometry.crs import operation_between, short_name
from core.geometry.map_in_space import check_scale
from core.matching.reference import (
    DEM_SIGMA,
    ORTHO_SIGMA,
    Reference,
    ReferenceFiles,
    open_reference,
)
from core.mosaic.composition import MosaicProduct
from core.pipeline import STAGES, Stage
from core.raster.scan_file import check_fits_camera, open_scan
from sessions.products import Products
from sessions.scan_decisions import said_of_scans
from sessions.session import Session

# design: aerial cameras have 85 to 610 mm at 230 mm, which is 0.37 to 2.65 of the frame's longer
# side; beyond these a digit or the decimal point is wrong.
SHORTEST, LONGEST = 0.3, 6.0
"""Principal distance in longer sides of the frame that no camera of film has less or more of."""
Check = list[Any]
"""Whether it stops the run, its text `check.NAME`, and the values in it."""


@dataclass(frozen=True, slots=True)
class Outline:
    """Where a file lies on the map."""

    kind: str
    """`scan`, `ortho`, `dem`, `line`, `polygon`, `point` or `other`."""
    name: str
    """The file's name."""
    crs: str
    """Its own CRS; empty where it tells none."""
    corners: Corners
    """Corners in the block's CRS, metres."""

    def part(self) -> dict[str, Any]:
        """As the page is told."""
        corners = [[round(x, 1), round(y, 1)] for x, y in self.corners]
        return {"kind": self.kind, "name": self.name, "crs": self.crs, "corners": corners}


def outlines_of(found: Findings, crs: str, most: int) -> tuple[list[Outline], str]:
    """Outlines of placed files, brought to one CRS, and which CRS that is."""
    items = [item for item in (*found.rasters, *found.layers) if item.corners]
    named = [item.crs.to_wkt() for item in items if item.crs is not None]
    target = crs or (named[0] if named else "")
    outlines: list[Outline] = []
    for item in items[:most]:
        kind = item.kind if isinstance(item, FoundRaster) else item.geometry
        own = "" if item.crs is None else short_name(item.crs)
        corners = item.corners
        if item.crs is not None and target:
            try:
                operation = operation_between(
                    item.crs.to_wkt(), target, np.array(corners), item.path
                )
                moved = operation.forward(np.array(corners))
            except PhotogrammetryError:
                continue
            corners = tuple((float(x), float(y)) for x, y in moved[:, :2])
        if np.isfinite(np.array(corners)).all():
            outlines.append(Outline(kind, item.path.name, own, corners))
    return outlines, crs


def checks_of(
    project: Project, scans: Mapping[str, str], outlines: Sequence[Outline]
) -> list[Check]:
    """What a run would stumble over, the gravest first.

    Args:
        project: The block.
        scans: By file name, why a scan cannot be read; empty where it can.
        outlines: Where its files lie.
    """
    checks = [*_data(project), *_scans(project, scans), *_places(project, outlines)]
    cameras = project.cameras.items()
    checks += distance_doubts(
        {name: (camera.principal_distance_mm, max(camera.frame_mm)) for name, camera in cameras}
    )
    if not all(camera.fiducials_mm for camera in project.cameras.values()):
        checks.append([False, "fiducials", {}])
    # A file that cannot be read comes before what else a run would put up with.
    return sorted(checks, key=lambda check: (not check[0], check[1] != "broken"))


def _data(project: Project) -> list[Check]:
    """Reference and lists, opened once."""
    try:
        given = described(project)
        opened = open_reference(given.reference)
        doubts = height_doubts(project, given.surveyed, opened.dem)
        area = opened.ortho.bounds if given.reference.ortho else given.reference.area
        doubts += () if area is None else check_scale(given.crs, area)
        notes = check_guides(project)
    except PhotogrammetryError as error:
        return [[True, "error", {"text": error.told}]]
    lines = [*(doubt.message for doubt in doubts), *notes]
    told: list[Check] = [[False, "doubt", {"text": line}] for line in lines]
    return [*_sigmas(given.reference, opened), *told]


def _sigmas(files: ReferenceFiles, opened: Reference) -> Iterator[Check]:
    """What is stated better than pixels can bear: every accuracy of the report rests on it."""
    for name, given, rule, source, stated_m in (
        ("ortho", files.ortho, ORTHO_SIGMA, opened.ortho, opened.ortho_sigma_m),
        ("dem", files.dem, DEM_SIGMA, opened.dem, opened.dem_sigma_m),
    ):
        pixel_m = source.ground_sample_distance_m
        # A pixel of a reprojected file comes with a rest of its computation.
        if given and stated_m < rule.least_px * pixel_m * (1 - 1e-6):
            values = {"stated": stated_m, "pixel": float(f"{pixel_m:.3g}"),
                      "expected": rule.expected_m(pixel_m)}  # fmt: skip
            yield [False, f"fine.{name}", values]


def _scans(project: Project, scans: Mapping[str, str]) -> list[Check]:
    listed = project.scans.listed
    broken = [scan.path.name for scan in listed if scans.get(scan.path.name)]
    checks: list[Check] = []
    if broken:
        every = len(broken) == len(listed)
        checks.append(
            [every, "broken", {"count": len(broken), "first": broken[0], "why": scans[broken[0]]}]
        )
    whole = [scan for scan in listed if scan.path.name not in broken]
    unfit: list[str] = []
    for scan in whole:
        try:
            camera, pixel_mm = project.cameras[scan.camera], scan.scan_pixel_um / 1000
            check_fits_camera(open_scan(scan.path), camera, pixel_mm, page=True)
        except ScanError as error:
            unfit.append(error.told)
    if unfit:
        # One that does not fit is left out by a run; the others go on.
        checks.append([len(unfit) == len(whole), "error", {"text": unfit[0]}])
    return checks


def form_checks(values: Mapping[str, Any]) -> list[Check]:
    """What of the figures of a form cannot be so, while it is written."""
    cameras: dict[str, tuple[float, float]] = {}
    for name in (key.removesuffix(".frame_mm") for key in values if key.endswith(".frame_mm")):
        distance, frame = (
            values.get(f"{name}.principal_distance_mm", 0.0),
            values[f"{name}.frame_mm"],
        )
        if are_sizes([distance], 1) and are_sizes(frame, 2):
            cameras[name.partition(".")[2]] = (distance, max(frame))
    return distance_doubts(cameras)


def distance_doubts(cameras: Mapping[str, tuple[float, float]]) -> list[Check]:
    """Principal distances that no camera has, told by the field of view that they would make.

    Args:
        cameras: Principal distance and longer side of the frame by camera, millimetres.
    """
    checks: list[Check] = []
    for name, (distance_mm, side_mm) in cameras.items():
        if not SHORTEST <= distance_mm / side_mm <= LONGEST:
            field_deg = float(2 * np.degrees(np.arctan(side_mm / 2 / distance_mm)))
            values = {"distance": distance_mm, "frame": side_mm, "field": field_deg, "name": name}
            checks.append([False, "distance", values])
    return checks


def are_sizes(values: Any, count: int) -> bool:
    """True for so many numbers above nought."""
    return (
        isinstance(values, list)
        and len(cast("list[Any]", values)) == count
        and all(isinstance(one, int | float) and one > 0 for one in cast("list[Any]", values))
    )


def _places(project: Project, outlines: Sequence[Outline]) -> list[Check]:
    """Whether anything says where the photos lie, and whether the reference is there."""
    given = project.scans
    ground = [
        o for o in outlines if o.kind == "ortho" and o.name in _names(project.reference.ortho)
    ]
    if given.georeference == "none" and given.exterior is None:
        return [] if given.scale_number else [[False, "nowhere", {}]]
    listed = {scan.path.name for scan in given.listed}
    if given.georeference == "footprints" and given.footprints is not None:
        listed = {given.footprints.name}
    placed = [o for o in outlines if o.name in listed]
    if not placed or not ground:
        return []
    covered = shapely.union_all([shapely.Polygon(o.corners) for o in ground])
    outside = [o.name for o in placed if not covered.intersects(_hull(o))]
    if not outside:
        return []
    values = {"count": len(outside), "all": len(placed), "first": outside[0]}
    return [[len(outside) == len(placed), "outside", values]]


def _hull(outline: Outline) -> shapely.Geometry:
    return shapely.MultiPoint(outline.corners).convex_hull


def _names(paths: Sequence[Path]) -> set[str]:
    return {path.name for path in paths}


def stages_ahead(project: Project, session: Session) -> Iterator[str]:
    """Stages that a run would make again, because what they depend on is another than it was."""
    given, products = given_of(project, session), session.products
    digests: dict[str, str] = {}

    def is_fresh(stage: Stage, passes: int) -> bool:
        product, digest = product_of(stage, passes, given, session, digests)
        digests[stage.name] = digest
        if products.fresh(product, digest) is None:
            return False
        changes = said_of_scans(session.decisions()) if stage.name == "scans" else ()
        if changes:
            digests["scans"] = products.digest_of(digest, changes)
        return True

    stale = [stage.name for stage in STAGES if not is_fresh(stage, 1)]
    yield from stale
    repeated = [stage for stage in STAGES if stage.repeated]
    passes = 2
    while not stale and was_walked(products, passes):
        stale = [stage.name for stage in repeated if not is_fresh(stage, passes)]
        yield from stale
        passes += 1

    def not_left_out(name: str) -> bool:
        return name not in WHEN_ASKED or name in project.asked_for

    digest = adjustment_digest(session, digests["control"], given.adjustment)
    if stale or products.fresh("adjustment", digest) is None:
        yield from filter(not_left_out, LAST_STAGES)
        return
    mosaic: MosaicProduct | None = products.latest_value("mosaic")
    wanted = project.ortho.gsd_m
    if mosaic is None or wanted not in (None, mosaic.grid.ground_sample_distance_m):
        yield from filter(not_left_out, ("orthos", "mosaic", "sheets", "report"))


def was_walked(products: Products, passes: int) -> bool:
    """True when the repeated stages were gone through so many times."""
    return any((products.folder / "control" / str(passes)).glob("*.value"))
