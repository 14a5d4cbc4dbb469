"""What the report tells of the mosaic: seams, holes, misfit against the reference."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
import shapely

from app.report.accuracy import histogram
from app.report.drawing import draw_misfit
from app.report.plots import draw_histogram
from core.geometry.robust import nmad
from core.mosaic.fault_places import FaultPlace
from core.mosaic.misfit_places import SURE, Misfit, MisfitPlace
from core.mosaic.seam_fit import SeamFit
from core.mosaic.seams import Seam
from core.raster.holes import Hole
from ui.words.catalogue import Teller

Figures = dict[str, Any]


def mosaic_figures(
    path: Path, seams: Sequence[Seam], holes: Sequence[Hole], fits: Sequence[SeamFit]
) -> Figures:
    """Size, seams with the fit of the photos beside them, and holes."""
    with rasterio.open(path) as file:
        bounds, columns, rows, gsd = file.bounds, file.width, file.height, file.res[0]
    return {
        "file": path.name,
        "columns": columns,
        "rows": rows,
        "ground_sample_distance_m": gsd,
        "bounds": list(bounds),
        "holes": [
            asdict(hole) | {"why": hole.why, "told_photos": hole.told_photos} for hole in holes
        ],
        "seams": [
            {
                "scan": seam.photo_id,
                "date": seam.date,
                "area_km2": seam.area.area / 1e6,
                "rings": [
                    [[round(x, 1), round(y, 1)] for x, y, *_ in part.exterior.coords]
                    for part in shapely.get_parts(seam.area)
                ],
            }
            for seam in seams
        ],
        "neighbours": [_neighbours(fit) for fit in fits],
    }


def _neighbours(fit: SeamFit) -> Figures:
    """Two photos along their seam, without every match."""
    return {name: value for name, value in asdict(fit).items() if name != "matches"}


def misfit_figures(misfit: Misfit | None) -> Figures | None:
    """Vectors, their systematic part, and places, worst first; None where nothing was compared."""
    if misfit is None:
        return None
    vectors, found = misfit.vectors, misfit.vectors.found
    shifts, trend = vectors.shifts_m[found], misfit.systematic
    return {
        "tried": vectors.tried,
        "compared": len(found),
        "count": int(found.sum()),
        "ground_sample_distance_m": vectors.ground_sample_distance_m,
        "nmad_m": [nmad(axis) for axis in shifts.T] if len(shifts) else None,
        "median_m": np.median(shifts, axis=0).tolist() if len(shifts) else None,
        "predicted_m": np.nanmedian(vectors.predicted_sigmas_m[found], axis=0).tolist()
        if np.isfinite(vectors.predicted[found]).any()
        else None,
        "histogram": histogram(shifts.ravel(), "m") if len(shifts) else None,
        "systematic": None
        if trend is None
        else {
            "shift_m": list(trend.shift_m),
            "shift_sigma_m": list(trend.shift_sigma_m),
            "scale_ppm": 1e6 * trend.scale,
            "rotation_deg": float(np.degrees(trend.rotation)),
            "scale_sigma_ppm": 1e6 * trend.scale_sigma,
            "rotation_sigma_deg": float(np.degrees(trend.scale_sigma)),
            "rms_m": trend.rms_m,
            "largest_m": trend.largest_m,
            "remainder_m": trend.remainder_m,
        },
        "judged": misfit.judged,
        "sure": SURE,
        "significant": sum(place.significant for place in misfit.places),
        "places": [place_figures(place) for place in misfit.places],
        "vectors": [
            {
                "position": vectors.positions[row].tolist(),
                "vector_m": vectors.shifts_m[row].tolist(),
                "sigma_m": float(vectors.sigmas_m[row]),
                "probability": float(vectors.probabilities[row]),
                "scan": vectors.photo_ids[row],
            }
            for row in np.flatnonzero(found).tolist()
        ],
    }


def place_figures(place: MisfitPlace) -> Figures:
    """One place."""
    return {
        "position": [place.east, place.north],
        "scan": place.photo_id,
        "shift_m": list(place.shift_m),
        "length_m": place.length_m,
        "sigma_m": place.sigma_m,
        "predicted_m": list(place.predicted_m),
        "probability": place.probability,
        "significant": place.significant,
        "vectors": place.vectors,
        "radius_m": place.radius_m,
    }


def fault_figures(place: FaultPlace) -> Figures:
    """One place at which the mosaic is likely to be wrong."""
    return {
        "kind": place.kind,
        "position": [place.east, place.north],
        "scans": list(place.photo_ids),
        "shift_m": list(place.shift_m),
        "length_m": place.length_m,
        "sigma_m": place.sigma_m,
        "predicted_m": list(place.predicted_m),
        "probability": place.probability,
        "significant": place.significant,
        "height_m": place.height_m,
    }


def misfit_shown(figures: Figures, tell: Teller) -> Figures:
    """What the page shows of the misfit: its sentences, its map, and the caption of that."""
    misfit, likely = figures["misfit"], figures["likely_faults"]
    if not misfit:
        return {"misfit_told": [], "misfit_map": "", "misfit_caption": "", "misfit_bars": ""}
    drawn, times = draw_misfit(figures["map"], {**misfit, "places": likely}, tell)
    return {
        "misfit_told": misfit_told(misfit, tell),
        "misfit_map": drawn,
        "misfit_caption": tell("report.misfit.caption", scale=times) if times else "",
        "misfit_bars": draw_histogram(misfit["histogram"], tell, "m")
        if misfit["histogram"]
        else "",
    }


def misfit_told(misfit: Figures, tell: Teller) -> list[str]:
    """How far the mosaic is off, what of it is systematic, and the worst places, in sentences."""
    told = [tell("report.misfit.compared", compared=misfit["compared"], count=misfit["count"],
                 gsd=misfit["ground_sample_distance_m"])]  # fmt: skip
    if misfit["nmad_m"] is not None:
        east, north = misfit["nmad_m"]
        told.append(tell("report.misfit.nmad", east=east, north=north))
    if misfit["predicted_m"] is not None:
        east, north = misfit["predicted_m"]
        told.append(tell("report.misfit.predicted", east=east, north=north))
    trend = misfit["systematic"]
    if trend is not None:
        (east, north), (sigma_east, sigma_north) = trend["shift_m"], trend["shift_sigma_m"]
        told.append(
            tell(
                "report.misfit.systematic", east=east, north=north, sigma_east=sigma_east,
                sigma_north=sigma_north, scale=trend["scale_ppm"], rotation=trend["rotation_deg"],
                sigma_scale=trend["scale_sigma_ppm"], sigma_rotation=trend["rotation_sigma_deg"],
                largest=trend["largest_m"], remainder=trend["remainder_m"],
            )
        )  # fmt: skip
    return told
