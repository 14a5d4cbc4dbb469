"""What operators said about seams, as the edits that stand."""

from collections.abc import Sequence

from core.mosaic.seam_edits import SeamArea, SeamEdit, SeamLine
from sessions.decisions import Recorded, standing


def standing_seam_edits(decisions: Sequence[Recorded]) -> tuple[SeamEdit, ...]:
    """What stands of all that was drawn on the mosaic, in order."""
    said = (item.decision for item in standing(decisions))
    return tuple(one for one in said if isinstance(one, SeamLine | SeamArea))
