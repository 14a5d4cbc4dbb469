"""What a start of the program is told about machine and operator; read once, passed down."""

import getpass
import os
from dataclasses import dataclass, field


def default_workers() -> int:
    """One process for each processor this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def default_operator() -> str:
    """The name the operator is logged in under."""
    try:
        return os.environ.get("USER") or getpass.getuser()
    except (KeyError, OSError):
        # A container may run under a number that has no name.
        return "operator"


@dataclass(frozen=True, slots=True)
class Settings:
    """How this start is to run."""

    workers: int = field(default_factory=default_workers)
    """Processes that work side by side."""
    operator: str = field(default_factory=default_operator)
    """Name under which decisions are recorded."""
    port: int = 8765
    """TCP port of the desk."""
    host: str = "127.0.0.1"
    """Address the desk listens at; this machine only by default."""
