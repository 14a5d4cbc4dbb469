"""Names of new points by a pattern: `N###` gives N001, N002 and so on."""

import re
from collections.abc import Iterable

DIGITS = re.compile(r"#+")


def next_name(pattern: str, taken: Iterable[str]) -> str:
    """The next name of a pattern: one more than the greatest number that was ever given.

    Args:
        pattern: Text with one run of `#`, which stands for a number of at least so many digits; it
            is added at the end where there is none.
        taken: All names, those of points that were taken back included.
    """
    pattern = pattern if "#" in pattern else f"{pattern}#"
    run = DIGITS.search(pattern)
    assert run is not None
    before, after = pattern[: run.start()], pattern[run.end() :]
    known = re.compile(rf"{re.escape(before)}(\d+){re.escape(after)}")
    numbers = [int(match[1]) for name in taken if (match := known.fullmatch(name))]
    return f"{before}{max(numbers, default=0) + 1:0{len(run[0])}d}{after}"
