"""World files of the real-textured block against the truth they were blurred from."""

import json
from pathlib import Path

import numpy as np

from core.doubts import Failure
from core.geometry.camera import Camera
from core.georeference.archive import Georeference, georeference_photo, open_archive
from core.raster.dem import open_dem
from core.scans.interior_orientation import orient_scan


def test_vovcha_world_files_and_footprints__real(shared_data: Path) -> None:
    """Good world files lie within 10 m; footprints are within their prior, kappa by quarters."""
    folder = shared_data / "vovcha-film"
    truth = json.loads((folder / "truth" / "truth.json").read_text())["eo"]
    corners = {"1": (-84.0, 84.0), "2": (84.0, 84.0), "3": (84.0, -84.0), "4": (-84.0, -84.0)}
    camera = Camera("archive", 151.92, (180.0, 180.0), fiducials_mm=corners)
    dem = open_dem([folder / "dem.tif"], "EPSG:26918")
    names = sorted(truth)[::3]
    for source in ("world-file", "footprints"):
        given = Georeference(source, folder / "footprints.gpkg")
        archive = open_archive(given, "EPSG:26918", names, dem.bounds)
        for name in names:
            oriented = orient_scan(folder / "scans" / f"{name}.tif", camera, 45.0)
            found = georeference_photo(oriented, camera, archive, dem)
            assert not isinstance(found, Failure)
            assert found.source == source
            true = np.array([truth[name][axis] for axis in "XYZ"])
            aside_m = (true[2] - 330) * found.prior.sigma_angles[[1, 0, 0]] * [1, 1, 0]
            sigma = np.hypot(found.prior.sigma_centre_m, aside_m)
            assert np.abs((found.exterior.centre - true) / sigma).max() < 3
            kappa = np.radians(truth[name]["kappa_deg"])
            away = [abs(np.angle(np.exp(1j * (h.kappa - kappa)))) for h in found.hypotheses]
            assert np.degrees(min(away)) < (3 if source == "world-file" else 15)
