"""Walk the stages in their order; what is fresh is not made again."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib.metadata import version
from typing import Any

from app.change_layer import make_change
from app.described import described
from app.executors import Threads
from app.fiducial_tables import write_fiducials
from app.interruption import Interruption, interruptible
from app.project import Project
from app.protocol import terrain_of, write_protocol
from app.remarks import remarks
from app.report import write_report
from app.report_content import ReportContent
from app.results import write_results
from app.terminal import Voice
from core.arrays import Mask
from core.block.adjusted import AdjustmentReport
from core.block.assembly import Assembly, adjusted_without_gross
from core.block.block import Block
from core.block.foresight import foresee
from core.doubts import Doubt
from core.errors import Cancelled
from core.ground.mosaic import MosaicProduct, compose_mosaic, mosaic_grid
from core.ground.ortho import OrthoProduct, rectify_photo
from core.ground.picture import footprint_of
from core.pipeline import STAGES
from core.progress import Part, Progress
from core.reference.dem import Dem
from core.stages import BlockInput, Georeferenced, PlacedBlocks, ScanSet, Stage, Tied, Work
from core.whereabouts import open_reference, search_bounds
from sessions.fiducials import Films, judged_scans, mark_changes, with_effect
from sessions.session import Session
from sessions.whole import whole_file

LAST_STAGES = {
    "adjustment": "Adjustment with your decisions",
    "orthos": "Orthophotos",
    "mosaic": "Mosaic",
    "report": "Results and report",
}
PAGE = "report.html"
STAGE_NAMES = (*(stage.name for stage in STAGES), *LAST_STAGES)


@dataclass(frozen=True, slots=True)
class RunOptions:
    """Which part of the way is to be gone."""

    first: str | None = None
    """Make this stage and all after it anew."""
    last: str | None = None
    """Stop after this stage."""
    workers: int = 2
    """Pieces of a stage that run side by side."""


class Run:
    """One walk over the stages of one block."""

    def __init__(
        self, project: Project, session: Session, voice: Voice, options: RunOptions
    ) -> None:
        self.project, self.session, self.voice, self.options = project, session, voice, options
        self.given: BlockInput = described(project)
        self.digest_of = session.products.digest_of
        self.made: dict[str, Any] = {}
        self.digests: dict[str, str] = {}
        self.seconds: dict[str, float] = {}
        self.threads = Threads(options.workers)
        self.interruption = Interruption()
        self.films: Films = {}

    def walk(self) -> None:
        """Go through all stages up to the last one wanted."""
        with self.session.running(), interruptible() as self.interruption:
            waits = True
            try:
                for name in STAGE_NAMES:
                    self.step(name)
                    if name == self.options.last:
                        break
            except (KeyboardInterrupt, Cancelled):
                waits = False
                raise
            finally:
                self.threads.close(waits)
        for line in remarks(self.set_aside(), self.doubts(), str(self.session.results / PAGE)):
            self.voice.say(line)

    def step(self, name: str) -> None:
        """One stage, made or found fresh, with one line said about it."""
        title = LAST_STAGES.get(name) or next(s.title for s in STAGES if s.name == name)
        started = time.monotonic()
        self.interruption.check()
        progress = self.interruption.watching(self.voice.stage(name, title))
        stage = next((stage for stage in STAGES if stage.name == name), None)
        last: Mapping[str, Callable[[Progress], str]] = {
            "adjustment": self.adjust,
            "orthos": self.rectify,
            "mosaic": self.compose,
            "report": self.report,
        }
        said = last[name](progress) if stage is None else self.compute(stage, progress)
        self.seconds[name] = time.monotonic() - started
        self.voice.ended(name, title, self.seconds[name], said)

    def anew(self, name: str) -> bool:
        """Whether the operator wants this stage made again whatever is there."""
        first = self.options.first
        return first is not None and STAGE_NAMES.index(name) >= STAGE_NAMES.index(first)

    def compute(self, stage: Stage, progress: Progress) -> str:
        """A stage of the engine."""
        needed = [self.digests[name] for name in stage.needs]
        digest = self.digest_of(stage.name, stage.version, stage.inputs(self.given), needed)
        self.digests[stage.name] = digest
        value = (
            None if self.anew(stage.name) else self.session.products.load_value(stage.name, digest)
        )
        fresh = value is not None
        if value is None:
            value = stage.run(self.given, self.made, Work(progress, self.threads.map))
            self.session.products.save_value(stage.name, digest, value)
        if isinstance(value, ScanSet):
            value = self.corrected(value)
        self.made[stage.name] = value
        return told(value) + (" (as before)" if fresh else "")

    def corrected(self, found: ScanSet) -> ScanSet:
        """The scans with the fiducials that operators corrected: what follows depends on them."""
        decisions = self.session.decisions()
        scans, self.films = judged_scans(found, self.given, decisions), found.oriented
        if scans is not found:
            digest = self.digests.get("scans", "")
            self.digests["scans"] = self.digest_of(digest, with_effect(mark_changes(decisions)))
        write_fiducials(self.session.results, self.given, scans)
        return scans

    def adjust(self, progress: Progress) -> str:
        """Lay the operator's decisions over the block and adjust it."""
        block = self.session.replayed(self.assembly.report.block, self.films)
        decisions = [recorded.decision_id for recorded in self.session.decisions()]
        options = self.given.adjustment
        digest = self.digest_of("adjustment", 2, self.digests["control"], decisions, options)
        self.digests["adjustment"] = digest
        report = (
            None
            if self.anew("adjustment")
            else self.session.products.load_value("adjustment", digest)
        )
        if report is None:
            terrain = terrain_of(self.dem()) if options.dem_sigma_m > 0 else None
            report = adjusted_without_gross(block, options, progress, terrain)
            self.session.products.save_value("adjustment", digest, report)
        self.made["adjustment"] = report
        return told(report)

    @property
    def assembly(self) -> Assembly:
        """The block as the engine proposes it."""
        return self.made["control"]

    @property
    def adjusted(self) -> AdjustmentReport:
        """The block as it stands with the operator's decisions."""
        return self.made["adjustment"]

    def dem(self) -> Dem:
        """Heights under the block, held in memory."""
        placed: Georeferenced = self.made["georeference"]
        return open_reference(self.given, search_bounds(placed.block)).dem

    def rectify(self, progress: Progress) -> str:
        """One ortho of every oriented photo."""
        orthos = make_orthos(
            self.session,
            self.project,
            self.adjusted.block,
            self.dem(),
            progress,
            self.anew("orthos"),
        )
        self.made["orthos"] = orthos
        return f"{counted(len(orthos), 'ortho')} at {orthos[0].grid.ground_sample_distance_m:g} m"

    def compose(self, progress: Progress) -> str:
        """The mosaic and its seams."""
        anew = self.anew("mosaic")
        first, second = Part(progress, 0.0, 0.7), Part(progress, 0.7, 1.0)
        mosaic = make_mosaic(self.session, self.made["orthos"], first, anew)
        self.made["mosaic"] = mosaic
        self.made["change"] = make_change(self.session, self.project, mosaic, second, anew)
        return str(self.session.results / "mosaic.tif")

    def stand_in(
        self, report: AdjustmentReport, mosaic: MosaicProduct, change: Mapping[str, float]
    ) -> None:
        """Take what was made last instead of walking, with another adjustment and mosaic."""
        for stage in STAGES:
            self.made[stage.name] = self.session.products.latest_value(stage.name)
        self.made["scans"] = self.corrected(self.made["scans"])
        self.made |= {"adjustment": report, "mosaic": mosaic, "change": change}

    def report(self, progress: Progress) -> str:
        """Tables, layers and the accuracy report."""
        write_all(self.session, self.content(), self.dem())
        return str(self.session.results / PAGE)

    def content(self) -> ReportContent:
        """What the report tells."""
        mosaic: MosaicProduct = self.made["mosaic"]
        return ReportContent(
            name=self.project.block.name,
            report=self.adjusted,
            adjustment=self.given.adjustment,
            before=self.made["georeference"].block,
            heights=self.project.block.heights,
            doubts=self.doubts(),
            set_aside=self.set_aside(),
            reference_sigma_m=(self.given.ortho_sigma_m, self.given.dem_sigma_m),
            reliability=self.assembly.reliability,
            mosaic=self.session.results / "mosaic.tif",
            seams=mosaic.seams,
            change=self.made["change"],
            timings_s=self.seconds,
            provenance={
                "gruber": version("gruber"),
                **{f"digest of {name}": digest[:16] for name, digest in self.digests.items()},
            },
        )

    def doubts(self) -> tuple[Doubt, ...]:
        """Everything doubtful, gravest first."""
        every: list[Doubt] = []
        names = ("scans", "georeference", "reference", "ties", "placement", "control", "adjustment")
        for name in names:
            every.extend(self.made[name].doubts if name in self.made else ())
        return tuple(sorted(every, key=lambda doubt: -doubt.gravity))

    def set_aside(self) -> dict[str, str]:
        """Scans that could not be used, with the reason."""
        reasons: dict[str, str] = {}
        for name in ("scans", "georeference"):
            reasons.update(self.made[name].set_aside if name in self.made else {})
        return reasons


