"""Whether a measurement by correlation says itself how well it is known.

Run: python -m tests.benchmarks.prove_peak_sigma [count] [seed]

Random ground of two blurs is shown shifted by a part of a pixel, with noise of three strengths,
white or blurred as film grain is, the same and with a quarter of the ground changed. The error of
the peak of doubled gradient angles is held against what `core.matching.precision` states. The last
row has no noise: its error is that of the paraboloid through the peak.
"""

import sys

import cv2
import numpy as np

from core.matching.operators import doubled_angle_field
from core.matching.peaks import cosine_scores, detect_peaks
from core.matching.precision import place_covariance, sharpness_of

HALF, SIDE, AROUND = 20, 141, 10
CHANGED = 0.7


def say(line: str) -> None:
    """One line at once, also into a pipe."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def blurred_noise(rng: np.random.Generator, blur_px: float) -> np.ndarray:
    """A field of variance one."""
    field = rng.normal(size=(SIDE, SIDE)).astype(np.float32)
    field = cv2.GaussianBlur(field, (0, 0), blur_px) if blur_px else field
    return field / field.std()


def measured(rng: np.random.Generator, blur: float, noise: float, grain: float, change: bool):
    """Error of one peak, and what is stated of it, pixels."""
    ground, shift = blurred_noise(rng, blur), rng.uniform(-0.5, 0.5, 2)
    moved = cv2.warpAffine(
        ground, np.array([[1, 0, shift[0]], [0, 1, shift[1]]]), (SIDE, SIDE), flags=cv2.INTER_CUBIC
    )
    if change:
        moved = np.where(blurred_noise(rng, 12.0) > CHANGED, blurred_noise(rng, blur), moved)
    scan, middle = moved + noise * blurred_noise(rng, grain), SIDE // 2
    inner = slice(middle - HALF, middle + HALF + 1)
    near = slice(middle - HALF - AROUND, middle - HALF + AROUND + 1)
    shown = doubled_angle_field(scan.astype(np.float32))
    template = np.ascontiguousarray(doubled_angle_field(ground)[inner, inner])
    scores = np.ascontiguousarray(cosine_scores(shown, template)[near, near])
    peak = detect_peaks(scores, 1, 3)[0]
    row, column = (round(value) + near.start for value in (peak.row, peak.column))
    sharpness = sharpness_of((template,))
    assert sharpness is not None
    side = 2 * HALF + 1
    stated = place_covariance(sharpness, (shown[row : row + side, column : column + side],))
    return np.array([peak.column, peak.row]) - AROUND - shift, np.sqrt(np.diag(stated))


def main() -> int:
    """One row for each kind of ground and noise."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 60
    rng = np.random.default_rng(int(sys.argv[2]) if len(sys.argv) > 2 else 41)
    say("| blur, noise, grain, changed | error, px | stated, px | stated / error |")
    say("|---|---|---|---|")
    kinds = [
        (blur, noise, grain, change)
        for change in (False, True)
        for blur in (1.2, 2.5)
        for noise in (0.2, 1.0)
        for grain in (0.0, 0.8)
    ]
    for blur, noise, grain, change in [*kinds, (1.2, 0.0, 0.0, False)]:
        rows = [measured(rng, blur, noise, grain, change) for _ in range(count)]
        # A peak elsewhere is no measurement of the place: the judgement of candidates is for those.
        rows = [row for row in rows if np.hypot(*row[0]) < 3]
        error, stated = (
            float(np.sqrt(np.mean(np.square([row[i] for row in rows])))) for i in (0, 1)
        )
        kind = f"{blur}, {noise}, {grain}, {'yes' if change else 'no'}"
        say(f"| {kind} | {error:.3f} | {stated:.3f} | {stated / error:.2f} |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
