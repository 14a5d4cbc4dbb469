"""Whether a measurement by correlation can say itself how well it is known.

Run: python -m tests.benchmarks.prove_peak_sigma [count] [seed]

Random ground of two blurs is shown shifted by a part of a pixel, with noise of three strengths,
white or blurred as film grain is. A template of 41 pixels is searched, and the error of the peak is
held against two statements: today's (`measure_peak`), and the covariance that follows from the
template's gradients g and the autocorrelation c of what is left at the peak, with a the gain,

    variance = sum over u of c(u) (g * g)(u) / (a sum g^2)^2.
"""

import sys

import cv2
import numpy as np

from core.matching.peaks import detect_peaks
from core.matching.template_search import correlation_scores

HALF, SIDE, REACH = 20, 121, 4


def say(line: str) -> None:
    """One line at once, also into a pipe."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def blurred_noise(rng: np.random.Generator, blur_px: float) -> np.ndarray:
    """A field of variance one."""
    field = rng.normal(size=(SIDE, SIDE)).astype(np.float32)
    field = cv2.GaussianBlur(field, (0, 0), blur_px) if blur_px else field
    return field / field.std()


def autocorrelation(field: np.ndarray) -> np.ndarray:
    """Sums of products of a field with itself at lags up to REACH, negative ones last."""
    padded = [2 * side for side in field.shape]
    return np.fft.irfft2(np.abs(np.fft.rfft2(field, s=padded)) ** 2)


def predicted_sigmas(template: np.ndarray, window: np.ndarray) -> np.ndarray:
    """Standard deviation of column and row of the template's place in a window, pixels."""
    ground, shown = template - template.mean(), window - window.mean()
    gain = float(np.sum(ground * shown) / np.sum(ground**2))
    left = autocorrelation(shown - gain * ground) / template.size
    lags = np.arange(-REACH, REACH + 1)
    near = np.ix_(lags, lags)
    gradients = np.gradient(template)
    return np.array([
        np.sqrt(max(float(np.sum(left[near] * autocorrelation(g)[near])), 0.0))
        / (abs(gain) * float(np.sum(g**2)))
        for g in (gradients[1], gradients[0])
    ])  # fmt: skip


def measured(rng: np.random.Generator, blur: float, noise: float, grain: float):
    """Error of one peak, what is predicted of it, and what is stated today, pixels."""
    ground, shift = blurred_noise(rng, blur), rng.uniform(-0.5, 0.5, 2)
    moved = cv2.warpAffine(
        ground, np.array([[1, 0, shift[0]], [0, 1, shift[1]]]), (SIDE, SIDE), flags=cv2.INTER_CUBIC
    )
    scan, middle = moved + noise * blurred_noise(rng, grain), SIDE // 2
    template = ground[middle - HALF : middle + HALF + 1, middle - HALF : middle + HALF + 1]
    searched = scan[30:-30, 30:-30]
    peak = detect_peaks(correlation_scores(searched, template), 1, 3)[0]
    row, column = round(peak.row), round(peak.column)
    window = searched[row : row + 2 * HALF + 1, column : column + 2 * HALF + 1]
    error = np.array([peak.column, peak.row]) - (middle - HALF - 30) - shift
    return error, predicted_sigmas(template, window), peak.sigma_px


def main() -> int:
    """One row for each kind of ground and noise."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 60
    rng = np.random.default_rng(int(sys.argv[2]) if len(sys.argv) > 2 else 41)
    say("| blur, noise, grain | error, px | predicted, px | predicted / error | stated today, px |")
    say("|---|---|---|---|---|")
    for blur in (1.2, 2.5):
        for noise in (0.2, 0.5, 1.0):
            for grain in (0.0, 0.8):
                rows = [measured(rng, blur, noise, grain) for _ in range(count)]
                error, predicted = (
                    float(np.sqrt(np.mean(np.square([row[i] for row in rows])))) for i in (0, 1)
                )
                today = float(np.median([row[2] for row in rows]))
                say(f"| {blur}, {noise}, {grain} | {error:.3f} | {predicted:.3f} | "
                    f"{predicted / error:.2f} | {today:.3f} |")  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main())
