"""`--axis` of every verb: a file that describes an axis, or the name of a stored one."""

from pathlib import Path

from app.commands.frame import Frame
from sim.description.axis import Axis
from sim.description.axis_document import read_axis

METAVAR = "AXIS"
MEANT = "description of the axis: a file such as axis.toml, or the name of a stored one"
NAMED = "name of the axis as the service knows it, or a file such as axis.toml with that name"


def axis_of(frame: Frame, given: str) -> Axis:
    """Return the axis that a file describes, or the stored one of this name.

    Raises:
        NotFoundError: if it is neither; says which are stored.
    """
    described = _in_file(given)
    if described is not None:
        return described
    from casebase.axes import find_axis, unknown_axis
    from casebase.errors import NotFoundError

    with frame.library() as library, library.reading() as session:
        row = find_axis(session, given)
        if row is None:
            raise NotFoundError(f"--axis: there is no file {given}, and {unknown_axis(session, given)}")
        return read_axis(row.document)


def axis_name(given: str | None) -> str | None:
    """Return the name by which a service knows an axis: that in the file, or what was given."""
    described = _in_file(given) if given else None
    return given if described is None else described.name


def _in_file(given: str) -> Axis | None:
    path = Path(given)
    return read_axis(path) if path.exists() and not path.is_dir() else None
