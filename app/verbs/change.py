"""What has changed between the years of several blocks over one place."""

import argparse
import time

from app.change import CHANGE, compare_years, dated_blocks, told_lines
from app.terminal import Voice, interruptible


def change(given: argparse.Namespace, voice: Voice) -> None:
    """Compare each year with the one before it, and say what has changed."""
    began, title = time.monotonic(), "Change between the years"
    blocks = dated_blocks(given.blocks)
    with interruptible() as interruption:
        progress = interruption.watching(voice.stage("change", title))
        pairs = compare_years(blocks, given.out, progress)
    voice.ended("change", title, time.monotonic() - began, str(given.out / CHANGE))
    for pair in pairs:
        for line in told_lines(pair):
            voice.say(line)
    voice.figures("change", {"pairs": [pair.figures for pair in pairs]})
