"""What operators said about fiducials, laid over the scans as they were found, or over a block."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from core.block import Block
from core.geometry.interior import InteriorOrientation
from core.results import BlockInput
from core.scans.corrected_marks import (
    Changes,
    MarkChange,
    corrected_interior,
    corrected_scan,
    corrected_scans,
)
from core.scans.interior_orientation import ScanOrientation
from core.scans.stage import ScanSet
from sessions.decisions import FiducialDecision, JudgeFiducial, PlaceFiducial, Recorded, standing

MarkChanges = dict[str, dict[str, MarkChange]]
"""By photo and by the name of the mark."""
Films = Mapping[str, ScanOrientation]
"""Scans with their marks as they were found, by photo."""


def mark_changes(decisions: Sequence[Recorded]) -> MarkChanges:
    """What stands of all that was said about fiducials."""
    marks: MarkChanges = {}
    for item in standing(decisions):
        if isinstance(item.decision, JudgeFiducial | PlaceFiducial):
            changed(marks, item.decision)
    return marks


def with_effect(marks: MarkChanges) -> MarkChanges:
    """Without what leaves a mark where and as it was found."""
    moved = {
        name: {mark: change for mark, change in own.items() if change != MarkChange()}
        for name, own in marks.items()
    }
    return {name: own for name, own in moved.items() if own}


def changed(marks: MarkChanges, decision: FiducialDecision) -> None:
    """Add one decision: the last verdict and the last place of a mark count."""
    own = marks.setdefault(decision.photo_id, {})
    before = own.get(decision.name, MarkChange())
    match decision:
        case PlaceFiducial(column=column, row=row):
            own[decision.name] = MarkChange((column, row))
        case JudgeFiducial(use=use):
            own[decision.name] = replace(before, use=use)


def knows(block: Block, decision: FiducialDecision) -> bool:
    """True when a block has the photo, and its camera or its scan the mark."""
    photo = block.photos.get(decision.photo_id)
    if photo is None:
        return False
    named = block.camera_of(decision.photo_id).fiducials_mm
    return decision.name in named or decision.name in photo.interior.names


def with_changes(block: Block, marks: MarkChanges, found: Films | None = None) -> Block:
    """The block with interior orientations from corrected marks.

    Args:
        block: Any block; its marks may have been corrected before it was made.
        marks: What was said.
        found: The scans as they were found, which make the result exact and let a correction be
            taken back; without them, marks count as good as usual ones.
    """
    fresh: dict[str, InteriorOrientation] = {}
    for name, photo in block.photos.items():
        own, camera = marks.get(name, {}), block.camera_of(name)
        if found is not None and name in found:
            scan = found[name]
            pixel_mm = scan.interior.pixel_size_mm
            fresh[name] = (
                corrected_scan(scan, camera, pixel_mm, own).interior if own else (scan.interior)
            )
        elif own:
            fresh[name] = corrected_interior(photo.interior, camera, own)
    photos = {
        name: replace(block.photos[name], interior=interior)
        for name, interior in fresh.items()
        if not _same(interior, block.photos[name].interior)
    }
    return block.with_photos({**block.photos, **photos}) if photos else block


def _same(one: InteriorOrientation, other: InteriorOrientation) -> bool:
    """True when both put every pixel on the same place of the film, by the same marks."""
    return one is other or (
        one.names == other.names
        and np.array_equal(one.film_from_pixel_matrix, other.film_from_pixel_matrix)
        and np.array_equal(one.warp, other.warp)
    )


def judged_scans(scans: ScanSet, given: BlockInput, decisions: Sequence[Recorded]) -> ScanSet:
    """The scans as they were found, with the marks that operators corrected."""
    marks: dict[str, Changes] = {
        name: own
        for name, own in with_effect(mark_changes(decisions)).items()
        if name in scans.oriented
    }
    if not marks:
        return scans
    inputs = {scan.path.stem: scan for scan in given.scans}
    families = scans.cameras or given.cameras
    oriented = corrected_scans(
        scans.oriented,
        {name: families[inputs[name].camera] for name in scans.oriented},
        {name: inputs[name].scan_pixel_um / 1000 for name in scans.oriented},
        marks,
    )
    changed_ones = [name for name in marks if oriented[name] is not scans.oriented[name]]
    gone = [doubt for name in changed_ones for doubt in scans.oriented[name].doubts]
    doubts = tuple(doubt for doubt in scans.doubts if doubt not in gone)
    doubts += tuple(doubt for name in changed_ones for doubt in oriented[name].doubts)
    return replace(scans, oriented=oriented, doubts=doubts)
