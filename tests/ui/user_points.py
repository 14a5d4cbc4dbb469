"""Points of the user on the tiny block: on a list, measured by nobody, their true places known."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from app.desk.inputs import Adjusting, DeskInputs
from core.block import Block, Measurement, SurveyedPoint
from sessions.checks import results_digest
from tests.ui.desk_block import CAMERA, OPTIONS, adjust, desk_inputs, tiny_block, true_photos
from tests.ui.desk_landscape import EXTENT_M, NORTH, WEST
from ui.review.compare import drawn_from_block, made_with
from ui.review.rows import NO_ROWS
from ui.review.snapshot import DeskSnapshot
from ui.review.state import DeskState
from ui.review.to_measure import with_predictions

SIGMA_M = np.array([0.1, 0.1, 0.15])
COUNT = 5


@cache
def true_places() -> dict[str, np.ndarray]:
    """Where the points really are: on crossings of lanes, which scans show well."""
    land = tiny_block().land
    nodes = land.nodes.reshape(-1, 2)
    middle = np.array([WEST + EXTENT_M[0] / 2, NORTH - EXTENT_M[1] / 2])
    plane = nodes[np.argsort(np.linalg.norm(nodes - middle, axis=1))[: 3 * COUNT : 3]]
    heights = land.dem.heights(plane)
    return {f"T{n + 1}": np.array([*plane[n], heights[n]]) for n in range(COUNT)}


def true_pixel(key: tuple[str, str], scan_px: int = 1200) -> np.ndarray:
    """Where a photo really shows a point."""
    photo = true_photos(scan_px, tiny_block().land.dem)[key[1]]
    return photo.pixel_from_object(true_places()[key[0]][None], CAMERA)[0]


@cache
def listed_block() -> Block:
    """The tiny block with the user's list; the last point is a check point."""
    rng = np.random.default_rng(29)
    block = tiny_block().block
    listed = {
        name: SurveyedPoint(
            name, place + rng.normal(size=3) * SIGMA_M, SIGMA_M,
            "check" if name == f"T{COUNT}" else "control", "surveyed",
        )
        for name, place in true_places().items()
    }  # fmt: skip
    return replace(block, surveyed={**block.surveyed, **listed})


@cache
def adjusted():
    """Its adjustment, which knows nothing of the list."""
    return adjust(listed_block())


@cache
def measuring_snapshot() -> DeskSnapshot:
    """The desk over the listed block, before anybody sat down."""
    block, report = listed_block(), adjusted()
    evidence = Adjusting(OPTIONS).evidence(report)
    state = DeskState(block, report, made=made_with(report.block), evidence=evidence)
    dem = tiny_block().land.dem
    state = with_predictions(state, dem)
    drawn = drawn_from_block(state.oriented)
    return DeskSnapshot(block, state, dem, drawn, table=NO_ROWS.renewed(state))


class Proposing:
    """In the place of what compares scans: the true places, a fifth of a pixel beside."""

    def proposals(self, block, errors, point_id, measured):
        if not measured:
            return []
        done = {item.photo_id for item in measured}
        true = listed_at(measured[0])
        return [self._at(true, point_id, photo) for photo in block.photos if photo not in done]

    def refined(self, block, errors, place, measured):
        return self._at(listed_at(measured[0]), place.point_id, place.photo_id)

    def _at(self, true, point_id, photo_id):
        column, row = (float(value) for value in true_pixel((true, photo_id)))
        return Measurement(point_id, photo_id, column + 0.2, row, 0.25, 0.94, "dubious", "likely")


def listed_at(measured: Measurement) -> str:
    """The listed point that somebody pointed at: a new point may lie there as well."""
    photo_id = measured.photo_id
    return min(true_places(), key=lambda name: distance(measured, true_pixel((name, photo_id))))


def distance(measured: Measurement, pixel: np.ndarray) -> float:
    """Between a measurement and a place of its scan, pixels."""
    return float(np.hypot(measured.column - pixel[0], measured.row - pixel[1]))


def measuring_inputs(folder: Path, **changes) -> DeskInputs:
    """Everything a desk over the listed block needs."""
    inputs = desk_inputs(folder, **{"transfer": Proposing(), **changes})
    report = adjusted()
    evidence = Adjusting(OPTIONS).evidence
    return replace(
        inputs,
        block=listed_block(),
        report=report,
        written_of=results_digest(report),
        evidence=evidence,
    )
