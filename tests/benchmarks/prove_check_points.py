"""Independent check points measured at the desk: observed against predicted, and deleted again.

Run: python -m tests.benchmarks.prove_check_points SEED... [--size tiny]

A demo block of each seed. A surveyor's list of forty places drawn over what two photos and more
show, ten as control and thirty as check points, comes in by `gruber import` before the block is
run; the coordinates are off by 5 cm in each axis, as the list states. An operator points at the
true places with an error of 0.3 px in each axis, in every photo in which the desk predicts a point,
by the messages of the pages into the desk's own loop. Printed: RMSE of the check points in plan as
the report has it, what it predicted of that, their ratio and the range in which chance leaves it.
Then the list is taken back, its control points alone come in, and the block is run again: every
orientation and every camera must be the same to the last digit. Ends with 1 where a ratio lies
outside of 0.8 to 1.25 or an orientation is another.
"""

import argparse
import sys
import tempfile
from dataclasses import fields
from pathlib import Path

import numpy as np

from core.adjustment.adjusted import AdjustmentReport
from core.block import Block
from core.quality.check_points import independent_checks
from core.synthetic.archive import make_block
from core.synthetic.options import SyntheticOptions, seeded
from core.synthetic.truth import Truth, read_truth
from sessions.decisions import BringPoints, Withdraw, standing
from sessions.session import Session
from tests.benchmarks.control_blocks import quietly
from tests.benchmarks.loop_hand import LoopHand

CONTROL, CHECK = 10, 30
SIGMA_M = 0.05
POINTING_PX = 0.3
MARGIN_MM = 5.0
"""So far inside the frame a photo must show a point for it to be drawn."""
ASKED = (0.8, 1.25)
ROLES = {
    f"P{number + 1:02d}": "control" if number < CONTROL else "check"
    for number in range(CONTROL + CHECK)
}


def shown(truth: Truth, places: np.ndarray) -> dict[str, np.ndarray]:
    """Film points (n, 2) of places in every photo, millimetres; NaN where it does not show them."""
    half = np.array(truth.camera.frame_mm) / 2 - MARGIN_MM
    found = {}
    for name, exposure in truth.photos.items():
        film = exposure.film(exposure.pixel_from_object(places, truth.camera))
        found[name] = np.where((np.abs(film) < half).all(axis=1, keepdims=True), film, np.nan)
    return found


def hidden_points(truth: Truth, seed: int) -> dict[str, np.ndarray]:
    """True places, evenly over the ground that two photos and more show."""
    rng = seeded(seed, "check points")
    centres = np.array([photo.exterior.centre[:2] for photo in truth.photos.values()])
    reach = np.ptp(centres, axis=0).max()
    low, high = centres.min(axis=0) - reach, centres.max(axis=0) + reach
    plan = rng.uniform(low, high, (100 * len(ROLES), 2))
    places = np.column_stack([plan, np.full(len(plan), np.nan)])
    places[:, 2] = truth.heights_at(places)
    known = places[np.isfinite(places).all(axis=1)]
    photos = np.sum([np.isfinite(f).all(axis=1) for f in shown(truth, known).values()], axis=0)
    return dict(zip(ROLES, known[photos >= 2], strict=False))


def write_list(path: Path, places: dict[str, np.ndarray], seed: int, roles: set[str]) -> None:
    """The surveyor's list: coordinates off by what is stated of them."""
    rng = seeded(seed, "survey")
    lines = ["id,X,Y,Z,sigma_xy,sigma_z,role"]
    for name, place in places.items():
        listed = ",".join(f"{value:.3f}" for value in place + rng.normal(0, SIGMA_M, 3))
        if ROLES[name] in roles:
            lines.append(f"{name},{listed},{SIGMA_M},{SIGMA_M},{ROLES[name]}")
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")


