"""The review desk of a block that has been run: what it works on, and what it may set off."""

import io
import os
import secrets
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

import numpy as np

from app.change_layer import make_change
from app.described import described
from app.project import Project
from app.protocol import terrain_of
from app.run import Run, RunOptions, make_mosaic, make_orthos, write_all
from app.scan_files import ScanFiles
from app.terminal import JsonLines
from app.wiring import DeskInputs
from core.arrays import ObjectPoints
from core.block.adjusted import AdjustmentOptions, AdjustmentReport
from core.block.adjustment import SILENT, adjust_block
from core.block.assembly import Assembly, adjusted_without_gross
from core.block.block import Block, Photo
from core.block.expected_gain import Gain, expected_gains
from core.block.foresight import foresee
from core.block.least_squares.terrain import Terrain
from core.block.registration.likeness import Likeness, likeness_about, search_options
from core.block.registration.orientation import OrientationOptions
from core.block.registration.patches import OpenPhoto
from core.doubts import Failure
from core.errors import ProjectError
from core.geometry.camera import Camera
from core.progress import Part, Progress
from core.reference.reference import Reference
from core.scan.raster import ScanFile
from core.stages import BlockInput, Georeferenced, ScanSet
from core.whereabouts import open_reference, search_bounds
from sessions.session import HIDDEN, Session
from ui.review.origins import Origins
from ui.review.state import Made

SEARCH_M = 12.0
"""How far about the expected place reference and scan are compared, metres."""
MOSAIC_WORK = 2.0
"""Making the mosaic takes about as long as this many orthos."""


def desk_inputs(
    project: Project, session: Session, operator: str, host: str, port: int
) -> DeskInputs:
    """Everything the desk needs of a block.

    Raises:
        ProjectError: The block has not been run as far as its control points.
    """
    given = described(project)
    assembly = cast("Assembly | None", session.products.latest_value("control"))
    placed = cast("Georeferenced | None", session.products.latest_value("georeference"))
    if assembly is None or placed is None:
        raise ProjectError(
            project.file,
            "the block has no control points to review yet.",
            f"Run it first: gruber run {project.folder}",
        )
    scans = ScanFiles(project.folder)
    reference = open_reference(given, search_bounds(placed.block))
    block = assembly.report.block
    terrain = terrain_of(reference.dem) if given.adjustment.dem_sigma_m > 0 else None
    adjusting = Adjusting(given.adjustment, terrain)
    origins = origins_of(given, session, placed)
    report = adjusting(session.replayed(block, origins.films))
    latest = cast("AdjustmentReport | None", session.products.latest_value("adjustment"))
    return DeskInputs(
        name=project.block.name,
        block=block,
        report=report,
        session=session,
        ortho=reference.ortho,
        dem=reference.dem,
        read_scan=scans,
        adjust=adjusting,
        choose=adjusting.choose,
        gains=adjusting.gains,
        origins=origins,
        doubts=assembly.doubts,
        reference_sigma_m=(given.ortho_sigma_m, given.ortho_sigma_m, given.dem_sigma_m),
        results=session.results,
        remake=Remaking(project, reference, operator),
        made=ortho_orientations(session, block if latest is None else latest.block),
        written=latest is not None and same_results(latest, report),
        operator=operator,
        host=host,
        port=port,
        likeness=Comparing(reference, given.assembly.orientation, scans.opened),
        token=lasting_token(project.folder / HIDDEN),
        template_m=template_m(
            report.block, reference.ortho.ground_sample_distance_m, given.assembly.orientation
        ),
    )


def origins_of(given: BlockInput, session: Session, placed: Georeferenced) -> Origins:
    """What the photos began from, as the last run kept it."""
    scans = cast("ScanSet | None", session.products.latest_value("scans"))
    pixels_mm = {scan.path.stem: scan.scan_pixel_um / 1000 for scan in given.scans}
    sources = {name: str(found.source) for name, found in placed.approximations.items()}
    if scans is None:
        return Origins({}, pixels_mm, sources, placed.set_aside)
    return Origins(scans.oriented, pixels_mm, sources, {**scans.set_aside, **placed.set_aside})