def make_orthos(
    session: Session,
    project: Project,
    block: Block,
    dem: Dem,
    progress: Progress,
    anew: bool = False,
    only: frozenset[str] | None = None,
) -> list[OrthoProduct]:
    """Orthos of all oriented photos; those that are fresh stay as they are.

    Args:
        session: Where they are kept.
        project: For the ground sample distance.
        block: The adjusted block.
        dem: Heights.
        progress: Told per photo.
        anew: Make all of them again.
        only: Make no others than these; the rest stays as it is on disk.
    """
    digest_of = session.products.digest_of
    photos = [photo for photo in block.photos.values() if photo.oriented]
    gsd = project.ortho.gsd_m or default_gsd_m(block)
    usable = usable_parts(session)
    orthos: list[OrthoProduct] = []
    wanted = len(photos) if only is None else max(len(only), 1)
    made_now = 0
    for photo in photos:
        camera = block.camera_of(photo.photo_id)
        stage = f"ortho/{photo.photo_id}"
        inputs = digest_of(stage, 2, photo, camera, gsd, project.reference.dem, photo.scan)
        target = session.results / "ortho" / f"{photo.photo_id}.tif"
        # The file itself counts as well: one that was cut, replaced or removed is made again.
        kept = None if anew else session.products.load_value(stage, digest_of(inputs, target))
        if only is not None and photo.photo_id not in only:
            kept = session.products.latest_value(stage) or kept
        if kept is None or not target.is_file():
            part = Part(progress, made_now / wanted, min((made_now + 1) / wanted, 1.0))
            part.report(0, 1, photo.photo_id)
            with whole_file(target) as temporary:
                shown = usable(photo.photo_id)
                made = rectify_photo(
                    photo, camera, dem, gsd, temporary, block.crs, usable=shown, progress=part
                )
            kept = OrthoProduct(made.photo_id, target, made.grid, made.covered_share, made.nadir)
            session.products.save_value(stage, digest_of(inputs, target), kept)
            session.products.save_value(f"made-with/{photo.photo_id}", inputs, (photo, camera))
            made_now += 1
        elif only is None:
            made_now += 1
        orthos.append(kept)
    progress.report(1, 1)
    return orthos


