"""What a gesture on the fiducial board means: a decision about one mark, or a word why not."""

from core.doubts import Failure
from sessions.decisions import FiducialDecision, JudgeFiducial, PlaceFiducial
from ui.review.gestures import MarkJudged, MarkPlaced
from ui.review.origins import Origins, snapped
from ui.review.state import DeskState, Notice


def marked(
    gesture: MarkPlaced | MarkJudged, state: DeskState, origins: Origins
) -> tuple[FiducialDecision | None, Notice | None]:
    """The decision to record, and what to tell the operator."""
    photo = state.block.photos.get(gesture.photo_id)
    if photo is None:
        return None, None
    known = state.block.camera_of(gesture.photo_id).fiducials_mm
    if gesture.name not in known and gesture.name not in photo.interior.names:
        return None, None
    if isinstance(gesture, MarkJudged):
        return JudgeFiducial(gesture.photo_id, gesture.name, gesture.use), None
    columns, rows = photo.size_px
    place = (gesture.column, gesture.row)
    if not (0 <= place[0] <= columns and 0 <= place[1] <= rows):
        return None, Notice("notice.outside", {"scan": gesture.photo_id}, grave=True)
    if not gesture.snap:
        return PlaceFiducial(gesture.photo_id, gesture.name, *place), None
    found = snapped(origins, gesture.photo_id, gesture.name, place)
    if isinstance(found, Failure):
        return None, Notice("notice.not-snapped", {"why": found.reason})
    moved = found.column - place[0], found.row - place[1]
    values = {
        "name": gesture.name,
        "distance": f"{(moved[0] ** 2 + moved[1] ** 2) ** 0.5:.2f}",
        "alike": f"{found.correlation:.2f}",
    }
    decision = PlaceFiducial(gesture.photo_id, gesture.name, found.column, found.row)
    return decision, Notice("notice.snapped", values)
