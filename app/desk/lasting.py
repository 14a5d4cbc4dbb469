"""The desk's secret, which outlives the program."""

import os
import secrets
from pathlib import Path


def lasting_token(hidden: Path) -> str:
    """The desk's secret, kept for its owner only, so that pages find a desk opened again."""
    path = hidden / "desk-token"
    try:
        kept = path.read_text(encoding="ascii").strip()
        if len(kept) >= 32:
            return kept
        path.unlink()
    except (FileNotFoundError, UnicodeDecodeError):
        path.unlink(missing_ok=True)
    token = secrets.token_urlsafe(24)
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "w", encoding="ascii") as file:
        file.write(token)
    return token
