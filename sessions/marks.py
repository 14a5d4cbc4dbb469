"""Decisions on fiducials, applied to the scans and to the block."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from core.block import Block
from core.geometry.camera import Camera
from core.geometry.interior import InteriorOrientation
from core.results import BlockInput
from core.scans.camera_group import EstimatedMarks, marks_estimated
from core.scans.corrected_marks import (
    MarkChange,
    by_hand,
    corrected_interior,
    corrected_scan,
    corrected_scans,
)
from core.scans.interior_orientation import ScanOrientation
from core.scans.stage import ScanSet
from sessions.decisions import (
    FiducialDecision,
    FillMarks,
    JudgeFiducial,
    PlaceFiducial,
    Recorded,
    standing,
)
from sessions.drawn_masks import masks_of, standing_masks

MarkChanges = dict[str, dict[str, MarkChange]]
"""By photo and by the name of the mark."""
Films = Mapping[str, ScanOrientation]
"""Scans with their marks as they were found, by photo."""
ESTIMATED = "fiducials-estimated"
"""Kind of the doubt about marks whose places only their photos tell."""


def mark_changes(decisions: Sequence[Recorded]) -> MarkChanges:
    """What stands of all that was said about fiducials.

    The last verdict and the last place of a mark count; what a person said about one mark goes
    before what was found by an example.
    """
    marks: MarkChanges = {}
    said: set[tuple[str, str]] = set()
    for item in standing(decisions):
        match item.decision:
            case PlaceFiducial(photo_id, name, column, row):
                marks.setdefault(photo_id, {})[name] = MarkChange(by_hand(name, (column, row)))
                said.add((photo_id, name))
            case JudgeFiducial(photo_id, name, use):
                own = marks.setdefault(photo_id, {})
                own[name] = replace(own.get(name, MarkChange()), use=use)
                said.add((photo_id, name))
            case FillMarks(found=found):
                for photo_id, measured in found.items():
                    fresh = {
                        mark.name: MarkChange(mark)
                        for mark in measured
                        if (photo_id, mark.name) not in said
                    }
                    marks.setdefault(photo_id, {}).update(fresh)
            case _:
                pass
    return marks


def fills(decisions: Sequence[Recorded]) -> dict[str, FillMarks]:
    """By camera, the last example that stands."""
    said = [item.decision for item in standing(decisions)]
    return {fill.camera: fill for fill in said if isinstance(fill, FillMarks)}


def with_shown_marks(
    cameras: Mapping[str, Camera], given: Mapping[str, Camera], decisions: Sequence[Recorded]
) -> tuple[dict[str, Camera], dict[str, FillMarks]]:
    """The cameras with marks that an operator showed, where no certificate has any.

    Args:
        cameras: The cameras by name, perhaps with marks that their photos told.
        given: The cameras as the block describes them.
        decisions: Everything recorded.

    Returns:
        All cameras, and the decisions that changed some of them.
    """
    shown = {
        name: fill
        for name, fill in fills(decisions).items()
        if fill.places_mm and name in cameras and not given.get(name, cameras[name]).fiducials_mm
    }
    fresh = {
        name: replace(cameras[name], fiducials_mm=dict(fill.places_mm))
        for name, fill in shown.items()
    }
    return {**cameras, **fresh}, shown


def said_of_scans(decisions: Sequence[Recorded]) -> tuple[object, ...]:
    """All that the stages after the scans depend on; empty where nothing was said."""
    marks = with_effect(mark_changes(decisions))
    places = {name: fill.places_mm for name, fill in fills(decisions).items() if fill.places_mm}
    return (marks, places) if marks or places else ()


def with_effect(marks: MarkChanges) -> MarkChanges:
    """Without what leaves a mark where and as it was found."""
    moved = {
        name: {mark: change for mark, change in own.items() if change != MarkChange()}
        for name, own in marks.items()
    }
    return {name: own for name, own in moved.items() if own}


def knows(block: Block, decision: FiducialDecision) -> bool:
    """True when a block has the photo, and its camera or its scan the mark."""
    if isinstance(decision, FillMarks):
        return any(name in block.photos for name in decision.found)
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
        own, camera = marks.get(name), block.camera_of(name)
        if found is not None and name in found:
            scan = found[name]
            pixel_mm = scan.interior.pixel_size_mm
            fresh[name] = (
                scan.interior
                if own is None
                else corrected_scan(scan, camera, pixel_mm, own).interior
            )
        elif own:
            fresh[name] = corrected_interior(photo.interior, camera, own)
    photos = {
        name: replace(block.photos[name], interior=interior)
        for name, interior in fresh.items()
        if not _same_interior(interior, block.photos[name].interior)
    }
    return block.with_photos({**block.photos, **photos}) if photos else block


def _same_interior(one: InteriorOrientation, other: InteriorOrientation) -> bool:
    """True when both put every pixel on the same place of the film, by the same marks."""
    return one is other or (
        one.names == other.names
        and np.array_equal(one.film_from_pixel_matrix, other.film_from_pixel_matrix)
        and np.array_equal(one.warp, other.warp)
    )


def judged_scans(scans: ScanSet, given: BlockInput, decisions: Sequence[Recorded]) -> ScanSet:
    """The scans as they were found, with the marks that operators corrected and their masks."""
    corrected = _with_corrected(scans, given, decisions)
    cameras, drawn = given.scan_cameras, standing_masks(decisions)
    lying = {name: (cameras[name], scan.interior) for name, scan in corrected.oriented.items()}
    masks = masks_of(drawn, lying) if drawn else {}
    if not masks:
        return corrected
    masked = {name: corrected.oriented[name].with_drawn(mask) for name, mask in masks.items()}
    return replace(corrected, oriented={**corrected.oriented, **masked})


def _with_corrected(scans: ScanSet, given: BlockInput, decisions: Sequence[Recorded]) -> ScanSet:
    """The scans with the marks that operators corrected, or had found."""
    inputs = {scan.path.stem: scan for scan in given.scans}
    families = scans.cameras or given.cameras
    families, shown = with_shown_marks(families, given.cameras, decisions)
    every = with_effect(mark_changes(decisions))
    # Where the marks of a camera are others, all its scans are oriented anew.
    marks = {
        name: every.get(name, {})
        for name in scans.oriented
        if name in every or inputs[name].camera in shown
    }
    if not marks:
        return scans
    oriented = corrected_scans(
        scans.oriented,
        {name: families[inputs[name].camera] for name in scans.oriented},
        {name: inputs[name].scan_pixel_um / 1000 for name in scans.oriented},
        marks,
    )
    changed_ones = [name for name in marks if oriented[name] is not scans.oriented[name]]
    gone = [doubt for name in changed_ones for doubt in scans.oriented[name].doubts]
    gone += [doubt for doubt in scans.doubts if doubt.kind == ESTIMATED and doubt.subject in shown]
    doubts = tuple(doubt for doubt in scans.doubts if doubt not in gone)
    doubts += tuple(doubt for name in changed_ones for doubt in oriented[name].doubts)
    doubts += tuple(
        marks_estimated(
            families[name], EstimatedMarks(fill.places_mm, fill.sigma_mm, len(fill.found), ())
        )
        for name, fill in shown.items()
    )
    return replace(scans, oriented=oriented, doubts=doubts, cameras=families)


def with_marks(
    block: Block, decisions: Sequence[Recorded], found: Films | None, given: Mapping[str, Camera]
) -> Block:
    """The block with what was said about fiducials."""
    cameras, shown = with_shown_marks(block.cameras, given, decisions)
    marks = with_effect(mark_changes(decisions))
    for name, photo in block.photos.items():
        if photo.camera in shown:
            marks.setdefault(name, {})
    return with_changes(replace(block, cameras=cameras) if shown else block, marks, found)
