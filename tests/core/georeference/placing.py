"""The stage as tests call it."""

from core.georeference.stage import Georeferenced, georeference_photos
from core.progress import Work
from core.results import BlockInput
from core.scans.stage import ScanSet


def georeference(given: BlockInput, scans: ScanSet) -> Georeferenced:
    """Where the archive of a block puts its photos."""
    return georeference_photos(
        scans,
        given.scan_cameras,
        given.cameras,
        given.georeference,
        files=given.reference,
        work=Work(),
    )
