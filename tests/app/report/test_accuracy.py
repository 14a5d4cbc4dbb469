"""Statistics of differences written out by hand."""

import numpy as np
import pytest

from app.report.accuracy import plan_figures


def test_statistics_follow_their_definitions__paper():
    # METHODS 9.1: c, s, m and m_p of differences written out by hand.
    differences = np.array([[0.3, -0.4, 0.0], [0.1, 0.0, 0.0], [-0.1, 0.4, 0.0], [0.1, 0.2, 0.0]])
    found = plan_figures(differences)
    assert found["mean_shift"] == pytest.approx([0.1, 0.05])
    assert found["deviation"] == pytest.approx([np.sqrt(0.08 / 3), np.sqrt(0.35 / 3)])
    assert found["m_x"] == pytest.approx(np.sqrt(0.03))
    assert found["m_y"] == pytest.approx(np.sqrt(0.09))
    assert found["m_p"] == pytest.approx(np.sqrt(0.12))
    assert found["largest"] == pytest.approx(0.5)
    assert found["mean_significant"] == [False, False]
    low, high = found["m_p_interval"]
    assert low < found["m_p"] < high
    # The radius of the circle that holds 90 % is 2.1460 times the error of one axis.
    assert found["circular_error_90"] == pytest.approx(2.1460 * np.sqrt(0.06), rel=1e-4)
