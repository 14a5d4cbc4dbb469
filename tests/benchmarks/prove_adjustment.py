"""What the adjustment promises, on synthetic blocks whose truth is known.

`python -m tests.benchmarks.prove_adjustment [BLOCKS] [SEED] [--errors]`, from the project's folder;
100 blocks of 6 to 60 photos take some minutes. Blocks are drawn from the seeds SEED + number, and
10,000 more for each further flight. `--errors` judges errors over their sigmas alone. Ends with 1
when a promise is broken.
"""

import sys
from dataclasses import replace
from time import perf_counter

import numpy as np

from core.adjustment.adjusted import AdjustmentOptions, AdjustmentReport
from core.adjustment.block_adjustment import adjust_block, adjust_with_solution
from core.adjustment.equations import Equations
from core.adjustment.influence import Influence
from core.adjustment.solution import Solution
from core.block import Block, TiePoints
from tests.flights import Flight, FlightPlan, fly

PLAIN = AdjustmentOptions(robust=False)
SNOOPING = AdjustmentOptions()
SIZES = ((2, 3), (2, 5), (3, 5), (3, 8), (4, 10), (5, 12))
SEED = 200_000
FLIGHT = 10_000
"""Seeds of one block's flights are so far apart."""
MORE = 5
"""Flights of each block for the errors over their sigmas: those of one block hang together."""
SO_FAR = 20
"""Blocks between two tables: a proof that is stopped has told something."""
PLANTED = 5.0
"""Size of planted errors, in standard deviations of the residual they should show in."""


def plan_of(number: int) -> FlightPlan:
    """One of six sizes in turn."""
    strips, photos = SIZES[number % len(SIZES)]
    count = strips * photos
    return FlightPlan(
        strips=strips,
        photos_per_strip=photos,
        ties=60 * count,
        control=24 + count,
        check=20,
        most_rays=5,
    )


class Tally:
    """Figures of all blocks, and the promises they are held to."""

    def __init__(self) -> None:
        self.figures: dict[str, list[float]] = {}
        self.flights: dict[str, list[tuple[float, int]]] = {}
        self.broken = False

    def add(self, name: str, *values: float) -> None:
        """Figures of one block."""
        self.figures.setdefault(name, []).extend(float(value) for value in values)

    def add_flight(self, name: str, squares: np.ndarray) -> None:
        """Squared errors of one flight, which hang together: its sum and how many."""
        self.flights.setdefault(name, []).append((float(np.sum(squares)), squares.size))

    def variance(self, name: str) -> tuple[float, float]:
        """Mean square over all flights, and its 95 % interval from the flights' own scatter."""
        sums, counts = np.array(self.flights[name]).T
        mean = sums.sum() / counts.sum()
        scatter = np.sum((sums - mean * counts) ** 2) / max(len(sums) - 1, 1) * len(sums)
        return float(mean), float(1.96 * np.sqrt(scatter) / counts.sum())

    def tell_variance(self, what: str, name: str, low: float, high: float) -> None:
        """A variance with its interval; the promise is broken when the interval lies outside."""
        mean, wide = self.variance(name)
        kept = mean - wide <= high and mean + wide >= low
        self.broken |= not kept
        mark = "kept" if kept else "BROKEN"
        found = f"{mean:.3f} ± {wide:.3f}"
        sys.stdout.write(f"| {what} | {found} | {low:g} to {high:g} | {mark} |\n")
        sys.stdout.flush()

    def of(self, name: str) -> np.ndarray:
        """All figures of one name."""
        return np.array(self.figures.get(name, [np.nan]))

    def tell(self, what: str, value: float, low: float, high: float) -> None:
        """One line with its promise."""
        kept = low <= value <= high
        self.broken |= not kept
        mark = "kept" if kept else "BROKEN"
        sys.stdout.write(f"| {what} | {value:.4g} | {low:g} to {high:g} | {mark} |\n")
        sys.stdout.flush()


