"""A whole film block of real texture: few roads, much forest, 190 m relief at 700 m height."""

import shutil
from pathlib import Path

from core.mosaic.comparison import compare_orthos
from core.synthetic.truth import judge_control, read_truth
from tests.real.blocks import run_block


def test_vovcha_is_oriented_and_its_mosaic_close_to_truth__real(
    shared_data: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "vovcha-film"
    shutil.copytree(shared_data / "vovcha-film", folder)
    report = run_block(folder, "--until", "mosaic")
    assert all(photo.oriented for photo in report.block.photos.values())
    accuracy = compare_orthos(folder / "results/mosaic.tif", folder / "truth/archival_ortho.tif")
    # About 1.1 m lie between the two orthophotos themselves; 2.0 m is what was promised.
    assert accuracy.m_p <= 2.0
    assert accuracy.n >= 100
    # A measurement counts as wrong 3 m from truth, which holds those 1.1 m too.
    assert judge_control(read_truth(folder), report.block).wrong_share <= 0.02
