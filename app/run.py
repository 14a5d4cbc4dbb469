"""Walk the stages in order; a stage whose product is up to date is skipped."""

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import shapely

from app.bring_points import brought_points
from app.height_checks import doubts_after
from app.misfit import make_comparisons, make_misfit, make_places
from app.mosaic import compare_neighbours, make_change, make_mosaic
from app.origin import make_origin
from app.orthos import make_orthos
from app.project import Project, described
from app.references import tied_to
from app.report.against import read_earlier
from app.report.checked import REMARK_COLUMNS, REMARKS, remark_rows
from app.report.model import ReportContent, written_now
from app.report.page import write_report
from app.report.protocol import write_protocol
from app.report.tables import write_fiducials, write_results, write_table
from app.settings import Threads
from app.sheets import PRODUCT as SHEETS
from app.sheets import make_sheets, sheets_line
from app.stage_lines import STAGE_LINES, adjusted_line, last_lines, lines_at_once, notes_ahead
from app.stand_ins import has_pictures, write_adjusted
from app.surface import make_block_surface, make_ground, surface_line
from app.terminal import Interruption, Voice, interruptible
from core.adjustment.adjusted import AdjustmentOptions, AdjustmentReport
from core.adjustment.influence import influence_of
from core.adjustment.weights import Terrain
from core.control.stage import ControlFound, adjusted_without_gross
from core.doubts import Doubt
from core.errors import Cancelled
from core.formats.qgis_project import result_layers, write_qgis_project
from core.localisation.stage import Localised
from core.matching.reference import level_of, open_heights
from core.mosaic.composition import MosaicProduct
from core.orthos.rectification import footprint_of
from core.pipeline import STAGES, Stage, made
from core.progress import Part, Progress, Work
from core.raster.dem import Dem
from core.raster.files import count_bands
from core.raster.ortho import open_ortho
from core.raster.stand_in import NO_PICTURES
from core.results import BlockInput, StageResults
from core.said import say
from core.scans.stage import ScanSet
from sessions.atomic_write import whole_file
from sessions.checks import results_digest, version_on_disk
from sessions.remarks import standing_faults
from sessions.scan_decisions import Films, judged_scans, said_of_scans, standing_masks, with_clicks
from sessions.session import FILE as SESSION_FILE
from sessions.session import Session
from ui.words.catalogue import LANGUAGES

LAST_STAGES = {
    "adjustment": "Adjustment with your decisions",
    "surface": "Surface from the photos",
    "orthos": "Orthophotos",
    "mosaic": "Mosaic",
    "sheets": "Map sheets",
    "report": "Results and report",
}
PAGE = "report.html"
QGIS_PROJECT = "block.qgs"
WRITTEN = "written"
"""Product that keeps the digest of the results that tables and report on disk tell."""
LANGUAGE = "report-language"
"""Product that keeps the language of the last report."""
WALKED, TIMES = "walked", "times"
"""Products: the last walk, for a report written without one; how long each product took."""
NOTHING_STANDS = (
    "No photo is oriented yet, so there is nothing to make orthos of. Measure four surveyed points "
    "in a photo at the desk (gruber review), then run the block again."
)
"""What ends the walk of a block in which nothing but surveyed points can orient a photo."""
WHEN_ASKED = ("surface", "sheets")
"""Stages that are walked only where block.toml or the operator asks for them."""
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
    language: str = ""
    """Of the report; that of the last one when left out."""
    against: Path | None = None
    """Folder or report.json of an earlier state that the report is compared with."""