def main() -> int:
    """Run, print the table, and say whether every promise was kept."""
    words = [word for word in sys.argv[1:] if word != "--errors"]
    count, only_errors = int(words[0]) if words else 100, "--errors" in sys.argv
    seed = int(words[1]) if len(words) > 1 else SEED
    tally, started = Tally(), perf_counter()
    for number in range(count):
        judge_block(tally, number, seed + number, only_errors)
        if (number + 1) % SO_FAR == 0 or number + 1 == count:
            spent = perf_counter() - started
            tell_all(
                tally, f"{number + 1} blocks of 6 to 60 photos from seed {seed}, {spent:.0f} s"
            )
    return int(tally.broken)


def tell_all(tally: Tally, title: str) -> None:
    """The table of all blocks so far; only what it breaks counts."""
    tally.broken = False
    sys.stdout.write(f"\n{title}\n\n| figure | found | promised | |\n|---|---|---|---|\n")
    tell_errors(tally)
    if tally.figures.get("control"):
        tell(tally)


def judge_block(tally: Tally, number: int, seed: int, only_errors: bool) -> None:
    """One block, flown several times for the errors, once for everything else."""
    flight = fly(plan_of(number), np.random.default_rng(seed))
    judge_errors(tally, flight)
    for more in range(1, MORE):
        judge_errors(tally, fly(plan_of(number), np.random.default_rng(seed + FLIGHT * more)))
    if only_errors:
        return
    judge_planted(tally, flight, np.random.default_rng(seed))
    judge_components(tally, number, seed)
    if number % 6 in (0, 1, 2):
        judge_decisions(tally, flight, np.random.default_rng(seed))


def tell_errors(tally: Tally) -> None:
    """Errors against truth."""
    for part in ("orientations, full covariance", "centres", "angles", "tie points", "control"):
        what = f"variance of errors over sigmas, {part}"
        tally.tell_variance(what, part, 0.95, 1.05)
    tally.tell("sigma nought over the noise put in, mean", np.mean(tally.of("sigma")), 0.95, 1.05)
    inside = np.mean(np.abs(tally.of("sigma") - 1) < 0.05)
    tally.tell("blocks with sigma nought within 5 %, share", inside, 0.95, 1)
    for axis in ("plan", "height"):
        ratio = np.sqrt(np.mean(tally.of(f"told {axis}")) / np.mean(tally.of(f"observed {axis}")))
        tally.tell(f"check points, predicted over observed RMSE, {axis}", ratio, 0.8, 1.25)


def tell(tally: Tally) -> None:
    """Gross errors, weights, decisions."""
    for kind in ("control", "tie"):
        tally.tell(f"planted 5 sigma errors found, {kind}", np.mean(tally.of(kind)), 0.95, 1)
    tally.tell("false alarms among good measurements", np.mean(tally.of("alarms")), 0, 0.01)
    for name in ("tie", "control_image", "control_plan", "control_height"):
        tally.tell(
            f"variance component {name}, found over put in",
            np.mean(tally.of(f"vce {name}")),
            0.85,
            1.15,
        )
    for percent in (99, 100):
        share = _high(tally.of("left out"), percent)
        what = f"leave-one-out against adjustment, share of its sigma, {percent} %"
        tally.tell(what, share, 0, 0.02)
    what = "what a measurement says against all others, against adjustment, sigmas, largest"
    tally.tell(what, _high(tally.of("test"), 100), 0, 0.01)


def _high(values: np.ndarray, percent: float) -> float:
    return float(np.percentile(values, percent))


