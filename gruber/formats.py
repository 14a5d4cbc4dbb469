"""Read files of other programs into one value, and write it, without a block."""

from pathlib import Path

from app.exchange import format_named
from core.formats.exchange import ExchangeBlock, read_format


def read(path: str | Path, form: str) -> ExchangeBlock:
    """What a file or folder of another program holds.

    Args:
        path: The file or folder.
        form: Name of the format, as `gruber import --from` takes it.

    Raises:
        PhotogrammetryError: It cannot be read; the message names file, cause and remedy.
        ValueError: There is no such format.
    """
    return read_format(format_named(form, reads=True), Path(path))


def write(block: ExchangeBlock, path: str | Path, form: str) -> tuple[str, ...]:
    """Write such a value in the format of another program.

    Args:
        block: What is to be written.
        path: File or folder; a folder is made.
        form: Name of the format, as `gruber export --to` takes it.

    Returns:
        What the format could not hold, a sentence each.

    Raises:
        ValueError: There is no such format.
    """
    chosen = format_named(form, reads=False)
    assert chosen.write is not None
    target = Path(path)
    (target if chosen.folder else target.parent).mkdir(parents=True, exist_ok=True)
    return chosen.write(target, block)
