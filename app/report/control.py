"""What the report counts of control: by status, and by the reference it comes from."""

from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np

from core.adjustment.adjusted import AdjustmentReport
from core.block import USED
from core.matching.reference import ReferenceLayer
from core.quality.controllability import unchecked_control


def control_counts(report: AdjustmentReport) -> dict[str, Any]:
    """Measurements by status, and every one that was not used with its reason."""
    block = report.block
    final = {key: report.final_status(m) for key, m in block.measurements.items()}
    control = [key for key in final if block.surveyed[key[0]].role == "control"]
    used = [key for key in control if final[key][0] in USED]
    return {
        "points_used": len({point for point, _ in used}),
        "by_status": dict(Counter(final[key][0] for key in control)),
        "unchecked": [
            {"point_id": point, "scan": scan} for point, scan in unchecked_control(report)
        ],
        "left_out": [
            {
                "point_id": point,
                "scan": scan,
                "status": final[point, scan][0],
                "reason": final[point, scan][1],
                "residual_px": list(report.residuals_px.get((point, scan), (np.nan, np.nan))),
            }
            for point, scan in sorted(control)
            if final[point, scan][0] not in USED
        ],
    }


def shift_figures(reference: str, report: AdjustmentReport) -> dict[str, float]:
    """Where the middle of a reference's points lies (E, N) against the block; empty for none."""
    found = {one.name: one for one in report.parameters if one.owner == reference}
    told = {axis: found.get(f"shift_{axis}_m") for axis in "EN"}
    values = {axis: one.value for axis, one in told.items() if one is not None}
    return values | {f"sigma_{axis}": one.sigma for axis, one in told.items() if one}


def reference_figures(
    tied_to: Mapping[ReferenceLayer, int], report: AdjustmentReport
) -> list[dict[str, Any]]:
    """What photos are tied to, where that is more than one ortho, and how far each lies off.

    `shift` is empty for `[reference]` itself.
    """
    return [
        {
            "name": one.name,
            "points": points,
            "ortho_sigma_m": one.ortho_sigma_m,
            "shift": shift_figures(one.name, report),
        }
        for one, points in tied_to.items()
        if one.ortho
    ]