def judge_errors(tally: Tally, flight: Flight) -> None:
    """Errors against truth in their standard deviations, sigma nought, check points."""
    report, solution = adjust_with_solution(flight.block, SNOOPING)
    truth = flight.truth
    whole = whitened(report, solution, truth) ** 2
    tally.add_flight("orientations, full covariance", whole)
    centres, angles, control = [], [], []
    for name, sigmas in report.exterior_sigmas.items():
        ours, true = report.block.photos[name].exterior, truth.photos[name].exterior
        centres.append(((ours.centre - true.centre) / sigmas.centre_m) ** 2)
        off = np.array([ours.omega, ours.phi, ours.kappa]) - [true.omega, true.phi, true.kappa]
        off = np.remainder(off + np.pi, 2 * np.pi) - np.pi
        angles.append((off / sigmas.angles) ** 2)
    seen = np.isfinite(report.tie_positions[:, 0])
    off = (report.tie_positions[seen] - flight.ties[: len(seen)][seen]) / report.tie_sigmas_m[seen]
    tally.add_flight("tie points", off**2)
    for name, position in report.surveyed_positions.items():
        off = (position - truth.surveyed[name].position) / report.surveyed_sigmas_m[name]
        control.append(off**2)
    for part, squares in (("centres", centres), ("angles", angles), ("control", control)):
        tally.add_flight(part, np.array(squares))
    tally.add("sigma", report.sigma_nought)
    for check in report.checks:
        tally.add("observed plan", *check.difference_m[:2] ** 2)
        tally.add("told plan", *check.sigma_m[:2] ** 2)
        if check.used_scans > 1:
            tally.add("observed height", check.difference_m[2] ** 2)
            tally.add("told height", check.sigma_m[2] ** 2)


def whitened(report: AdjustmentReport, solution: Solution, truth: Block) -> np.ndarray:
    """Errors of all orientations turned into independent ones by their full covariance."""
    equations, state = Equations(solution), solution.fit.state
    count = 6 * equations.photos
    covariance = equations.cofactors(np.eye(equations.unknowns)[:count])[:count]
    off = np.zeros((equations.photos, 6))
    for row, photo in enumerate(solution.network.photos):
        true = truth.photos[photo.photo_id].exterior
        turn = state.rotations[row].T @ true.object_from_image
        off[row, :3] = true.centre - state.centres[row]
        off[row, 3:] = [turn[2, 1], turn[0, 2], turn[1, 0]]
    root = np.linalg.cholesky(report.sigma_nought**2 * covariance)
    return np.linalg.solve(root, off.ravel())


