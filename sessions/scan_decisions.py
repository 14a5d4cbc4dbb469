"""Decisions on fiducials, masks and photos placed by clicks, applied to scans and block."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from core.arrays import Flags
from core.block import Block, Measurement, TiePoints
from core.errors import PhotogrammetryError
from core.geometry.camera import Camera
from core.geometry.drawn_mask import DrawnMask, Stroke, drawn_mask
from core.geometry.interior import InteriorOrientation
from core.georeference.approximation import Ground, approximate_from_points
from core.georeference.archive import Pairs, clicked_points
from core.results import BlockInput
from core.said import say
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
    DrawMask,
    FiducialDecision,
    FillMarks,
    JudgeFiducial,
    PlaceFiducial,
    PlacePhoto,
    Recorded,
    standing,
)

MarkChanges = dict[str, dict[str, MarkChange]]
"""By photo and by the name of the mark."""
Films = Mapping[str, ScanOrientation]
"""Scans with their marks as they were found, by photo."""
ESTIMATED = "fiducials-estimated"
"""Kind of the doubt about marks whose places only their photos tell."""

Lying = Mapping[str, tuple[str, InteriorOrientation]]
"""Camera and interior orientation by photo."""


@dataclass(frozen=True, slots=True)
class Inside:
    """What a mask covers of what is in use."""

    control: tuple[Measurement, ...]
    """Measurements the program made: they are left out."""
    held: tuple[Measurement, ...]
    """Measurements an operator stands by: they stay."""
    ties: int
    """Rays of tie points: they are left out."""


SAME_M = 0.01  # design: rounding; clicks differ by far more
"""Two places of a perspective centre no further apart are the same."""


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


def standing_masks(decisions: Sequence[Recorded]) -> tuple[DrawMask, ...]:
    """What stands of all that was drawn, in order."""
    said = (item.decision for item in standing(decisions))
    return tuple(one for one in said if isinstance(one, DrawMask))


def masks_of(drawn: Iterable[DrawMask], lying: Lying) -> dict[str, DrawnMask]:
    """The mask of every photo on which anything was drawn."""
    every = tuple(drawn)
    if not every:
        return {}
    masks = {
        name: drawn_mask(
            (
                (Stroke(one.outline, one.width, one.hides), one.on_film)
                for one in every
                if one.subject == (camera if one.on_film else name)
            ),
            interior.pixel_from_film,
        )
        for name, (camera, interior) in lying.items()
    }
    return {name: mask for name, mask in masks.items() if mask}


def knows_subject(block: Block, decision: DrawMask | PlacePhoto) -> bool:
    """True when a block has the photo, or photos of the camera."""
    if isinstance(decision, PlacePhoto):
        return decision.photo_id in block.photos
    if not decision.on_film:
        return decision.subject in block.photos
    return any(photo.camera == decision.subject for photo in block.photos.values())


def lying(block: Block) -> Lying:
    """Photos of a block as masks ask for them."""
    return {name: (photo.camera, photo.interior) for name, photo in block.photos.items()}


def with_masks(block: Block, drawn: Iterable[DrawMask]) -> Block:
    """The block with masks on its photos, and without what the program found under them."""
    masks = masks_of(drawn, lying(block))
    photos = {
        name: replace(photo, mask=masks.get(name, DrawnMask()))
        for name, photo in block.photos.items()
    }
    if not masks:
        return (
            block if not any(p.mask for p in block.photos.values()) else block.with_photos(photos)
        )
    covered = inside(block, masks)
    left_out = {
        item.key: replace(
            item,
            status="unused",
            reason=say("it lies in a part of the scan that is masked by hand"),
        )
        for item in covered.control
    }
    return replace(
        block.with_photos(photos),
        measurements={**block.measurements, **left_out},
        ties=block.ties.kept(~_hidden_rays(block.ties, masks)),
    )


def inside(block: Block, masks: Mapping[str, DrawnMask]) -> Inside:
    """What of the block's measurements and ties in use lies in masks."""
    found = [
        item
        for item in block.measurements.values()
        if item.used and item.photo_id in masks and masks[item.photo_id].hides(item.pixel)[0]
    ]
    return Inside(
        tuple(item for item in found if item.status == "auto"),
        tuple(item for item in found if item.status != "auto"),
        int(_hidden_rays(block.ties, masks).sum()),
    )


def _hidden_rays(ties: TiePoints, masks: Mapping[str, DrawnMask]) -> Flags:
    """Which rays of tie points lie in masks."""
    hidden = np.zeros(len(ties.photo), dtype=np.bool_)
    for number, name in enumerate(ties.photo_ids):
        if name in masks:
            own = ties.photo == number
            hidden[own] = masks[name].hides(ties.pixels[own])
    return hidden


def clicked_pairs(decisions: Sequence[Recorded]) -> dict[str, Pairs]:
    """The pairs of every photo as they were clicked last; none of those that were given back."""
    said = (item.decision for item in standing(decisions))
    last = {one.photo_id: one.pairs for one in said if isinstance(one, PlacePhoto)}
    return {name: pairs for name, pairs in last.items() if pairs}


def with_clicks(given: BlockInput, decisions: Sequence[Recorded]) -> BlockInput:
    """The block as its owner describes it, with photos placed at the desk."""
    clicked = clicked_pairs(decisions)
    if not clicked:
        return given
    return replace(given, georeference=replace(given.georeference, clicked=clicked))


def with_placed(block: Block, decisions: Sequence[Recorded], given: Mapping[str, Camera]) -> Block:
    """The block with every photo that was placed by clicks where those put it.

    Args:
        block: Any block.
        decisions: Everything recorded.
        given: The cameras as the block describes them, which a run begins from.
    """
    for photo_id, pairs in clicked_pairs(decisions).items():
        if photo_id in block.photos:
            camera = block.camera_of(photo_id)
            # Clicks hang on the principal point, which a run has estimated since.
            first = given.get(block.photos[photo_id].camera, camera).principal_point_mm
            camera = replace(camera, principal_point_mm=first)
            block = place_photo_again(block, photo_id, pairs, camera)
    return block


def place_photo_again(block: Block, photo_id: str, pairs: Pairs, camera: Camera) -> Block:
    """The block with one photo where its clicks put it.

    A photo that the run began from these very clicks, and found its place, is left as it is.
    Else what the program measured in it was measured at another place, and is left out; what an
    operator stands by stays.
    """
    photo = block.photos[photo_id]
    ground = Ground(block.crs, photo.ground_height_m)
    points = clicked_points(photo.scan, block.crs, pairs)
    try:
        found = approximate_from_points(points, photo.interior, camera, ground)
    except PhotogrammetryError:
        # Only what can be placed is recorded; a film turned since may say otherwise.
        return block
    away = np.hypot(*(photo.approximate.centre - found.exterior.centre)[:2])
    if away < SAME_M and photo.oriented:
        return block
    ties = block.ties
    placed = replace(
        photo, exterior=found.exterior, approximate=found.exterior, prior=found.prior, oriented=True
    )
    left_out = {
        key: _left_out(item)
        for key, item in block.measurements.items()
        if item.photo_id == photo_id and item.status == "auto"
    }
    return replace(
        block.with_photos({**block.photos, photo_id: placed}),
        measurements={**block.measurements, **left_out},
        ties=ties
        if photo_id not in ties.photo_ids
        else ties.kept(ties.photo != ties.photo_ids.index(photo_id)),
    )


def _left_out(item: Measurement) -> Measurement:
    reason = say("its photo was placed by hand since: a new run finds it again")
    return replace(item, status="unused", reason=reason)
