"""What readings of a mosaic come to: findings beside those of `core.quality.rules`."""

from collections.abc import Iterator

from core.quality.check_points import STANDARD_LEAST
from core.quality.readings import DOUBLED_SHARE, Foretold, ReadingFigures
from core.quality.rules import DOUBTFUL, POOR, SOUND, Finding


def reading_findings(
    found: ReadingFigures, limit_m: float, foretold: Foretold | None = None
) -> Iterator[Finding]:
    """Whether enough was read, how good the mosaic is, and whether that was predicted.

    Args:
        found: The readings of the plan that is read now.
        limit_m: Position error on the ground up to which a block is released, metres.
        foretold: What was predicted; None where that is not known.
    """
    told = {
        "read": str(found.read),
        "planned": str(found.planned),
        "least": str(STANDARD_LEAST),
        "unreadable": str(found.unreadable),
    }
    yield Finding("read" if found.enough else "read-few", int(not found.enough), told)
    if not found.read:
        return
    together = found.together
    low, high = together.m_p_interval
    over = low > limit_m
    values = {
        "value": f"{together.product_m:.2f}",
        "low": f"{low:.2f}",
        "high": f"{high:.2f}",
        "limit": f"{limit_m:.2f}",
    }
    yield Finding("read-over" if over else "read-within", POOR if over else SOUND, values)
    shift = {"east": f"{together.mean_m[0]:+.2f}", "north": f"{together.mean_m[1]:+.2f}"}
    shifted = any(together.shifted)
    yield Finding("read-shifted" if shifted else "read-unshifted", int(shifted), shift)
    least = -(-found.read * int(100 * DOUBLED_SHARE) // 100)
    second = {"doubled": str(found.doubled), "read": str(found.read), "least": str(least)}
    if found.doubled:
        second |= {
            "value": f"{found.observer_m:.2f}",
            "share": f"{100 * found.observer_share:.0f}",
        }
    kind = "second" if found.doubled_enough else "second-few"
    yield Finding(kind if found.doubled else "second-none", int(kind != "second"), second)
    if foretold is not None and foretold.said != "unknown":
        yield _against_prediction(foretold)


def _against_prediction(foretold: Foretold) -> Finding:
    """Predicted against observed, in words."""
    told = {
        "predicted": f"{foretold.predicted_m:.2f}",
        "ratio": f"{foretold.ratio:.2f}",
        "low": f"{foretold.interval[0]:.2f}",
        "high": f"{foretold.interval[1]:.2f}",
    }
    grave = DOUBTFUL if foretold.said == "worse" else SOUND
    return Finding(f"read-{foretold.said}", grave, told)
