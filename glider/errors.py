"""Errors that a user of this package can meet and fix."""

import errno
import sys
from collections.abc import Iterator
from typing import TextIO


class InputError(ValueError):
    """Input that cannot be used; the message is one sentence for the user.

    It names the file, the column or field, what was found and what was expected.
    The command line prints it and exits with code 2. Control characters in it, as of
    a file's name, are escaped.
    """

    def __str__(self) -> str:
        """Returns the sentence, safe for a terminal."""
        return printable(super().__str__())


def expect(holds: object, what: str, found: object, expected: str) -> None:
    """Raises InputError "{what} is {found}; expected {expected}." where it is false.

    Args:
        holds: the condition.
        what: was checked, e.g. "field 'mass'".
        found: its value.
        expected: values, in words.
    """
    if not holds:
        raise InputError(f"{what} is {show(found)}; expected {expected}.")


INTERRUPTED = "interrupted: no incomplete output was kept; completed files stay."
"""What is said where somebody stops a program."""

INTERRUPTED_CODE = 130
"""Exit code of a program that was interrupted, as shells have it: 128 + SIGINT."""


def os_error_line(error: OSError) -> str:
    """Returns what went wrong with a file, and with which, in one line."""
    words = (error.strerror or str(error)).rstrip(".")
    if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
        words += "; the disk must have room for it, and what was there before stays"
    return words + "." if error.filename is None else f"{error.filename}: {words}."


def print_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    """Prints a warning in one line; for `warnings.showwarning` of a program."""
    print(f"warning: {message}", file=file or sys.stderr)


def printable(text: object) -> str:
    r"""Returns a text without control characters, which a file may hold: as \x1b."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in str(text))


def show(value: object, width: int = 80) -> str:
    """Returns what was found, for a message, cut off after `width` characters.

    Numbers are as people write them, NumPy's too: 0.63, [-0.45, 0.95].
    """
    text = ""
    for piece in _pieces(value):
        text += piece
        if len(text) > width:
            return text[:width] + "..."
    return text


def _pieces(value: object) -> Iterator[str]:
    """Yields a value's text bit by bit: aliases of YAML can make it endless."""
    to_list = getattr(value, "tolist", None)  # NumPy's arrays and numbers.
    if callable(to_list):
        value = to_list()
    if isinstance(value, float):
        yield repr(float(f"{value:.6g}"))
    elif isinstance(value, dict):
        yield "{"
        for i, (name, field) in enumerate(value.items()):
            yield f"{', ' if i else ''}{name}: "
            yield from _pieces(field)
        yield "}"
    elif isinstance(value, (list, tuple)):
        yield "["
        for i, item in enumerate(value):
            yield ", " if i else ""
            yield from _pieces(item)
        yield "]"
    else:
        yield repr(value)
