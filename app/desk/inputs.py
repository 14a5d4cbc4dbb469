"""Everything the review desk of a block works on, and the work it may start."""

import io
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Protocol, cast

import numpy as np
from aiohttp import web

from app.bring_points import brought_points, ground_of
from app.desk.background import Adjust, Fill, Remake
from app.desk.comparing import Comparing, Transferring, photographs
from app.desk.exporting import Standing, export_routes
from app.desk.measuring import Filling, PhotoToPhoto
from app.desk.mosaic import MosaicFile
from app.job_rules import rules_on_disk
from app.mosaic import make_change, make_mosaic
from app.orthos import make_orthos
from app.placing import Placeable, standing_block
from app.project import Project, described
from app.run import PAGE, Run, RunOptions, terrain_of, write_all, written_results
from app.running import Running
from app.sheets import check_sheets, make_sheets
from app.terminal import JsonLines
from core.adjustment.adjusted import AdjustmentOptions, AdjustmentReport
from core.adjustment.block_adjustment import adjust_block
from core.adjustment.expected_gain import expected_gains, measuring_gains
from core.adjustment.influence import influence_of
from core.adjustment.weights import Terrain
from core.block import Block, Photo
from core.control.prediction import covariances_of, predict_points
from core.control.stage import ControlFound, adjusted_without_gross
from core.doubts import Doubt
from core.errors import ProjectError
from core.formats.point_axes import Ground
from core.geometry.camera import Camera
from core.georeference.stage import Georeferenced
from core.localisation.photo_orientation import OrientationOptions
from core.localisation.stage import Localised
from core.matching.reference import (
    DEM_SIGMA,
    ORTHO_SIGMA,
    Reference,
    SigmasAt,
    level_of,
    open_reference,
    usual_sigmas_m,
)
from core.progress import SILENT, Part, Progress
from core.quality.job_rules import USUAL_RULES, JobRules
from core.raster.ortho import Ortho
from core.raster.scan_file import ScanFiles
from core.results import BlockInput
from core.said import say
from core.scans.stage import ScanSet, find_like
from sessions.checks import version_on_disk
from sessions.session import HIDDEN, Session
from sessions.sheet_samples import sheets_on_disk
from ui.review.compare import HeightSource, LikenessSource, drawn_from_block, made_with
from ui.review.snapshot import DeskSnapshot
from ui.review.state import (
    NO_EVIDENCE,
    NOTHING_INITIAL,
    DeskState,
    Evidence,
    InitialState,
    Made,
    Seat,
)
from ui.review.tiles import OrthoSource, ScanWindow
from ui.review.to_measure import points_of_user
from ui.views.meshes import SurfaceSource, TerrainOptions
from ui.web.access import Door, lasting_token

MOSAIC_WORK = 2.0
"""Making the mosaic takes about as long as this many orthos."""


class DeskDem(HeightSource, SurfaceSource, Protocol):
    """What the desk asks of a DEM."""


def keep_nothing(report: AdjustmentReport) -> None:
    """Adjustments are not kept."""


def no_evidence(report: AdjustmentReport) -> Evidence:
    """Nothing is known beside the report."""
    return NO_EVIDENCE


