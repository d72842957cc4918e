"""A lock on a folder that one process at a time writes to."""

import fcntl
import os
from pathlib import Path

from glider.errors import InputError


class FolderLock:
    """Holds a folder until it is closed, or the process ends, however that happens.

    Args:
        file: made to hold the lock; it stays, empty.
        folder: that it is for.
        holder: who else may have it, for the message.

    Raises:
        InputError: another process, or another lock of this one, holds the folder.
    """

    def __init__(self, file: Path, folder: Path, holder: str) -> None:
        self._file: int | None = os.open(file, os.O_WRONLY | os.O_CREAT, 0o644)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self.close()
            raise InputError(
                f"{folder}: another {holder} writes to it; expected a folder that "
                "none has open."
            ) from None

    def close(self) -> None:
        """Lets another have the folder."""
        if self._file is not None:
            os.close(self._file)
        self._file = None