def usable_parts(session: Session) -> Callable[[str], Mask | None]:
    """Which part of a photo's scan is photograph, without housings, data strip and marks."""
    scans: ScanSet | None = session.products.latest_value("scans")

    def usable(photo_id: str) -> Mask | None:
        if scans is None or photo_id not in scans.oriented:
            return None
        area = scans.oriented[photo_id].scan.usable
        return None if area is None else area.mask

    return usable


def default_gsd_m(block: Block) -> float:
    """The scans' own ground sample distance, rounded up to a round figure, metres."""
    sizes = [photo.ground_pixel_m(block.camera_of(name)) for name, photo in block.photos.items()]
    mean = sum(sizes) / len(sizes)
    return next((step for step in (0.1, 0.2, 0.25, 0.5, 1.0, 2.0, 5.0) if step >= mean), 10.0)


def make_mosaic(
    session: Session, orthos: list[OrthoProduct], progress: Progress, anew: bool = False
) -> MosaicProduct:
    """The mosaic of the orthos, unless it is fresh."""
    digest_of = session.products.digest_of
    inputs = digest_of("mosaic", 2, orthos)
    target, seams = session.results / "mosaic.tif", session.results / "seams.gpkg"
    kept = None if anew else session.products.load_value("mosaic", digest_of(inputs, target))
    if kept is not None and seams.is_file():
        return kept
    with whole_file(seams) as seams_part, whole_file(target) as mosaic_part:
        product = compose_mosaic(
            orthos, mosaic_grid(orthos), mosaic_part, seams_part, progress=progress
        )
    product = replace(product, path=target)
    session.products.save_value("mosaic", digest_of(inputs, target), product)
    return product


def write_all(session: Session, content: ReportContent, dem: Dem) -> None:
    """Tables, GeoPackage layers, and the report of an adjusted block."""
    block = content.report.block
    outlines = {
        name: footprint_of(photo, block.camera_of(name), dem)
        for name, photo in block.photos.items()
    }
    write_results(session.results, content.report)
    ahead = foresee(content.report, content.adjustment, terrain=terrain_of(dem))
    write_protocol(session.results, content.name, content.report, content.adjustment, ahead)
    session.write_layers(block, content.report, outlines)
    write_report(session.results, replace(content, footprints=outlines, foresight=ahead))


def told(value: Any) -> str:
    """One line about what a stage made."""
    match value:
        case ScanSet():
            rms = [scan.interior.rms_um for scan in value.oriented.values() if scan.interior.names]
            fiducials = f"fiducials {sum(rms) / len(rms):.1f} um rms" if rms else "no fiducials"
            aside = f", {len(value.set_aside)} set aside" if value.set_aside else ""
            return f"{counted(len(value.oriented), 'scan')}{aside}, {fiducials}"
        case Georeferenced():
            aside = f", {len(value.set_aside)} set aside" if value.set_aside else ""
            return f"{counted(len(value.block.photos), 'photo')} placed{aside}"
        case Tied():
            return f"{value.ties.count} tie points, {len(value.ties.point)} rays"
        case PlacedBlocks():
            photos = sum(len(part.photo_ids) for part in value.found)
            return f"{counted(photos, 'photo')} in {counted(len(value.found), 'part')}"
        case Assembly():
            return told(value.report)
        case AdjustmentReport():
            photos = value.block.photos.values()
            used = sum(item.used for item in value.block.measurements.values())
            standing = sum(photo.oriented for photo in photos)
            return (
                f"{standing} of {len(photos)} photos oriented, {used} control measurements, "
                f"sigma nought {value.sigma_nought:.2f}"
            )
        case dict():
            return f"{counted(len(value), 'photo')} searched"
        case _:
            return f"{len(value.sources)} points" if hasattr(value, "sources") else ""


def counted(number: int, thing: str) -> str:
    """`1 scan`, `2 scans`."""
    return f"{number} {thing}" if number == 1 else f"{number} {thing}s"