class Run:
    """One walk over the stages of one block."""

    def __init__(
        self, project: Project, session: Session, voice: Voice, options: RunOptions
    ) -> None:
        self.project, self.session, self.voice, self.options = project, session, voice, options
        self.given = given_of(project, session)
        self.digest_of = session.products.digest_of
        self.results = StageResults()
        self.passes = 1
        self.digests: dict[str, str] = {}
        self.last_pass: dict[str, str] = {}
        self.seconds: dict[str, float] = {}
        self.times: dict[str, float] = session.products.latest_value(TIMES) or {
            f"{name}/1": seconds for name, seconds in self.last_walk.get("seconds", {}).items()
        }
        self.threads = Threads(options.workers, lambda: self.interruption.check())
        self.interruption = Interruption()
        self.films: Films = {}
        scans = [scan.path.stem for scan in self.given.scans]
        self.earlier = None if options.against is None else read_earlier(options.against, scans)
        self.told: list[str] = []
        """What was said before the walk."""
        self.ended_early = ""
        """Why the walk went no further than the adjustment; empty where it did."""

    @property
    def last_walk(self) -> dict[str, Any]:
        """Seconds and digests by stage, as the last report told them; empty without one."""
        return self.session.products.latest_value(WALKED) or {}

    def walk(self) -> None:
        """Go through all stages up to the last one wanted."""
        self.told = notes_ahead(self.names_ahead, self.project)
        for note in self.told:
            self.voice.say(note)
        with self.session.running(), interruptible() as self.interruption:
            waits = True
            try:
                for name in self.names_in_turn():
                    self.step(name)
                    if name == self.options.last and not self.again(name):
                        break
                    if name == "adjustment" and (why := self.end_of_walk()):
                        self.ended_early = why
                        if self.stands:
                            self.voice.say(why)
                        else:
                            self.voice.ended_early(why)
                        break
            except (KeyboardInterrupt, Cancelled):
                waits = False
                raise
            finally:
                self.threads.close(waits)
        page = str(self.session.results / PAGE)
        for line in last_lines(self.results, self.doubts, self.project.rules, page):
            self.voice.say(line)

    @property
    def names_ahead(self) -> tuple[str, ...]:
        """The stages up to the last one wanted."""
        last = self.options.last
        names = STAGE_NAMES if last is None else STAGE_NAMES[: STAGE_NAMES.index(last) + 1]
        return tuple(name for name in names if name not in WHEN_ASKED or self.asked(name))

    def names_in_turn(self) -> Iterator[str]:
        """The stages in the order they are walked; the repeated ones until control is final."""
        repeated = [stage.name for stage in STAGES if stage.repeated]
        for name in self.names_ahead:
            yield name
            while self.again(name):
                self.passes += 1
                yield from repeated

    def asked(self, name: str) -> bool:
        """Whether block.toml or the operator asks for a stage that not every block needs."""
        named = name in (self.options.first, self.options.last)
        return named or name in self.project.asked_for

    def again(self, name: str) -> bool:
        """Whether the photos have not settled with this stage, so that a pass follows."""
        control = self.results.control
        return name == "control" and control is not None and not control.final

    def step(self, name: str) -> None:
        """One stage, made or found fresh, with one line said about it."""
        stage = next((stage for stage in STAGES if stage.name == name), None)
        title = LAST_STAGES[name] if stage is None else stage.title
        if stage is not None and stage.repeated and self.passes > 1:
            title = say("{title} (pass {number})", title=title, number=self.passes)
        started = time.monotonic()
        self.interruption.check()
        progress = self.interruption.watching(self.voice.stage(name, title))
        last: Mapping[str, Callable[[Progress], str]] = {
            "adjustment": self.adjust,
            "surface": self.match,
            "orthos": self.rectify,
            "mosaic": self.compose,
            "sheets": self.cut,
            "report": self.report,
        }
        products = self.session.products
        saved, product = products.saved, f"{name}/{self.passes}"
        said = last[name](progress) if stage is None else self.compute(stage, progress)
        took = time.monotonic() - started
        if products.saved > saved:
            self.times[product] = took
            products.save_value(TIMES, self.digest_of(TIMES), self.times)
        self.seconds[name] = self.seconds.get(name, 0.0) + self.times.get(product, 0.0)
        self.voice.ended(name, title, took, said)
        for line in lines_at_once(name, self.results):
            self.voice.say(line)

    def anew(self, name: str) -> bool:
        """Whether the operator wants this stage made again whatever is there."""
        first = self.options.first
        return first is not None and STAGE_NAMES.index(name) >= STAGE_NAMES.index(first)

    def compute(self, stage: Stage, progress: Progress) -> str:
        """A stage of the engine."""
        products = self.session.products
        product, digest = product_of(stage, self.passes, self.given, self.session, self.digests)
        self.digests[stage.name] = digest
        value = None if self.anew(stage.name) else products.load_value(product, digest)
        fresh = value is not None
        if not fresh:
            work = Work(progress, self.threads.map, self.given.name)
            value = stage.run(self.given, self.results, work)
            products.save_value(product, digest, value)
        if isinstance(value, ScanSet):
            value = self.corrected(value)
        elif isinstance(value, Localised) and fresh and self.results.localisation is not None:
            value = replace(value, features=self.results.localisation.features)
        self.results = replace(self.results, **{stage.name: value})
        if stage.repeated:
            self.last_pass[stage.name] = product
        if stage.name == "control" and not self.again("control"):
            self.renew_last_pass()
        told = STAGE_LINES[stage.name](self.results)
        return say("{told} (as before)", told=told) if fresh else told

    def renew_last_pass(self) -> None:
        """Let the last pass count as the last, also where only an earlier one was made again."""
        for name, product in self.last_pass.items():
            self.session.products.count_as_last(name, product, self.digests[name])

    def corrected(self, found: ScanSet) -> ScanSet:
        """The scans as operators corrected them: all that follows depends on their fiducials."""
        decisions = self.session.decisions()
        scans, self.films = judged_scans(found, self.given, decisions), found.oriented
        if said := said_of_scans(decisions):
            self.digests["scans"] = self.digest_of(self.digests.get("scans", ""), said)
        write_fiducials(self.session.results, self.given, scans)
        return scans

    def adjust(self, progress: Progress) -> str:
        """Lay the operator's decisions over the block and adjust it."""
        found, cameras = self.films, self.given.cameras
        block = self.session.replayed(self.assembly.report.block, found, cameras)
        options = self.given.adjustment
        digest = adjustment_digest(self.session, self.digests["control"], options)
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
        self.results = replace(self.results, adjustment=report)
        return adjusted_line(report)

    @property
    def assembly(self) -> ControlFound:
        """The block as the engine proposes it."""
        return made(self.results.control)

    @property
    def adjusted(self) -> AdjustmentReport:
        """The block as it stands with the operator's decisions."""
        return made(self.results.adjustment)

    @property
    def stands(self) -> bool:
        """Whether any photo is oriented."""
        return any(photo.oriented for photo in self.adjusted.block.photos.values())

    def end_of_walk(self) -> str:
        """Why the walk ends with the adjustment, whose tables are then written; else empty."""
        if not self.stands:
            return NOTHING_STANDS
        if has_pictures(self.adjusted.block):
            return ""
        write_adjusted(self.session, self.project, self.adjusted, self.dem())
        return NO_PICTURES

    def dem(self) -> Dem:
        """Heights under the block, held in memory."""
        bounds = made(self.results.georeference).block.search_bounds
        level_m = level_of(self.assembly.report.block)
        return open_heights(self.given.reference, level_m).cropped(bounds)

    @property
    def doubts(self) -> tuple[Doubt, ...]:
        """Everything doubtful, gravest first; the systems of heights among it."""
        if self.results.control is None:
            return self.results.doubts
        return doubts_after(self.project, self.results, self.dem)

    def match(self, progress: Progress) -> str:
        """The surface from the photos themselves."""
        work = Work(progress, self.threads.map, self.given.name)
        surface = make_block_surface(
            self.session, self.project, self.adjusted, self.dem(), work, self.anew("surface")
        )
        self.results = replace(self.results, surface=surface)
        make_ground(self.session, self.project, surface)
        return surface_line(surface)

    def rectify(self, progress: Progress) -> str:
        """One ortho of every oriented photo."""
        session, project, block = self.session, self.project, self.adjusted.block
        orthos = make_orthos(session, project, block, self.dem(), progress, self.anew("orthos"))
        self.results = replace(self.results, orthos=tuple(orthos))
        gsd = orthos[0].grid.ground_sample_distance_m
        return say("{count:# ortho|# orthos} at {gsd:g} m", count=len(orthos), gsd=gsd)

    def compose(self, progress: Progress) -> str:
        """The mosaic and its seams."""
        anew = self.anew("mosaic")
        first, second = Part(progress, 0.0, 0.7), Part(progress, 0.7, 1.0)
        orthos = made(self.results.orthos)
        mosaic = make_mosaic(self.session, self.project, orthos, first, anew)
        change = make_change(self.session, self.project, mosaic, second, anew=anew)
        self.results = replace(self.results, mosaic=mosaic, change=change)
        for note in mosaic.notes:
            if note not in self.told:
                self.voice.say(note)
        return str(mosaic.path)

    def cut(self, progress: Progress) -> str:
        """The map sheets of the mosaic."""
        mosaic, anew = made(self.results.mosaic), self.anew("sheets")
        sheets = make_sheets(self.session, self.project, mosaic, progress, anew=anew)
        self.results = replace(self.results, sheets=sheets)
        return sheets_line(sheets)

    def stand_in(
        self, report: AdjustmentReport, mosaic: MosaicProduct, change: Mapping[str, float]
    ) -> None:
        """Take what was made last instead of walking, with another adjustment and mosaic.

        What the last walk took, and what its stages were made from, is told again.
        """
        self.seconds = {**self.last_walk.get("seconds", {})}
        self.digests = {**self.last_walk.get("digests", {})}
        latest = {stage.name: self.session.products.latest_value(stage.name) for stage in STAGES}
        latest["sheets"] = self.session.products.latest_value(SHEETS)
        latest["scans"] = self.corrected(cast("ScanSet", latest["scans"]))
        self.results = StageResults(**latest, adjustment=report, mosaic=mosaic, change=change)

    def report(self, progress: Progress) -> str:
        """Tables, layers and the accuracy report."""
        walked = {"seconds": self.seconds, "digests": self.digests}
        if walked != self.last_walk:
            self.session.products.save_value(WALKED, self.digest_of(WALKED), walked)
        write_all(self.session, self.content(progress), self.dem())
        return str(self.session.results / PAGE)

    @property
    def language(self) -> str:
        """The one that was asked for, else that of the last report."""
        products = self.session.products
        if self.options.language:
            asked = self.options.language
            products.save_value(LANGUAGE, self.digest_of(LANGUAGE, asked), asked)
        return products.latest_value(LANGUAGE) or LANGUAGES[0]

    def content(self, progress: Progress) -> ReportContent:
        """What the report tells; the mosaic is compared with the reference for it."""
        mosaic, files = made(self.results.mosaic), self.given.reference
        anew, work = self.anew("report"), Work(progress, self.threads.map)
        fits = compare_neighbours(self.session, mosaic, work.part(0.0, 0.1), anew=anew)
        dem, adjusted = self.dem(), self.adjusted
        misfit = make_misfit(
            self.session, self.given, mosaic, adjusted, dem, work.part(0.1, 0.9), anew=anew
        )
        make_origin(self.session, self.project, self.given, mosaic, adjusted, dem, anew=anew)
        rest = work.part(0.9, 1.0)
        compared, doubts = make_comparisons(
            self.session, self.project, self.given, mosaic, adjusted, dem, rest, anew=anew
        )
        likely = make_places(
            self.session, self.project, self.given, mosaic, adjusted, dem, (misfit, fits)
        )
        return ReportContent(
            name=self.project.block.name,
            report=self.adjusted,
            adjustment=self.adjusted.options or self.given.adjustment,
            before=made(self.results.georeference).block,
            heights=self.project.block.heights,
            doubts=(*self.doubts, *doubts),
            set_aside=self.results.set_aside,
            reference_sigma_m=(files.ortho_sigma_m, files.dem_sigma_m) if files.ortho else None,
            reliability=self.assembly.reliability,
            mosaic=mosaic.path,
            ortho=open_ortho(files.ortho, files.crs) if files.ortho else None,
            seams=mosaic.seams,
            seam_fits=fits,
            holes=mosaic.holes,
            area_shown=None if mosaic.area is None else mosaic.covered_share,
            change=made(self.results.change),
            misfit=misfit,
            likely_faults=likely,
            sheets=self.results.sheets,
            tied_to=tied_to(files, adjusted),
            comparisons=compared,
            timings_s=self.seconds,
            written=written_now(self.session.operator),
            decisions=self.session.decisions(),
            proposed=self.assembly.report.block,
            mosaic_version=version_on_disk(self.session.products),
            rules=self.project.rules,
            exposed=self.project.exposed,
            against=self.earlier,
            language=self.language,
            provenance={f"digest of {name}": text[:16] for name, text in self.digests.items()},
        )


