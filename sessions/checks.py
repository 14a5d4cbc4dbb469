"""Plans of checks, their readings, and who has vouched for the block, as they stand now."""

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import cast

import numpy as np

from core.adjustment.adjusted import AdjustmentReport
from core.block import Photo
from core.geometry.camera import Camera
from core.mosaic.composition import MosaicProduct
from core.quality.check_plan import CheckPlace
from core.quality.job_rules import USUAL_RULES, JobRules
from core.quality.judged_rules import RULES
from core.quality.readings import Reading, ReadingFigures, reading_figures
from core.sheets.map_sheets import MapSheet
from sessions.decisions import (
    PlanChecks,
    ReadCheck,
    Recorded,
    SignBlock,
    Withdraw,
    changing,
    standing,
)
from sessions.products import DIGEST_SIGNS, Products, digest_of
from sessions.remarks import is_of_a_fault
from sessions.sheet_samples import lot_digest, standing_samples, words_of_sheets

WRITTEN = "mosaic-file"
"""Product that keeps where the mosaic was written, and the stamp of the file."""
# design: both ends of a file, in which its tables and its last tiles lie.
STAMPED_BYTES = 1 << 16
VERSION = "mosaic-version"
"""Product that keeps the version of the mosaic with the same digest."""


@dataclass(frozen=True, slots=True)
class StandingPlan:
    """A plan that stands."""

    recorded: Recorded
    """When, by whom, and what it was recorded as."""
    plan: PlanChecks
    """The plan."""

    @property
    def unchanged(self) -> bool:
        """Whether the places are those that the digest was made of."""
        return digest_of_plan(self.plan) == self.plan.digest


PARTS = ("decisions", "adjustment", "mosaic", "readings", "rules", "sheets")
"""What a signature is about; of sheets only where a sample of them was drawn."""
PLACE_DIGITS, ANGLE_DIGITS, SIGMA_DIGITS = 4, 9, 6
"""An adjustment that is the same to a tenth of a millimetre is the same."""


@dataclass(frozen=True, slots=True)
class StandingSignature:
    """A signature that stands, and what has changed since."""

    recorded: Recorded
    """When and by whom."""
    said: SignBlock
    """The verdict."""
    changed: tuple[str, ...]
    """Parts that are no longer as they were judged; none: it holds."""

    @property
    def holds(self) -> bool:
        """Whether everything is as it was judged."""
        return not self.changed

    @property
    def digest(self) -> str:
        """One digest of all that was judged, to print beside the name."""
        return digest_of("judged", sorted(self.said.judged.items()))[:DIGEST_SIGNS]


def new_plan(
    places: Sequence[CheckPlace],
    cells: tuple[int, int],
    seed: int,
    source: str,
    *,
    beforehand: bool,
    decisions: Sequence[Recorded],
) -> PlanChecks:
    """A plan whose places bear its number, which no earlier plan of the session has.

    Args:
        places: What was drawn or listed.
        cells: Columns and rows of the grid; (0, 0) for a list.
        seed: What they were drawn with.
        source: Name of the list; empty without one.
        beforehand: Whether no control had been searched.
        decisions: Everything recorded, withdrawn plans included.
    """
    plan = PlanChecks(tuple(places), cells, seed, source, beforehand, "")
    return _numbered(plan, 1 + len(_all_plans(decisions)))


def with_free_number(plan: PlanChecks, decisions: Sequence[Recorded]) -> PlanChecks:
    """A plan under the next number where another was recorded under its own since it was drawn."""
    earlier = _all_plans(decisions)
    taken = {place.place_id for one in earlier for place in one.places}
    if taken.isdisjoint(place.place_id for place in plan.places):
        return plan
    places = tuple(
        replace(
            place,
            place_id=place.place_id.partition("-")[2],
            after=place.after.partition("-")[2],
        )
        for place in plan.places
    )
    return _numbered(replace(plan, places=places), 1 + len(earlier))


def _all_plans(decisions: Sequence[Recorded]) -> list[PlanChecks]:
    """Every plan of a session, withdrawn ones included."""
    return [item.decision for item in decisions if isinstance(item.decision, PlanChecks)]


def _numbered(plan: PlanChecks, number: int) -> PlanChecks:
    """A plan whose places bear its number, and its digest."""
    named = tuple(
        replace(
            place,
            place_id=f"{number}-{place.place_id}",
            after=place.after and f"{number}-{place.after}",
        )
        for place in plan.places
    )
    plan = replace(plan, places=named)
    return replace(plan, digest=digest_of_plan(plan))


