"""`[adjustment]` of `block.toml`: what is estimated, with which weights and tests."""

from typing import Any, Literal, cast

from app.block_toml import Document, Table, Unit
from core.adjustment.adjusted import AdjustmentOptions
from core.geometry.camera import SETS

DEFAULT = AdjustmentOptions()
SHIFTS = ("none", "block", "strip")
OWNERS = ("camera", "photo")
NETWORKS = ("control", "free")
TESTS = ("w", "tau", "none")
SMALL_MM = Unit("millimetres", 0.0001, 10, (("micrometres", 0.001),))
"""Priors of camera constants."""
SMALL_UM = Unit("micrometres", 0.1, 10_000, (("millimetres", 1000),))
"""Priors of distortion."""
DEM_M = Unit("metres", 0.0, 1000)
"""Nought leaves the terrain out."""
RISK = Unit("a probability", 1e-6, 0.1)
KEYS = (
    "cameras",
    "sigma_principal_distance_mm",
    "sigma_principal_point_mm",
    "sigma_distortion_um",
    "self_calibration",
    "self_calibration_per",
    "sigma_additional_um",
    "only_significant",
    "gnss_shift",
    "gnss_drift",
    "imu_misalignment",
    "dem_sigma_m",
    "network",
    "variance_components",
    "gross_errors",
    "risk",
    "compare_methods",
)


def adjustment_options(document: Document) -> AdjustmentOptions:
    """The options of `[adjustment]`, every key with its default."""
    table = document.table("adjustment", keys=KEYS)
    test = table.choice("gross_errors", TESTS, "w")
    return AdjustmentOptions(
        estimate_cameras=table.flag("cameras", True),
        sigma_principal_distance_mm=table.number(
            "sigma_principal_distance_mm", SMALL_MM, DEFAULT.sigma_principal_distance_mm
        ),
        sigma_principal_point_mm=table.number(
            "sigma_principal_point_mm", SMALL_MM, DEFAULT.sigma_principal_point_mm
        ),
        sigma_distortion_um=table.number(
            "sigma_distortion_um", SMALL_UM, DEFAULT.sigma_distortion_um
        ),
        robust=test != "none",
        self_calibration=_sets(table),
        per_photo=table.choice("self_calibration_per", OWNERS, "camera") == "photo",
        sigma_additional_um=table.number(
            "sigma_additional_um", SMALL_UM, DEFAULT.sigma_additional_um
        ),
        only_significant=table.flag("only_significant", True),
        gnss_shift=cast(
            "Literal['none', 'block', 'strip']", table.choice("gnss_shift", SHIFTS, "none")
        ),
        gnss_drift=table.flag("gnss_drift", False),
        misalignment=table.flag("imu_misalignment", False),
        dem_sigma_m=table.number("dem_sigma_m", DEM_M, 0.0),
        free_network=table.choice("network", NETWORKS, "control") == "free",
        variance_components=table.flag("variance_components", False),
        test="tau" if test == "tau" else "w",
        risk=table.number("risk", RISK, DEFAULT.risk),
        compare_methods=table.flag("compare_methods", False),
    )


def _sets(table: Table) -> tuple[str, ...]:
    """Names of sets of additional parameters, each once."""
    key = "self_calibration"
    given: Any = table.values.get(key, [])
    names = [given] if isinstance(given, str) else given
    known = f"Write a list of {', '.join(SETS)}; [] for none."
    if not isinstance(names, list):
        raise table.error(key, f"must be a list of sets, not {given!r}.", known)
    for name in cast("list[Any]", names):
        if name not in SETS:
            raise table.error(key, f"{name!r} is no set of parameters.", known)
    found = tuple(dict.fromkeys(cast("list[str]", names)))
    wide = [name for name in found if name in ("ebner12", "gruen44")]
    if len(wide) == 2 or (wide and "affinity" in found):
        cause = f"{', '.join(found)} hold the same terms more than once."
        remedy = (
            "ebner12 and gruen44 contain the affinity, and gruen44 what ebner12 does: take one."
        )
        raise table.error(key, cause, remedy)
    return found
