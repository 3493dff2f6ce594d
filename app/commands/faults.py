"""Which errors the command line turns into a sentence, and with which exit code it ends."""

from fastapi_problem.error import StatusProblem
from pydantic import ValidationError
from sqlalchemy.exc import OperationalError

from app.commands import BAD_INPUT, FAILURE
from app.jobs.job import JobError, JobFailedError
from app.recordings.microphone import MicrophoneError
from app.recordings.remote import RemoteError, UnreachableError
from casebase.errors import DamagedError, LibraryError
from casebase.store.integrity import RESTORE, is_damaged
from signals.errors import DecoderUnavailableError, NoPlainFileError, SignalError
from sim.errors import RunError, SimulationError

CODES: dict[type[Exception], int] = {
    StatusProblem: BAD_INPUT,
    ValidationError: BAD_INPUT,
    LibraryError: BAD_INPUT,
    DamagedError: FAILURE,
    MicrophoneError: FAILURE,
    RemoteError: BAD_INPUT,
    UnreachableError: FAILURE,
    JobError: BAD_INPUT,
    JobFailedError: FAILURE,
    DecoderUnavailableError: FAILURE,
    SignalError: BAD_INPUT,
    RunError: FAILURE,
    SimulationError: BAD_INPUT,
    FileNotFoundError: BAD_INPUT,
    FileExistsError: BAD_INPUT,
    NoPlainFileError: BAD_INPUT,
    OSError: FAILURE,
    OperationalError: FAILURE,
}


def exit_code(error: Exception) -> int | None:
    """Return the exit code of an expected error, or None for a fault of the program."""
    if is_damaged(error):
        return FAILURE
    return next((CODES[cls] for cls in type(error).__mro__ if cls in CODES), None)


def sentence(error: Exception) -> str:
    """Return what was wrong and what would be right."""
    if isinstance(error, StatusProblem):
        return error.detail or error.title
    if isinstance(error, ValidationError):
        return "; ".join(f"{'.'.join(map(str, each['loc']))}: {each['msg']}" for each in error.errors())
    if is_damaged(error):
        return f"the database is damaged. {RESTORE}"
    if isinstance(error, OperationalError):
        return f"the database does not answer: {error.orig}"
    if isinstance(error, FileNotFoundError) and error.filename is not None:
        return f"{error.filename}: no such file"
    return str(error)
