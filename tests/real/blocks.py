"""Real blocks copied into a folder of the test's own, and run from the command line."""

import csv
import shutil
from pathlib import Path
from typing import cast

import numpy as np

from core.adjustment.adjusted import AdjustmentReport
from sessions.session import Session
from tests.journeys.copies import run_alone

NGI_TOML = """[block]
name = "ngi-baviaanskloof"
crs = "{crs}"

[camera.dmc]
principal_distance_mm = 120.0
frame_mm = [92.16, 165.888]

[scans]
files = "scans/*.tif"
camera = "dmc"
scan_pixel_um = 144.0
exterior = "eo.csv"
georeference = "none"

[reference]
ortho = "ortho.tif"
dem = "dem.tif"
ortho_sigma_m = 5.0
dem_sigma_m = 5.0

[ortho]
gsd_m = 5.0
"""


def run_block(folder: Path, *arguments: str) -> AdjustmentReport:
    """Run a block from the command line and return its last adjustment."""
    told = run_alone("run", folder, *arguments)
    assert told.code == 0, told.err
    with Session.open(folder, "test") as session:
        return cast("AdjustmentReport", session.products.latest_value("adjustment"))


def ngi_published(data: Path) -> list[dict[str, str]]:
    """The published orientation of the frames, as rows."""
    with (data / "ngi-baviaanskloof/io/ngi_xyz_opk.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def ngi_block(data: Path, folder: Path, seed: int, blur_m: float = 200.0) -> Path:
    """The NGI frames with nothing of their orientation but positions blurred by `blur_m`."""
    source = data / "ngi-baviaanskloof"
    (folder / "scans").mkdir(parents=True)
    for frame in sorted(source.glob("frames/*RGB.tif")):
        shutil.copy(frame, folder / "scans" / frame.name)
    shutil.copy(source / "frames/dem.tif", folder / "dem.tif")
    shutil.copy(source / "reference/sentinel2_b432_byte.tif", folder / "ortho.tif")
    crs = (source / "io/ngi_xyz_opk.prj").read_text(encoding="utf-8").strip()
    (folder / "block.toml").write_text(NGI_TOML.format(crs=crs), encoding="utf-8")
    write_blurred_positions(data, folder / "eo.csv", seed, blur_m)
    return folder


def write_blurred_positions(data: Path, path: Path, seed: int, blur_m: float) -> None:
    """The published positions of the NGI frames with noise, and no angles."""
    rng = np.random.default_rng(seed)
    with path.open("w", encoding="utf-8") as file:
        file.write("scan,X,Y,Z,omega_deg,phi_deg,kappa_deg,sigma_X,sigma_Y,sigma_Z\n")
        for row in ngi_published(data):
            place = [float(row[axis]) + rng.normal(0, blur_m) for axis in "xyz"]
            figures = ",".join(f"{value:.1f}" for value in place)
            file.write(f"{row['filename']},{figures},,,,{blur_m},{blur_m},{blur_m}\n")
