"""Data that cannot be used: one message that names the file, the cause and the remedy."""

from pathlib import Path

from core.said import Said, say


def _made_of(kind: "type[PhotogrammetryError]", told: str) -> "PhotogrammetryError":
    return kind.__new__(kind, told)


class PhotogrammetryError(Exception):
    """Data we cannot use, told in one sentence each: where, why, and what to do.

    Attributes:
        file: The file (or file and key) at fault.
        cause: What is wrong with it.
        remedy: What the operator can do about it.
        told: All of it.
    """

    def __init__(self, file: str | Path, cause: str, remedy: str, /, **values: object) -> None:
        """What is told; `values` stand in the places of cause and remedy."""
        self.file = str(file)
        self.cause = Said(cause, values) if values else cause
        self.remedy = Said(remedy, values) if values else remedy
        self.told = say(
            "{file}: {cause} {remedy}", file=self.file, cause=self.cause, remedy=self.remedy
        )
        super().__init__(self.told)

    def __reduce__(self) -> tuple[object, ...]:
        """Copied and pickled as it is, whatever the makers of its kind take."""
        return _made_of, (type(self), self.told), self.__dict__


class ProjectError(PhotogrammetryError):
    """`block.toml` holds something that cannot be used."""


class ScanError(PhotogrammetryError):
    """A scan that cannot be read or does not fit its camera."""


class ReferenceDataError(PhotogrammetryError):
    """Ortho, DEM or roads that cannot be used."""


class CrsError(PhotogrammetryError):
    """A coordinate reference system that is missing, wrong, or does not fit the coordinates."""


class OrientationError(PhotogrammetryError):
    """A block that cannot be oriented with what is there."""


class ExchangeError(PhotogrammetryError):
    """A file of another program that cannot be read, or a block that its format cannot hold."""


class StorageError(PhotogrammetryError):
    """A disk that is full or may not be written."""


class Cancelled(Exception):
    """The operator asked a long step to stop."""