def given_of(project: Project, session: Session) -> BlockInput:
    """What the engine is given of a block: its files, and what was brought and clicked since."""
    given = described(project, brought_points(session))
    return with_clicks(given, session.decisions())


def product_of(
    stage: Stage, passes: int, given: BlockInput, session: Session, digests: Mapping[str, str]
) -> tuple[str, str]:
    """Name and digest of what a stage makes in a pass; `digests` are those of what it needs."""
    digest_of, repeats = session.products.digest_of, stage.repeated and passes > 1
    # What is walked again begins where control put the photos in the last pass.
    needs = (*stage.needs, "control") if repeats else stage.needs
    needed = [digests[name] for name in needs]
    if stage.masked and (drawn := standing_masks(session.decisions())):
        needed.append(digest_of(drawn))
    digest = digest_of(stage.name, stage.version, stage.inputs(given), needed)
    return f"{stage.name}/{passes}" if repeats else stage.name, digest


def adjustment_digest(session: Session, control: str, options: AdjustmentOptions) -> str:
    """Digest of an adjustment with all decisions; `control` is that of the proposed block."""
    return session.products.digest_of("adjustment", 5, control, session.changing(), options)


def write_all(session: Session, content: ReportContent, dem: Dem) -> None:
    """Tables, GeoPackage layers, and the report of an adjusted block."""
    block = content.report.block
    outlines = {
        name: footprint_of(photo, block.camera_of(name), dem)
        for name, photo in block.photos.items()
    }
    write_results(session.results, content.report)
    ahead = influence_of(content.report, content.adjustment, terrain=terrain_of(dem))
    told = content.name, content.report, content.adjustment, ahead
    write_protocol(session.results, *told, rules=content.rules)
    faults = standing_faults(content.decisions)
    write_table(session.results / REMARKS, REMARK_COLUMNS, remark_rows(content.decisions))
    session.write_layers(block, content.report, outlines, content.misfit, faults)
    write_report(session.results, replace(content, footprints=outlines, influence=ahead))
    west, south, east, north = shapely.total_bounds(list(outlines.values())).tolist()
    with whole_file(session.results / QGIS_PROJECT) as temporary:
        bands = count_bands(content.mosaic) if content.mosaic else 1
        layers = result_layers(f"../{SESSION_FILE}", bands)
        write_qgis_project(temporary, content.name, block.crs, layers, (west, south, east, north))
    told = results_digest(content.report)
    if session.products.load_value(WRITTEN, told) is None:
        session.products.save_value(WRITTEN, told, told)


def written_results(session: Session, latest: AdjustmentReport | None) -> str:
    """Digest of the results that tables and report on disk tell; empty where there are none.

    Args:
        session: That of the block.
        latest: The last adjustment, of which they were taken to tell before this was kept.
    """
    if latest is None or not (session.results / PAGE).is_file():
        return ""
    return session.products.latest_digest(WRITTEN) or results_digest(latest)


def terrain_of(dem: Dem) -> Terrain:
    """The heights of a DEM under object points."""
    return lambda points: dem.heights(points[:, :2])