def judge_planted(tally: Tally, flight: Flight, rng: np.random.Generator) -> None:
    """Planted errors: one in fifty control measurements and one in a hundred tie rays.

    The size is five standard deviations of the residual it shows in (5 sigma / sqrt r), for an
    error in a coordinate nothing checks cannot be found by anyone; those with r below 0.1 are not
    chosen. A tie point counts as found when one of its rays is left out.
    """
    block = flight.block
    report, solution = adjust_with_solution(block, PLAIN)
    redundancy = 1 - solution.precision.rays
    rays, network = solution.network.rays, solution.network
    control = np.flatnonzero(rays.measurement >= 0)
    ties = np.flatnonzero((rays.measurement < 0) & (redundancy.min(axis=0) > 0.1))
    control = control[redundancy[:, control].min(axis=0) > 0.1]
    chosen = rng.choice(control, max(1, len(control) // 50), replace=False)
    keys = {}
    for ray in chosen:
        item = network.measurements[rays.measurement[ray]]
        size = PLANTED * item.sigma_px / np.sqrt(redundancy[0, ray])
        keys[item.key] = replace(item, column=item.column + size * rng.choice([-1, 1]))
    wrong = rng.choice(ties, max(1, len(ties) // 100), replace=False)
    pixels = block.ties.pixels.copy()
    for ray in wrong:
        size = PLANTED * block.ties.sigma_px[rays.tie[ray]] / np.sqrt(redundancy[0, ray])
        pixels[rays.tie[ray], 0] += size * rng.choice([-1, 1])
    own = block.ties
    spoilt = replace(
        block,
        measurements={**block.measurements, **keys},
        ties=TiePoints(own.photo_ids, own.point, own.photo, pixels, own.sigma_px),
    )
    found = adjust_block(spoilt, SNOOPING)
    tally.add("control", *(key in found.rejected for key in keys))
    points = set(own.point[rays.tie[wrong]].tolist())
    left_out = {int(own.point[ray]) for ray in found.tie_reasons}
    tally.add("tie", *(point in left_out for point in points))
    count_alarms(tally, report, found, keys, points, own)


def count_alarms(
    tally: Tally,
    report: AdjustmentReport,
    found: AdjustmentReport,
    keys: dict,
    points: set[int],
    own: TiePoints,
) -> None:
    """Good measurements that were left out."""
    good = [key for key in report.redundancy_numbers if key not in keys]
    tally.add("alarms", *(key in found.rejected for key in good))
    rays = np.flatnonzero(np.isfinite(report.tie_residuals_px[:, 0]))
    good_rays = [ray for ray in rays.tolist() if int(own.point[ray]) not in points]
    tally.add("alarms", *(ray in found.tie_reasons for ray in good_rays))


def judge_components(tally: Tally, number: int, seed: int) -> None:
    """Noise other than stated: the factors must come back."""
    true = {"tie": 1.6, "control_image": 0.7, "control_plan": 1.5, "control_height": 0.6}
    plan = plan_of(number)
    sigma = np.array(plan.control_sigma_m)
    sigma = sigma * [true["control_plan"]] * np.array([1, 1, 0]) + sigma * np.array(
        [0, 0, true["control_height"]]
    )
    noisy = replace(
        plan,
        control=3 * plan.control,
        tie_sigma_px=plan.tie_sigma_px * true["tie"],
        control_sigma_px=plan.control_sigma_px * true["control_image"],
        control_sigma_m=tuple(sigma.tolist()),
    )
    block = with_sigmas(fly(noisy, np.random.default_rng(seed + FLIGHT * MORE)).block, plan)
    report = adjust_block(block, replace(PLAIN, variance_components=True))
    for name, factor in true.items():
        tally.add(f"vce {name}", (report.classes[name].factor / factor) ** 2)


def with_sigmas(block: Block, plan: FlightPlan) -> Block:
    """The block with the standard deviations of another plan stated."""
    known = np.array(plan.control_sigma_m)
    own = block.ties
    tie_sigma = np.full(len(own.point), plan.tie_sigma_px)
    return replace(
        block,
        ties=TiePoints(own.photo_ids, own.point, own.photo, own.pixels, tie_sigma),
        surveyed={n: replace(p, sigma_m=known) for n, p in block.surveyed.items()},
        measurements={
            key: replace(m, sigma_px=plan.control_sigma_px) for key, m in block.measurements.items()
        },
    )


def judge_decisions(tally: Tally, flight: Flight, rng: np.random.Generator) -> None:
    """Leave-one-out and tests of single measurements against the adjustment made again."""
    block = flight.block
    report, solution = adjust_with_solution(block, PLAIN)
    ahead = Influence(report.block, solution)
    judged = {item.point_id: item for item in ahead.leave_one_out()}
    for name in rng.choice(sorted(judged), 10, replace=False).tolist():
        known, free = block.surveyed[name], np.isfinite(judged[name].difference_m)
        loose = replace(known, sigma_m=np.where(free, 1e7, known.sigma_m))
        again = adjust_block(replace(block, surveyed={**block.surveyed, name: loose}), PLAIN)
        off = again.surveyed_positions[name] - known.position - judged[name].difference_m
        tally.add("left out", (np.abs(off) / judged[name].sigma_m)[free].max())
    told, cost = ahead.reliabilities(), solution.fit.cost()
    for row in rng.choice(len(told), 5, replace=False):
        key = sorted(told)[row]
        out = replace(block.measurements[key], status="rejected")
        _, again = adjust_with_solution(block.with_measurement(out), PLAIN)
        tally.add("test", abs(told[key].test - np.sqrt(max(cost - again.fit.cost(), 0.0))))


if __name__ == "__main__":
    sys.exit(main())