def digest_of_plan(plan: PlanChecks) -> str:
    """Digest of all that a plan says."""
    said = plan.places, plan.cells, plan.seed, plan.source, plan.beforehand
    return digest_of("check plan", *said)[:DIGEST_SIGNS]


def standing_plans(decisions: Sequence[Recorded]) -> tuple[StandingPlan, ...]:
    """Every plan that stands, in the order they were made; the last one is read now."""
    return tuple(
        StandingPlan(item, item.decision)
        for item in standing(decisions)
        if isinstance(item.decision, PlanChecks)
    )


def readings_of(
    decisions: Sequence[Recorded],
) -> Mapping[tuple[str, str], tuple[Recorded, ReadCheck]]:
    """The newest reading of every place by every observer, by (place, observer)."""
    return {
        (item.decision.place_id, item.who): (item, item.decision)
        for item in standing(decisions)
        if isinstance(item.decision, ReadCheck)
    }


def checked_figures(
    decisions: Sequence[Recorded], plan: StandingPlan, version: str
) -> ReadingFigures:
    """What the readings of one plan say of a mosaic; readings of another mosaic do not count.

    Args:
        decisions: Everything recorded.
        plan: The plan.
        version: Of the mosaic.
    """
    readings = plan_readings(decisions, plan, version)
    names = {place.place_id for place in plan.plan.places}
    tried = {
        place_id
        for (place_id, _), (_, one) in readings_of(decisions).items()
        if place_id in names and one.version == version
    }
    read = {one.place_id for one in readings}
    return reading_figures(readings, plan.plan.count, len(tried - read))


def plan_readings(
    decisions: Sequence[Recorded], plan: StandingPlan, version: str
) -> tuple[Reading, ...]:
    """What observers read at the places of one plan, in one version of the mosaic."""
    sigmas = {place.place_id: place.sigma_m for place in plan.plan.places}
    return tuple(
        Reading(one.place_id, who, difference_m(one), sigmas[one.place_id])
        for (place_id, who), (_, one) in readings_of(decisions).items()
        if place_id in sigmas
        and one.version == version
        and one.mosaic is not None
        and one.reference is not None
    )


def replaced_readings(decisions: Sequence[Recorded], version: str) -> tuple[ReadingFigures, ...]:
    """What was read in a mosaic for plans that a newer one took the place of."""
    earlier = [checked_figures(decisions, plan, version) for plan in standing_plans(decisions)[:-1]]
    return tuple(figures for figures in earlier if figures.read)


def outdated_readings(decisions: Sequence[Recorded], plan: StandingPlan, version: str) -> int:
    """How many readings of a plan are of another mosaic than the one on disk."""
    places = {place.place_id for place in plan.plan.places}
    return sum(
        place_id in places and one.version != version
        for (place_id, _), (_, one) in readings_of(decisions).items()
    )


def difference_m(one: ReadCheck) -> tuple[float, float]:
    """Product minus reference of one reading, easting and northing, metres."""
    assert one.mosaic is not None
    assert one.reference is not None
    return one.mosaic[0] - one.reference[0], one.mosaic[1] - one.reference[1]


def version_on_disk(products: Products) -> str:
    """What the mosaic on disk was made of; empty where there is none, or no longer that one.

    It is the same as long as its photos, its seams and its pixels lie where they did.
    """
    written = cast("tuple[Path, str] | None", products.latest_value(WRITTEN))
    if written is not None and _stamp_of(written[0]) != written[1]:
        return ""
    kept: str | None = products.load_value(VERSION, products.latest_digest("mosaic"))
    return _version_of_orthos(products) if kept is None else kept


def keep_written(products: Products, file: Path) -> None:
    """Keep what the mosaic that was just made is, and looks like on disk, to know it again."""
    stamp = _stamp_of(file)
    products.save_value(WRITTEN, digest_of(stamp), (file, stamp))
    keep_version(products)


def _stamp_of(file: Path) -> str:
    """What a file holds, by its size, beginning and end, whatever its time; empty without one."""
    try:
        with file.open("rb") as opened:
            size = opened.seek(0, os.SEEK_END)
            opened.seek(0)
            begins = opened.read(STAMPED_BYTES)
            opened.seek(max(0, size - STAMPED_BYTES))
            return hashlib.sha256(b"%d " % size + begins + opened.read()).hexdigest()
    except FileNotFoundError:
        return ""


