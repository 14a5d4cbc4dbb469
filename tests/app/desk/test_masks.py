"""The veil over what the program took for no photograph."""

import cv2
import numpy as np

from app.desk.masks import VEIL, as_veil


def test_the_veil_lies_where_the_scan_may_not_be_used__law() -> None:
    usable = np.ones((5, 7), dtype=np.bool_)
    usable[1:3, 2:6] = False
    read = cv2.imdecode(np.frombuffer(as_veil(usable), np.uint8), cv2.IMREAD_UNCHANGED)
    assert read is not None
    assert (np.asarray(read)[..., 3] == np.where(usable, 0, VEIL[3])).all()
