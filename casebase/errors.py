"""What can go wrong in the library, each with what would be right."""


class LibraryError(Exception):
    """Any refusal by the library; its text says what was wrong and what would be right."""


class NotFoundError(LibraryError):
    """Nothing has this id."""


class ConflictError(LibraryError):
    """Somebody changed it in between, or its state does not allow the change."""


class StaleVersionError(ConflictError):
    """The version (ETag) that the change was based on is not the current one."""


class DuplicateError(ConflictError):
    """The sound is a case already, with another label or gearbox; the attributes tell which case."""

    def __init__(self, message: str, *, case_id: str, label: str, gearbox: str | None) -> None:
        super().__init__(message)
        self.case_id, self.label, self.gearbox = case_id, label, gearbox


class ErasedError(LibraryError):
    """The audio was erased; only what was taken from it is left."""


class DamagedError(LibraryError):
    """What is stored is not what was stored: a disk, or somebody beside us, has changed it."""


class SchemaError(LibraryError):
    """The tables of the database are those of another version."""


class BusyError(LibraryError):
    """So many write that this one would wait too long."""


class InvalidRequestError(LibraryError, ValueError):
    """The request contradicts itself or the library's rules."""


class InvalidCursorError(InvalidRequestError):
    """The cursor of a page was not made by this library."""


class BundleError(InvalidRequestError):
    """A case bundle (ZIP) that is not to be trusted or does not hold what it declares."""


class BackupError(LibraryError):
    """A backup that is incomplete or differs from its checksums."""


class ArtifactError(LibraryError):
    """Learned weights or calibration that do not fit this library."""


class LeaseLostError(LibraryError):
    """The worker's lease has ended, so that what it did is not written."""