def keep_version(products: Products) -> None:
    """Keep the version of the mosaic on disk, before any of its orthos is made again."""
    digest = products.latest_digest("mosaic")
    if digest and products.load_value(VERSION, digest) is None:
        products.save_value(VERSION, digest, _version_of_orthos(products))


def _version_of_orthos(products: Products) -> str:
    """The version of a mosaic whose orthos are still those on disk."""
    product = cast("MosaicProduct | None", products.latest_value("mosaic"))
    if product is None:
        return ""
    lying: list[object] = []
    for name in sorted({seam.photo_id for seam in product.seams}):
        made = cast("tuple[Photo, Camera] | None", products.latest_value(f"made-with/{name}"))
        if made is not None:
            photo, camera = made
            matrix = photo.interior.film_from_pixel_matrix
            lying.append((name, photo.exterior, matrix, camera, photo.mask))
    areas = [(seam.photo_id, seam.area) for seam in product.seams]
    return digest_of("mosaic", product.grid, areas, lying)[:DIGEST_SIGNS]


def judged_parts(
    decisions: Sequence[Recorded],
    report: AdjustmentReport,
    mosaic: str,
    rules: JobRules = USUAL_RULES,
    sheets: Sequence[MapSheet] = (),
) -> Mapping[str, str]:
    """Digest of each part that a signature is about, as it is now.

    Args:
        decisions: Everything recorded.
        report: The adjustment.
        mosaic: Version of the mosaic; empty where there is none.
        rules: Limits of the job.
        sheets: Map sheets of the block.
    """
    made = standing(changing(decisions))
    block = [item for item in made if not isinstance(item.decision, Withdraw)]
    readings = [
        item
        for item in standing(decisions)
        if isinstance(item.decision, PlanChecks | ReadCheck) or is_of_a_fault(item.decision)
    ]
    drawn = standing_samples(decisions)
    lot = lot_digest(sheets)
    of_sheets = (lot, drawn, sorted(words_of_sheets(decisions, lot).items())) if drawn else None
    values = block, _orientation_of(report), mosaic, readings, (RULES, rules), of_sheets
    return {
        name: digest_of(name, value)[:DIGEST_SIGNS]
        for name, value in zip(PARTS, values, strict=True)
        if value is not None
    }


def standing_signatures(
    decisions: Sequence[Recorded], now: Mapping[str, str]
) -> tuple[StandingSignature, ...]:
    """The newest signature of every reviewer, the newest first.

    Args:
        decisions: Everything recorded.
        now: `judged_parts` as they are now.
    """
    newest = {
        item.who: (item, item.decision)
        for item in standing(decisions)
        if isinstance(item.decision, SignBlock)
    }
    found = [
        StandingSignature(item, said, tuple(p for p in PARTS if said.judged.get(p) != now.get(p)))
        for item, said in newest.values()
    ]
    return tuple(sorted(found, key=lambda one: -one.recorded.decision_id))


@lru_cache(maxsize=1)
def results_digest(report: AdjustmentReport) -> str:
    """Digest of what tables and report tell of an adjustment, check points among it.

    It depends on what the adjustment was made of: nothing that came of it changes alone.
    """
    block = report.block
    measured = [
        (
            *(*key, item.column, item.row, item.sigma_px, item.status, item.reason, item.seen),
            [(one.operator, one.column, one.row) for one in item.readings],
        )
        for key, item in sorted(block.measurements.items())
    ]
    points = [
        (*point.position, *point.sigma_m, name, point.role, point.description, point.sketch)
        for name, point in sorted(block.surveyed.items())
    ]
    # One text: the codec is made for what is read again, and ten times as slow.
    return digest_of("results", json.dumps([report.sigma_nought, measured, points]))


def _orientation_of(report: AdjustmentReport) -> list[object]:
    """What of an adjustment its orthos follow from."""
    photos = [
        (
            name,
            photo.oriented,
            np.round(photo.exterior.centre, PLACE_DIGITS),
            [
                round(angle, ANGLE_DIGITS)
                for angle in (photo.exterior.omega, photo.exterior.phi, photo.exterior.kappa)
            ],
        )
        for name, photo in sorted(report.block.photos.items())
    ]
    sigma = report.sigma_nought
    return [photos, round(sigma, SIGMA_DIGITS) if np.isfinite(sigma) else None]
