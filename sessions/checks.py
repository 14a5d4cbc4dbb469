"""Plans of checks and their readings, as they stand in the session."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import cast

from core.block import Photo
from core.geometry.camera import Camera
from core.mosaic.composition import MosaicProduct
from core.quality.check_plan import CheckPlace
from core.quality.readings import Reading, ReadingFigures, reading_figures
from sessions.decisions import PlanChecks, ReadCheck, Recorded, standing
from sessions.products import Products, digest_of

DIGEST_SIGNS = 16
"""So much of a digest tells plans apart."""


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
    number = 1 + sum(isinstance(item.decision, PlanChecks) for item in decisions)
    named = tuple(replace(place, place_id=f"{number}-{place.place_id}") for place in places)
    plan = PlanChecks(named, cells, seed, source, beforehand, "")
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
    sigmas = {place.place_id: place.sigma_m for place in plan.plan.places}
    said = [
        (who, one)
        for (place_id, who), (_, one) in readings_of(decisions).items()
        if place_id in sigmas and one.version == version
    ]
    readings = [
        Reading(one.place_id, who, difference_m(one), sigmas[one.place_id])
        for who, one in said
        if one.mosaic is not None and one.reference is not None
    ]
    read = {one.place_id for one in readings}
    tried = {one.place_id for _, one in said}
    return reading_figures(readings, len(sigmas), len(tried - read))


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
    """What the mosaic on disk was made of; empty where there is none.

    It is the same as long as its photos, its seams and its pixels lie where they did.
    """
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
