"""Files of an installation: of the user who runs it, and of nobody else."""

from contextlib import suppress
from pathlib import Path


def make_private(folder: Path) -> None:
    """Take from others what an unpacked backup has let them read.

    The folder keeps them out; its databases are closed as well, since they are copied about.
    """
    with suppress(PermissionError):  # of another owner, who has to see to it
        folder.chmod(0o700)
        for path in folder.glob("*"):
            if path.is_file() and not path.is_symlink():
                path.chmod(0o600)
