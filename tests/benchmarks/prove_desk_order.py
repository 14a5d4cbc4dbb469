"""What the order of the queue is worth: a simulated operator with truth, by gain and by residual.

Run: python -m tests.benchmarks.prove_desk_order [blocks]

Blocks with 15 % wrong proposals left in. The operator decides right, one proposal in two seconds,
in the order of the queue: ours (expected gain, sorted anew after each adjustment) or by residual.
An adjustment follows every fifth decision. m_p is that of 400 places on the ground against the
true orientations; the best is that of the block without any wrong proposal. The oracle knows which
proposals are wrong and turns to those first that move the block most: no order can do better.
"""

import sys
from dataclasses import replace

import numpy as np

from core.block.adjusted import AdjustmentOptions, AdjustmentReport
from core.block.adjustment import adjust_block
from core.block.block import Block
from tests.benchmarks.large_desk import LargeBlock, Size, large_block, say
from ui.review.compare import made_with
from ui.review.queue import away_of, queue_rows
from ui.review.state import DeskState, Key

OPTIONS = AdjustmentOptions(estimate_cameras=False, robust=False)
EVERY, SECONDS, CLOSE = 5, 2.0, 1.05
PLACES = 400


def position_error_m(made: LargeBlock, report: AdjustmentReport) -> float:
    """RMS shift on the ground, east and north together, between adjusted and true orientations."""
    rng, squares = np.random.default_rng(5), []
    for name, true in made.true_photos.items():
        pixels = rng.random((PLACES // len(made.true_photos) + 1, 2)) * true.size_px
        heights = np.full(len(pixels), true.ground_height_m)
        camera = made.block.camera_of(name)
        there = report.block.photos[name].object_from_pixel(pixels, heights, camera)
        squares.append((there - true.object_from_pixel(pixels, heights, camera))[:, :2] ** 2)
    return float(np.sqrt(np.vstack(squares).sum(axis=1).mean()))


def without(block: Block, keys: set[Key]) -> Block:
    """The block with some measurements rejected."""
    measured = {
        key: replace(item, status="rejected") if key in keys else item
        for key, item in block.measurements.items()
    }
    return replace(block, measurements=measured)


def decisions_until(made: LargeBlock, order: str, goal_m: float) -> tuple[int, float]:
    """Decisions until m_p is within the goal, and the m_p then."""
    block, seen = made.block, set[Key]()
    report = adjust_block(block, OPTIONS)
    error = position_error_m(made, report)
    while error > goal_m and len(seen) < len(block.measurements):
        for key in first_rows(made, block, report, order, seen)[:EVERY]:
            seen.add(key)
            wrong = key in made.blunders
            status = "rejected" if wrong else "accepted"
            block = block.with_measurement(replace(block.measurements[key], status=status))
        report = adjust_block(block, OPTIONS)
        error = position_error_m(made, report)
    return len(seen), error


def _moves(report: AdjustmentReport, key: Key) -> float:
    """How much a wrong measurement moves the block: its residual times its share in the fit."""
    return float(np.hypot(*report.residuals_px[key])) * (
        1 - report.redundancy_numbers.get(key, 0.8)
    )


def first_rows(
    made: LargeBlock, block: Block, report: AdjustmentReport, order: str, seen: set[Key]
) -> list[Key]:
    """Proposals nobody has looked at, in one of the orders."""
    if order == "oracle":
        left = [key for key in made.blunders if key not in seen]
        left = [key for key in left if block.surveyed[key[0]].role == "control"]
        return sorted(left, key=lambda key: -_moves(report, key))
    if order == "residual":
        lengths = {
            key: float(np.hypot(*report.residuals_px[key]))
            for key, item in block.measurements.items()
            if key not in seen and block.surveyed[key[0]].role == "control" and item.used
        }
        return sorted(lengths, key=lambda key: -lengths[key])
    state = DeskState(block, report, made=made_with(report.block))
    rows = [row for row in queue_rows(state, away_of(state)) if row.key not in seen]
    rows = [row for row in rows if row.role == "control" and row.state == "auto"]
    return [row.key for row in sorted(rows, key=lambda row: -row.gain)]


def main() -> int:
    """A table of six blocks; 1 when our order needs more than half the decisions."""
    blocks = int(sys.argv[1]) if len(sys.argv) > 1 else 6
    say("| block | wrong | m_p at first | best m_p | by gain | by residual | oracle | ratio |")
    say("|---|---|---|---|---|---|---|---|")
    ratios: list[float] = []
    for seed in range(1, blocks + 1):
        made = large_block(Size(3, 4, 420, 500, wrong=0.15, seed=seed))
        first = position_error_m(made, adjust_block(made.block, OPTIONS))
        sound = without(made.block, set(made.blunders))
        best = position_error_m(made, adjust_block(sound, OPTIONS))
        ours, _ = decisions_until(made, "gain", CLOSE * best)
        theirs, _ = decisions_until(made, "residual", CLOSE * best)
        oracle, _ = decisions_until(made, "oracle", CLOSE * best)
        ratios.append(ours / theirs)
        say(
            f"| {seed} | {len(made.blunders)} | {first:.3f} m | {best:.3f} m | "
            f"{ours} ({ours * SECONDS / 60:.1f} min) | {theirs} ({theirs * SECONDS / 60:.1f} min) "
            f"| {oracle} | {ours / theirs:.2f} |"
        )
    say(f"median ratio {np.median(ratios):.2f}, largest {max(ratios):.2f}")
    return 0 if max(ratios) <= 0.5 else 1


if __name__ == "__main__":
    sys.exit(main())
