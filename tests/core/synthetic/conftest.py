"""One tiny block for all tests of the synthetic flight."""

from pathlib import Path

import pytest

from core.synthetic.archive import make_block
from core.synthetic.options import SyntheticOptions

OPTIONS = SyntheticOptions(size="tiny", seed=7, relief_m=80.0)


@pytest.fixture(scope="session")
def tiny_block(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tiny")
    make_block(folder, OPTIONS)
    return folder