@dataclass(frozen=True, slots=True, eq=False)
class DeskInputs:
    """Everything the desk works on; the caller owns and closes the session."""

    name: str
    """Of the block, for the title."""
    block: Block
    """The block as the engine left it, before any decision."""
    report: AdjustmentReport
    """The last adjustment: the numbers shown first."""
    session: Session
    """Memory."""
    ortho: OrthoSource
    """Reference ortho; black where the block has none."""
    dem: DeskDem
    """Heights of the ground."""
    adjust: Adjust
    """(block, progress) -> report."""
    remake: Remake
    """(photo_ids, progress, report): orthos of these photos and the mosaic, made again."""
    ground: Ground = field(default_factory=Ground)
    """Heights with which those of brought lists are compared."""
    read_scan: ScanWindow = field(default_factory=ScanFiles)
    """(path, column, row, columns, rows, reduction) -> grey values."""
    made: Made | None = None
    """What the orthos on disk were made with; the orientations of `report` by default."""
    written_of: str = ""
    """Digest of the results that tables and report on disk tell; empty where there are none."""
    operator: str = "operator"
    """Who decides."""
    door: Door = field(default_factory=Door)
    """Where it listens."""
    stale_m: float = 0.1
    """An ortho is stale once its photo moved by more than this on the ground, metres."""
    language: str = ""
    """Of the texts on the pages; that of each browser when empty."""
    adopted: Callable[[AdjustmentReport], None] = keep_nothing
    """Told of every adjustment the desk shows."""
    terrain: TerrainOptions = field(default_factory=TerrainOptions)
    """How fine the drape is."""
    likeness: LikenessSource | None = None
    """Compares reference and scan; None where there is nothing to compare with."""
    token: str = ""
    """Secret of the desk; a new one when empty."""
    fill: Fill | None = None
    """Looks for all marks like one that was pointed at; None where scans cannot be read."""
    template_m: float = 0.0
    """Half the side of the patches the engine compared, metres; 0 when it compared none."""
    doubts: tuple[Doubt, ...] = ()
    """What the engine was unsure of."""
    sigmas_m: SigmasAt = usual_sigmas_m
    """Standard deviations of ortho and DEM at places, of points chosen at the desk, metres."""
    largest_m: tuple[float, float] = (ORTHO_SIGMA.usual_m, DEM_SIGMA.usual_m)
    """The largest of each, metres."""
    initial: InitialState = NOTHING_INITIAL
    """What the photos began from: scans as they were found."""
    choose: Callable[[bool, bool], tuple[bool, bool]] | None = None
    """(cameras, robust): what adjustments from now on estimate and how; None where it is fixed."""
    free: tuple[bool, bool] = (True, True)
    """Whether cameras are estimated, and gross errors looked for, as the desk opens."""
    evidence: Callable[[AdjustmentReport], Evidence] = no_evidence
    """What the equations of an adjustment tell beside its report."""
    transfer: PhotoToPhoto | None = None
    """Finds a place of some photos in others; None where there is nothing to find it with."""
    mosaic: MosaicFile | None = None
    """The mosaic on disk; None where there can be none."""
    routes: tuple[web.RouteDef, ...] = ()
    """Addresses that need the block's folder: exports."""
    has_ortho: bool = True
    """Whether the block has a reference ortho."""
    years: tuple[tuple[int, OrthoSource], ...] = ()
    """Orthos and mosaics of other years, in their order."""
    results: Path | None = None
    """Folder of tables and report, to be read and taken away from the desk."""
    placing: Placeable | None = None
    """What a photo is placed anew on; None where there is no ortho to click in."""
    running: Running | None = None
    """Runs the block from the desk."""
    looking: bool = False
    """The block's folder may not be written: nothing can be decided."""
    rules: Callable[[], JobRules | None] = lambda: USUAL_RULES
    """Limits by which the block is judged, as they are on disk; None where they are broken."""
    exposed: Mapping[str, str] = field(default_factory=dict[str, str])
    """When each photo was taken, as far as that is known."""
    left: tuple[Seat, ...] = ()
    """Seats with drafts that the desk before this one left."""

    def mosaic_version(self) -> str:
        """What the mosaic on disk was made of; empty where there is none."""
        return version_on_disk(self.session.products)

    def with_products(self, desk: DeskSnapshot) -> DeskSnapshot:
        """The same with the version of the mosaic, map sheets and rules as they are on disk now."""
        version, rules = self.mosaic_version(), self.rules()
        sheets = sheets_on_disk(self.session.products, version)
        desk = replace(desk, mosaic_version=version, sheets=sheets)
        return replace(desk, rules=rules or desk.rules, rules_stand=rules is not None)

    def written_ms(self) -> int:
        """When the report on disk was written, milliseconds since 1970; 0 where there is none."""
        page = None if self.results is None else self.results / PAGE
        return page.stat().st_mtime_ns // 1_000_000 if page is not None and page.is_file() else 0

    def engine_digest(self) -> str:
        """What the newest block of the engine on disk was made from."""
        return self.session.products.latest_digest("control")

    def files(self, state: DeskState) -> DeskState:
        """The same with mosaic and report as they are on disk now."""
        mosaic = None if self.mosaic is None else self.mosaic.on_disk()
        return replace(state, mosaic=mosaic, written_ms=self.written_ms())

    def on_disk(self, state: DeskState) -> DeskState:
        """The same with all that the last run made, and with what it was made of."""
        made, written = last_results(self.session, self.block)
        return replace(self.files(state), made=made, written_of=written)