class Adjusting:
    """The adjustment that `gruber run` would make of a block, or one that is chosen otherwise."""

    def __init__(self, options: AdjustmentOptions, terrain: Terrain | None = None) -> None:
        self._given = self._options = options
        self._terrain = terrain

    def __call__(self, block: Block, progress: Progress = SILENT) -> AdjustmentReport:
        """Adjust until no gross error is left."""
        options = self._options
        if not options.robust:
            return adjust_block(block, options, progress, self._terrain)
        return adjusted_without_gross(block, options, progress, self._terrain)

    def gains(self, report: AdjustmentReport) -> dict[tuple[str, str], Gain]:
        """What looking at each control measurement is expected to bring."""
        foresight = foresee(report, self._options, SILENT, self._terrain)
        return {} if foresight is None else expected_gains(foresight)

    def choose(self, cameras: bool, robust: bool) -> None:
        """Estimate the cameras or not, look for gross errors or not, from now on."""
        free = cameras and self._given.estimate_cameras
        self._options = replace(self._given, estimate_cameras=free, robust=robust)


def same_results(one: AdjustmentReport, other: AdjustmentReport) -> bool:
    """True when two adjustments come to the same tables."""
    states = [
        {key: item.status for key, item in report.block.measurements.items()}
        for report in (one, other)
    ]
    return one.sigma_nought == other.sigma_nought and states[0] == states[1]


@dataclass(frozen=True, slots=True)
class Comparing:
    """Compares reference and scan about a point, as the engine does when it proposes control."""

    reference: Reference
    """Ortho and heights."""
    orientation: OrientationOptions
    """Sizes of the patches."""
    open_scan: Callable[[Path], ScanFile]
    """Scans by their path."""

    def __call__(self, photo: Photo, camera: Camera, position: ObjectPoints) -> Likeness | Failure:
        """How alike both are about a position (1, 3)."""
        opened = OpenPhoto(photo, camera, self.open_scan(photo.scan))
        options = search_options(opened, self.reference, self.orientation, SEARCH_M)
        pixel = photo.pixel_from_object(position, camera)
        return likeness_about(opened, self.reference, pixel, options)


class Remaking:
    """Makes orthos, mosaic, tables and report again from the desk's worker thread."""

    def __init__(self, project: Project, reference: Reference, operator: str) -> None:
        self.project, self.reference, self.operator = project, reference, operator

    def __call__(
        self, photo_ids: Sequence[str], progress: Progress, report: AdjustmentReport
    ) -> None:
        """Orthos of these photos, then the mosaic and all that is written beside it."""
        orthos_end = len(photo_ids) / (len(photo_ids) + MOSAIC_WORK)
        with Session.open(self.project.folder, self.operator) as session, session.running():
            orthos = make_orthos(
                session,
                self.project,
                report.block,
                self.reference.dem,
                Part(progress, 0.0, orthos_end),
                only=frozenset(photo_ids),
            )
            mosaic = make_mosaic(session, orthos, Part(progress, orthos_end, 0.92))
            change = make_change(session, self.project, mosaic, Part(progress, 0.92, 0.97))
            progress.report(0.97, 1.0, "results")
            walk = Run(self.project, session, JsonLines(io.StringIO()), RunOptions(workers=1))
            walk.stand_in(report, mosaic, change)
            write_all(session, walk.content(), self.reference.dem)
            decisions = [recorded.decision_id for recorded in session.decisions()]
            products = session.products
            products.save_value("adjustment", products.digest_of("desk", decisions), report)
            walk.threads.close()


def ortho_orientations(session: Session, adjusted: Block) -> Made:
    """What each ortho on disk was made with; the adjusted block where that was not kept."""
    made: dict[str, tuple[Photo, Camera]] = {}
    for name, photo in adjusted.photos.items():
        kept = cast(
            "tuple[Photo, Camera] | None", session.products.latest_value(f"made-with/{name}")
        )
        made[name] = kept or (photo, adjusted.camera_of(name))
    return made


def template_m(block: Block, ortho_gsd_m: float, options: OrientationOptions) -> float:
    """Half the side of the patches that were compared, metres on the ground; 0 without photos."""
    sides: list[float] = []
    for name, photo in block.photos.items():
        pixel = photo.ground_pixel_m(block.camera_of(name))
        finest = max(options.finest_gsd_m, pixel, ortho_gsd_m)
        reduction = max(1, int(np.floor(finest / pixel + 0.25)))
        sides.append(options.template_half_px * reduction * pixel)
    return float(np.median(sides)) if sides else 0.0


def lasting_token(hidden: Path) -> str:
    """The desk's secret, kept for its owner only, so that pages find a desk opened again."""
    path = hidden / "desk-token"
    try:
        kept = path.read_text(encoding="ascii").strip()
        if len(kept) >= 32:
            return kept
        path.unlink()
    except (FileNotFoundError, UnicodeDecodeError):
        path.unlink(missing_ok=True)
    token = secrets.token_urlsafe(24)
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "w", encoding="ascii") as file:
        file.write(token)
    return token
