"""The operator whose network the user gives."""

import numpy as np
import pytest
from scipy.ndimage import correlate

from core.errors import PhotogrammetryError
from core.matching.learned import (
    MOST_CHANNELS,
    LearnedOperator,
    check_network,
    describe_image,
    features_of,
)
from core.matching.operators import Operator
from tests.core.matching.test_operators import found_at, ground
from tests.onnx_files import write_convolution

SOBEL = np.array([[-1, 0, 1], [-2, 0, 2], [-1, 0, 1]], np.float32)
KERNELS = np.stack([SOBEL, SOBEL.T, SOBEL + SOBEL.T, np.eye(3, dtype=np.float32)])[:, None]


@pytest.fixture
def sobel(tmp_path):
    """Three derivatives and a diagonal mean: four features, in groups of three and one."""
    return write_convolution(tmp_path / "sobel.onnx", KERNELS)


def by_hand(image):
    """The features of `sobel` by numpy, of unit length, (channels, rows, columns)."""
    low, high = np.percentile(image[::2, ::2], (0.5, 99.5))
    grey = np.clip((image.astype(float) - low) / (high - low), 0, 1)
    raw = np.stack([correlate(grey, kernel[0].astype(float), mode="mirror") for kernel in KERNELS])
    return raw / (np.linalg.norm(raw, axis=0) + 1e-6)


def test_features_are_those_of_numpy__oracle(sobel):
    """In more than one band of rows, with sides that are no multiples of anything."""
    image = ground(1, 301)[:, :77]
    *groups, energy = describe_image(sobel, image)
    assert [group.shape for group in groups] == [(301, 77, 3), (301, 77, 1)]
    own = np.concatenate(groups, axis=2).transpose(2, 0, 1)
    np.testing.assert_allclose(own, by_hand(image), atol=2e-4)
    np.testing.assert_allclose(energy, np.sum(own**2, axis=0), atol=1e-5)


def test_likeness_is_the_correlation_of_all_features__oracle(sobel):
    operator = LearnedOperator(sobel)
    assert isinstance(operator, Operator)
    scan, ortho = ground(2, 60), ground(3, 41)
    roads = np.zeros_like(ortho)
    shown = operator.of_scan(scan, 20)
    scores = operator.scores(shown, operator.of_reference(ortho, roads, 20))
    around, patch = by_hand(scan), by_hand(ortho)
    assert scores.shape == (20, 20)
    for row, column in ((0, 0), (7, 13), (19, 19)):
        here = around[:, row : row + 41, column : column + 41]
        wanted = np.sum(here * patch) / np.sqrt(np.sum(here**2) * np.sum(patch**2))
        assert scores[row, column] == pytest.approx(wanted, abs=1e-3)


def test_the_same_ground_is_found_where_it_was_moved_to__truth(sobel):
    image = ground(4)
    assert found_at(LearnedOperator(sobel), np.roll(image, (3, -5), (0, 1)), image) == (-5, 3)


def test_a_network_that_cannot_serve_is_told_with_its_remedy__truth(tmp_path):
    rubbish = tmp_path / "rubbish.onnx"
    rubbish.write_bytes(b"no network at all" * 20)
    many = np.zeros((MOST_CHANNELS + 1, 1, 3, 3), np.float32)
    cases = {
        tmp_path / "none.onnx": "cannot be read",
        rubbish: "no network that OpenCV can run",
        write_convolution(tmp_path / "half.onnx", KERNELS, stride=2): "makes 1, 4, 16, 32 of",
        write_convolution(tmp_path / "many.onnx", many): "makes 1, 33, 32, 64 of",
    }
    for file, message in cases.items():
        with pytest.raises(PhotogrammetryError, match=message) as caught:
            check_network(file)
        assert caught.value.file == str(file)
        assert caught.value.remedy


def test_features_that_are_no_numbers_are_refused__truth(tmp_path):
    class Network:
        def setInput(self, grey):
            self.grey = grey

        def forward(self):
            return self.grey * np.nan

    with pytest.raises(PhotogrammetryError, match="no numbers"):
        features_of(Network(), np.ones((32, 32), np.float32), tmp_path / "net.onnx")