def first_state(desk: DeskInputs) -> DeskState:
    """The block and its adjustment as the desk opens."""
    made = made_with(desk.report.block) if desk.made is None else desk.made
    written, free = desk.written_of, desk.free
    return desk.files(DeskState(desk.block, desk.report, made, written_of=written, free=free))


def first_snapshot(desk: DeskInputs) -> DeskSnapshot:
    """All that the desk knows as it opens."""
    state = first_state(desk)
    drawn = drawn_from_block(state.oriented)
    known = DeskSnapshot(
        desk.block,
        state,
        desk.dem,
        drawn,
        desk.initial,
        desk.doubts,
        height_sigma_m=desk.largest_m[1],
        ortho_sigma_m=desk.largest_m[0],
        ortho_pixel_m=desk.ortho.ground_sample_distance_m if desk.has_ortho else 0.0,
        exposed=desk.exposed,
    )
    return desk.with_products(known)


def desk_inputs(project: Project, session: Session, operator: str, door: Door) -> DeskInputs:
    """Everything the desk needs of a block.

    Raises:
        ProjectError: The block has not been run as far as its control points.
    """
    given = described(project, brought_points(session))
    assembly = cast("ControlFound | None", session.products.latest_value("control"))
    placed = cast("Georeferenced | None", session.products.latest_value("georeference"))
    localised = cast("Localised | None", session.products.latest_value("localisation"))
    if assembly is None or placed is None:
        remedy = say("Run it first: gruber run {folder}", folder=project.folder)
        raise ProjectError(project.file, "the block has no control points to review yet.", remedy)
    scans, block = ScanFiles(project.folder), assembly.report.block.with_fixed_origin()
    reference = open_reference(given.reference, placed.block.search_bounds, level_of(block))
    initial, adjusting = initial_state_of(given, session, placed), adjusting_of(given, reference)
    opened = photographs(scans, initial)
    compared = Comparing(reference, given.control.orientation, opened)
    standing = Standing(block, initial, adjusting)
    report, (made, written) = standing(session, SILENT), last_results(session, block)
    return DeskInputs(
        name=project.block.name,
        block=block,
        report=report,
        session=session,
        ortho=reference.ortho,
        has_ortho=reference.ortho.is_there,
        years=project.reference.years(block.crs),
        dem=reference.dem,
        ground=ground_of(project, reference.dem),
        read_scan=scans,
        adjust=adjusting,
        choose=adjusting.choose,
        free=adjusting.free,
        evidence=adjusting.evidence,
        initial=initial,
        placing=standing_block(given, session, reference, placed),
        running=Running(project.file),
        doubts=(*(localised.doubts if localised else ()), *assembly.doubts),
        sigmas_m=reference.sigmas_m,
        largest_m=reference.largest_m,
        routes=export_routes(project, standing),
        results=session.results,
        rules=partial(rules_on_disk, project.file),
        exposed=project.exposed,
        mosaic=MosaicFile(session, block.crs),
        remake=OrthoMaker(project, reference, operator),
        made=made,
        written_of=written,
        operator=operator,
        door=door,
        fill=Filling(find_like),
        likeness=compared if reference.ortho.is_there else None,
        transfer=Transferring(reference, opened),
        token=lasting_token(project.folder / HIDDEN),
        template_m=template_m(report.block, reference.ortho, given.control.orientation),
    )


def initial_state_of(given: BlockInput, session: Session, placed: Georeferenced) -> InitialState:
    """What the photos began from, as the last run kept it."""
    scans = cast("ScanSet | None", session.products.latest_value("scans"))
    pixels_mm = {scan.path.stem: scan.scan_pixel_um / 1000 for scan in given.scans}
    sources = {name: str(found.source) for name, found in placed.approximations.items()}
    exterior = {name: photo.exterior for name, photo in placed.block.photos.items()}
    if scans is None:
        return InitialState({}, pixels_mm, sources, placed.set_aside, exterior, given.cameras)
    set_aside = {**scans.set_aside, **placed.set_aside}
    return InitialState(scans.oriented, pixels_mm, sources, set_aside, exterior, given.cameras)


def adjusting_of(given: BlockInput, reference: Reference) -> "Adjusting":
    """The adjustment of a block, on its terrain where the heights of that count."""
    terrain = terrain_of(reference.dem) if given.adjustment.dem_sigma_m > 0 else None
    return Adjusting(given.adjustment, terrain)