def measure(folder: Path, truth: Truth, places: dict[str, np.ndarray], seed: int) -> LoopHand:
    """Point at every place in every photo that the desk puts into the queue."""
    rng = seeded(seed, "pointing")
    hand = LoopHand(folder, "surveyor")
    waiting = [key for key, state in hand.states().items() if state == "predicted"]
    for key in waiting:
        exposure = truth.photos[key[1]]
        pixel = exposure.pixel_from_object(places[key[0]][None], truth.camera)[0]
        column, row = (pixel + rng.normal(0, POINTING_PX, 2)).tolist()
        if 0 < column < exposure.size_px[0] and 0 < row < exposure.size_px[1]:
            hand.look(key)
            hand.place(key, column, row)
    hand.settle()
    return hand


def delete_checks(folder: Path, control: Path) -> None:
    """Take the list back and bring its control points alone."""
    with Session.open(folder, "surveyor") as session:
        brought = [
            recorded.decision_id
            for recorded in standing(session.decisions())
            if isinstance(recorded.decision, BringPoints)
        ]
        for number in brought:
            session.record(Withdraw(number))
    assert quietly("import", str(folder), "--from", "points", str(control)) == 0


def adjusted(folder: Path) -> AdjustmentReport:
    """The block run with everything that stands in its session."""
    assert quietly("run", str(folder), "--until", "adjustment") in (0, 1)
    with Session.open(folder, "prover") as session:
        report = session.products.latest_value("adjustment")
    assert isinstance(report, AdjustmentReport)
    return report


def differing(one: Block, other: Block) -> int:
    """Photos and cameras of which any number is another."""
    photos = sum(
        not (
            np.array_equal(photo.exterior.centre, other.photos[name].exterior.centre)
            and all(
                getattr(photo.exterior, angle) == getattr(other.photos[name].exterior, angle)
                for angle in ("omega", "phi", "kappa")
            )
            and photo.oriented == other.photos[name].oriented
        )
        for name, photo in one.photos.items()
    )
    return photos + sum(
        repr(getattr(camera, field.name)) != repr(getattr(other.cameras[name], field.name))
        for name, camera in one.cameras.items()
        for field in fields(camera)
    )


def row_of(folder: Path, options: SyntheticOptions) -> tuple[str, float, int]:
    """One block: the row of the table, its ratio and what deleting the check points changed."""
    make_block(folder, options)
    truth, seed = read_truth(folder), options.seed
    places = hidden_points(truth, seed)
    every, control = folder / "all.csv", folder / "control.csv"
    write_list(every, places, seed, {"control", "check"})
    write_list(control, places, seed, {"control"})
    assert quietly("import", str(folder), "--from", "points", str(every)) == 0
    assert quietly("run", str(folder), "--until", "control") in (0, 1)
    hand = measure(folder, truth, places, seed)
    figures, report = independent_checks(hand.report), hand.report
    hand.close()
    rays = sum(check.used_scans for check in report.checks)
    with_checks = adjusted(folder)
    delete_checks(folder, control)
    other = differing(with_checks.block, adjusted(folder).block)
    low, high = figures.ratio_interval
    return (
        f"| {seed} | {figures.count}, {rays} | {report.sigma_nought:.2f} | "
        f"{figures.fit_plan_m:.3f} m | {figures.predicted_m:.3f} m | {figures.ratio:.2f} | "
        f"{low:.2f} to {high:.2f} | {figures.fit_m[2]:.3f} m | {other} of "
        f"{len(report.block.photos)} |",
        figures.ratio,
        other,
    )


def main() -> int:
    """A row for each seed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("seeds", type=int, nargs="+")
    parser.add_argument("--size", choices=("tiny", "small"), default="small")
    given = parser.parse_args()
    sys.stdout.write(
        "| seed | check points, rays | sigma nought | observed in plan | predicted | ratio | "
        "by chance | observed in height | other when deleted |\n" + 9 * "|---" + "|\n"
    )
    failed = False
    for seed in given.seeds:
        with tempfile.TemporaryDirectory() as temporary:
            told, ratio, other = row_of(
                Path(temporary) / "block", SyntheticOptions(given.size, seed=seed)
            )
        sys.stdout.write(told + "\n")
        sys.stdout.flush()
        failed |= not ASKED[0] <= ratio <= ASKED[1] or other > 0
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
