"""A sample of a block's map sheets, by which all of them are accepted or rejected."""

import secrets
from collections.abc import Iterator

from app.project import Project
from app.sheets import gone_sheets
from core.errors import ProjectError
from core.quality.job_rules import JobRules
from core.said import say
from core.sheets.acceptance import bad_sheets
from sessions.checks import version_on_disk
from sessions.decisions import DrawSheets
from sessions.session import Session
from sessions.sheet_samples import LARGEST_SEED, new_sample, sheets_on_disk


def draw_sample(project: Project, session: Session, seed: int | None = None) -> DrawSheets:
    """Draw sheets of the block, as many as the limits of its job ask for; nothing is recorded.

    Args:
        project: The block.
        session: Its session; it is only read.
        seed: What they are drawn with; nobody knows it beforehand when None.

    Raises:
        ProjectError: No map sheets were cut, or one of their files is gone.
    """
    sheets = sheets_on_disk(session.products, version_on_disk(session.products))
    if not sheets:
        raise ProjectError(
            project.file,
            "has no map sheets yet of which a sample could be drawn.",
            say(
                "Name them in block.toml, [sheets], and run it: gruber run {folder}",
                folder=project.folder,
            ),
        )
    if gone := gone_sheets(session):
        raise ProjectError(
            gone[0],
            say("is gone; files of map sheets that are missing: {count}.", count=len(gone)),
            say("Cut them again: gruber run {folder}", folder=project.folder),
        )
    chosen = secrets.randbelow(LARGEST_SEED) if seed is None else seed
    return new_sample(sheets, chosen, project.rules)


def told_lines(sample: DrawSheets, rules: JobRules) -> Iterator[str]:
    """What came of a sample, a sentence each, and the names of its sheets."""
    plan = sample.plan
    good, bad = bad_sheets(plan.lot, rules)
    yield say(
        "{count:# sheet|# sheets} drawn of {lot}, seed {seed}, digest {digest}; up to {accepted} "
        "may be bad.",
        count=plan.sample,
        lot=plan.lot,
        seed=sample.seed,
        digest=sample.digest,
        accepted=plan.accepted,
    )
    yield say(
        "With {good:# bad sheet|# bad sheets} the lot is rejected {producer:.1f} times in 100, "
        "with {bad} it is accepted {consumer:.1f} times.",
        good=good,
        bad=bad,
        producer=100 * (1 - plan.acceptance(good)),
        consumer=100 * plan.acceptance(bad),
    )
    yield ", ".join(one.name for one in sample.sheets)
    yield "Judge them at the desk, under Block quality."
