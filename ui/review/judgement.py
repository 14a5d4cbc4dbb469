"""What is found of the block on the desk: the sheet shows it, and a signature goes by it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import shapely

from core.mosaic.fault_places import misfit_findings
from core.quality.assessment import BlockQuality, assess_block
from core.quality.judged_rules import OF_READINGS, RULES, JudgedRule, judge_rules
from core.quality.readings import ReadingFigures
from core.quality.rules import (
    POOR,
    Finding,
    judge_block,
    predicted_finding,
    relative_sigma_m,
    release_limit_m,
)
from core.quality.sun import sun_findings
from core.sheets.acceptance import JudgedLot, lot_findings
from sessions.checked import Predicted, checked_by_hand, judged_lot, readings_found
from sessions.remarks import fault_findings, standing_faults
from ui.review.scene import EDGE_PARTS, Segments
from ui.review.snapshot import DeskSnapshot
from ui.review.state import DeskState


@dataclass(frozen=True, slots=True, eq=False)
class BlockJudgement:
    """The block as it is judged."""

    polygons: Mapping[str, shapely.Polygon]
    """Footprints on the terrain, block's CRS."""
    measured: BlockQuality
    """What the rules judge."""
    read: ReadingFigures | None
    """Readings of the newest plan; None without a plan."""
    findings: tuple[Finding, ...]
    """Gravest first."""
    rules: tuple[JudgedRule, ...]
    """Every rule that concerns the block."""


def judge_desk(desk: DeskSnapshot) -> BlockJudgement:
    """Judge the block by its adjustment, its holes, what was read of its mosaic, and its faults."""
    report, rules = desk.state.report, desk.rules
    polygons = footprint_polygons(desk.state, desk.outlines)
    measured = assess_block(report, polygons)
    influence, mosaic = desk.state.evidence.influence, desk.state.mosaic
    seams = () if mosaic is None else mosaic.product.seams
    relative_m = relative_sigma_m(report, influence)
    predicted = Predicted(relative_m, desk.ortho_sigma_m, influence, seams)
    checked = checked_by_hand(report, desk.recorded, desk.mosaic_version, predicted, rules=rules)
    lot = lot_of_desk(desk)
    limit = release_limit_m(report.block, rules)
    found = (
        *readings_found(checked, desk.mosaic_version, rules),
        *(() if mosaic is None else misfit_findings(mosaic.misfit)),
        *fault_findings(standing_faults(desk.recorded)),
        *(() if lot is None else lot_findings(lot, rules)),
        *((Finding("mosaic-gone", POOR),) if desk.mosaic_gone else ()),
        *sun_findings(report.block, desk.exposed, rules),
        *judge_block(measured, report, desk.state.holes, rules),
        predicted_finding(relative_m, report.block.reference_error_m(desk.ortho_sigma_m), limit),
    )
    return BlockJudgement(
        polygons,
        measured,
        None if checked is None else checked.figures,
        tuple(sorted(found, key=lambda one: -one.grave)),
        judge_rules(found, rules),
    )


def lot_of_desk(desk: DeskSnapshot, *, blind: bool = False) -> JudgedLot | None:
    """The sample of sheets that was drawn last; `blind` without readings."""
    limit = release_limit_m(desk.state.report.block, desk.rules)
    known = desk.recorded, desk.sheets, desk.mosaic_version, limit
    return judged_lot(*known, rules=desk.rules, blind=blind)


def without_readings(judged: BlockJudgement) -> BlockJudgement:
    """The same for an observer who still reads: nothing of what readings say."""
    kinds = {kind for rule in RULES if rule.name in OF_READINGS for kind in rule.kinds}
    return replace(
        judged,
        read=None,
        findings=tuple(one for one in judged.findings if one.kind not in kinds),
        rules=tuple(one for one in judged.rules if one.rule.name not in OF_READINGS),
    )


def footprint_polygons(state: DeskState, outlines: Segments) -> dict[str, shapely.Polygon]:
    """Footprints as polygons in the local frame; each photo has the same number of segments."""
    each, found = 4 * EDGE_PARTS, dict[str, shapely.Polygon]()
    for number, name in enumerate(state.oriented.photos):
        ring = outlines[number * each : (number + 1) * each, 0, :2]
        if len(ring) == each and np.isfinite(ring).all():
            polygon = shapely.Polygon(ring + state.block.origin[:2])
            hull = polygon.convex_hull
            if not polygon.is_valid and isinstance(hull, shapely.Polygon):
                polygon = hull
            found[name] = polygon
    return found
