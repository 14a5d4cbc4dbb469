"""Points of a published block measured in one photo, proposed in the others and compared with the
published picks: SXB Strasbourg, five frames of strong JPEG compression, picks good to 0.6 px."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from core.adjustment.adjusted import AdjustmentOptions
from core.adjustment.block_adjustment import adjust_block
from core.block import Measurement
from core.control.located import Surroundings
from core.control.transfer import Transferred, transfer_point
from core.raster.scan_file import open_scan
from tests.core.ties.rendered import write
from tests.real.readers import SXB, read_sxb

pytestmark = pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
PICTURES = "sxb-strasbourg/prague2016_sxb/images"
RIGHT_PX = 2.0


@pytest.fixture(scope="module")
def around(shared_data: Path, tmp_path_factory) -> Surroundings:
    """The adjusted block without its published picks, and its pictures."""
    given = read_sxb(shared_data / SXB)
    report = adjust_block(given, AdjustmentOptions(estimate_cameras=False, robust=False))
    scans = {}
    for name in given.photos:
        # Once decoded: windows of a JPEG of this size are read from its beginning each time.
        copy = tmp_path_factory.mktemp("scans") / f"{name}.tif"
        grey = cv2.imread(str(shared_data / PICTURES / f"{name}.jpg"), cv2.IMREAD_GRAYSCALE)
        write(copy, grey)
        scans[name] = open_scan(copy)
    return Surroundings(report.block, scans, report.exterior_sigmas)


def proposed(around: Surroundings, votes: int) -> np.ndarray:
    """Distance from the published pick, and probability, of every pick that can be proposed."""
    rows: list[tuple[float, float]] = []
    picks: dict[str, list[Measurement]] = {}
    for pick in around.block.measurements.values():
        picks.setdefault(pick.point_id, []).append(pick)
    for point_id, own in picks.items():
        for first in range(len(own)):
            given = [own[(first + more) % len(own)] for more in range(votes)]
            others = {item.photo_id: item for item in own if item not in given}
            if not others:
                continue
            found = transfer_point(around, point_id, given)
            assert isinstance(found, Transferred)
            places = {item.photo_id: item for item in found.proposals}
            for name, pick in others.items():
                if name in places:
                    off = np.hypot(*(places[name].pixel - pick.pixel)[0])
                    rows.append((float(off), places[name].score))
                else:
                    rows.append((np.inf, 0.0))
    return np.array(rows)


def test_most_proposals_lie_on_the_published_picks__real(around):
    # The picks were made in pictures that were not compressed and differ by 0.6 px themselves; what
    # is left of these places them to 1.2 px per axis. The run gives 59 % within 2 px, 82 % within
    # 3 px and 92 % within 5 px; of 43 said to be surer than 0.9, 81 % within 2 px and 95 % within
    # 3 px. Probabilities are too high here: 0.79 in the mean.
    off, probability = proposed(around, votes=1).T
    assert len(off) == 102
    assert np.mean(off < RIGHT_PX) >= 0.5
    assert np.mean(off < 5.0) >= 0.9
    assert np.mean(off[probability >= 0.9] < RIGHT_PX) >= 0.7


def test_two_photos_propose_better_than_one__real(around):
    # The run gives 71 %.
    off, _ = proposed(around, votes=2).T
    assert np.mean(off < RIGHT_PX) >= 0.6