class Adjusting:
    """The adjustment that `gruber run` would make of a block, or one that is chosen otherwise."""

    def __init__(self, options: AdjustmentOptions, terrain: Terrain | None = None) -> None:
        self._given = self._options = options
        self._terrain = terrain

    @property
    def free(self) -> tuple[bool, bool]:
        """Whether cameras are estimated, and whether gross errors are looked for."""
        return self._options.estimate_cameras, self._options.robust

    def __call__(self, block: Block, progress: Progress = SILENT) -> AdjustmentReport:
        """Adjust until no gross error is left."""
        options = self._options
        block = block if options.estimate_cameras else block.with_certificates()
        adjusted = adjusted_without_gross if options.robust else adjust_block
        return adjusted(block, options, progress, self._terrain)

    def evidence(self, report: AdjustmentReport) -> Evidence:
        """What looking at each measurement and measuring more is expected to bring."""
        # The equations are those of the report, whatever has been chosen since.
        influence = influence_of(report, report.options or self._given, SILENT, self._terrain)
        if influence is None:
            return NO_EVIDENCE
        block, covariances = report.block, covariances_of(influence)
        points = points_of_user(block)
        shown = predict_points(block, points, covariances)
        wanted = [(block.surveyed[key[0]], key[1]) for key in shown]
        return Evidence(
            expected_gains(influence),
            covariances,
            measuring_gains(influence, wanted, len(report.checks)),
            influence,
        )

    def choose(self, cameras: bool, robust: bool) -> tuple[bool, bool]:
        """Estimate cameras if the block may, look for gross errors or not, from now on: `free`."""
        free = cameras and self._given.estimate_cameras
        self._options = replace(self._given, estimate_cameras=free, robust=robust)
        return self.free


class OrthoMaker:
    """Makes orthos, mosaic, tables and report again from the desk's worker thread."""

    def __init__(self, project: Project, reference: Reference, operator: str) -> None:
        self.project, self.reference, self.operator = project, reference, operator

    def __call__(
        self, photo_ids: Sequence[str], progress: Progress, report: AdjustmentReport
    ) -> None:
        """Orthos of these photos, the mosaic, sheets where asked for, and all written beside them.

        Raises:
            PhotogrammetryError: Sheets are asked for that cannot be made; nothing has changed.
        """
        if self.project.sheets.asked:
            check_sheets(self.project)
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
            mosaic = make_mosaic(session, self.project, orthos, Part(progress, orthos_end, 0.88))
            change = make_change(session, self.project, mosaic, Part(progress, 0.88, 0.91))
            if self.project.sheets.asked:
                make_sheets(session, self.project, mosaic, Part(progress, 0.91, 0.95))
            walk = Run(self.project, session, JsonLines(io.StringIO()), RunOptions(workers=1))
            walk.stand_in(report, mosaic, change)
            with closing(walk.threads):
                write_all(session, walk.content(Part(progress, 0.95, 1.0)), self.reference.dem)
            decisions = session.changing()
            products = session.products
            products.save_value("adjustment", products.digest_of("desk", decisions), report)
            walk.threads.close()


def last_results(session: Session, block: Block) -> tuple[Made, str]:
    """What the orthos on disk were made with, and the digest of what tables and report tell.

    Args:
        session: With what the last run made.
        block: As the engine left it, for a block that was not adjusted yet.
    """
    latest = cast("AdjustmentReport | None", session.products.latest_value("adjustment"))
    made = ortho_orientations(session, block if latest is None else latest.block)
    return made, written_results(session, latest)


def ortho_orientations(session: Session, adjusted: Block) -> Made:
    """What each ortho on disk was made with; the adjusted block where that was not kept."""
    made: dict[str, tuple[Photo, Camera]] = {}
    for name, photo in adjusted.photos.items():
        kept = cast(
            "tuple[Photo, Camera] | None", session.products.latest_value(f"made-with/{name}")
        )
        made[name] = kept or (photo, adjusted.camera_of(name))
    return made


def template_m(block: Block, ortho: Ortho, options: OrientationOptions) -> float:
    """Half the side of the patches that were compared, metres on the ground; 0 where none were."""
    sides: list[float] = []
    if not ortho.is_there:
        return 0.0
    for name, photo in block.photos.items():
        pixel = photo.ground_pixel_m(block.camera_of(name))
        finest = max(options.finest_gsd_m, pixel, ortho.ground_sample_distance_m)
        reduction = max(1, int(np.floor(finest / pixel + 0.25)))
        sides.append(options.template_half_px * reduction * pixel)
    return float(np.median(sides)) if sides else 0.0
