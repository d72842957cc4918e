"""A record of work that takes long, to continue from: JSON objects, one a line.

The first, a header, says of what it is and which program did the work. The others are
sealed below it with a key of this user's, so that only what that program wrote counts.
Header and lines are dataclasses; a line has a field `seal`, "" before it is sealed.
"""

import contextlib
import dataclasses
import hmac
import secrets
from pathlib import Path
from typing import Any, TypeVar

from glider.errors import InputError, expect
from glider.files import schema
from glider.paths import cache_folder

MOST_BYTES = 10_000_000
"""Largest record that is read; that of a shipped funnel's proof has 40,000."""

_KEY = 32  # Bytes.

Line = TypeVar("Line")


def read_sealed(
    path: Path, header: Any, kind: type[Line], work: str, subject: str
) -> list[Line]:
    """Returns the lines below the header of a record; starts it where there is none.

    A last line that was cut short is removed.

    Args:
        header: that it must have.
        kind: of its lines.
        work, subject: what it is a record of, for messages: "a proof", of a "funnel".

    Raises:
        InputError: it is not a record of this work.
    """
    if not path.exists():
        _append(path, header)
        return []
    what = f"a record of {work}"
    if not path.is_file() or path.stat().st_size > MOST_BYTES:
        raise InputError(f"{path}: is not {what}; expected a smaller file.")
    text = schema.read_text(path, what)
    whole = text[: text.rfind("\n") + 1]
    lines: list[Any] = []
    for line in whole.splitlines():
        source = f"{path}: line {len(lines) + 1}"
        of = kind if lines else type(header)
        lines.append(schema.convert(schema.parse_json(line, source), of, source))
    if not lines or lines[0] != header:
        raise InputError(
            f"{path}: cannot be resumed: it is of another {subject} or of another "
            "version of this program or its libraries; expected a file that --resume "
            f"wrote for this {subject}, or a new name."
        )
    for number, line in enumerate(lines[1:], start=2):
        seals = line.seal, _seal(header, line)
        if not hmac.compare_digest(*(seal.encode() for seal in seals)):
            raise InputError(
                f"{path}: line {number}: cannot be resumed: it was not written by "
                "--resume with this user's key; expected a new name, to start again."
            )
    if whole != text:
        path.write_text(whole, encoding="utf-8")
    return lines[1:]


def append_sealed(path: Path, header: Any, line: Any) -> None:
    """Appends a line to the record with a header, sealed."""
    _append(path, dataclasses.replace(line, seal=_seal(header, line)))


def _seal(header, line):
    """Returns what only this user can write below a header, in hexadecimal."""
    both = header, dataclasses.replace(line, seal="")
    text = "".join(schema.json_text(one, indent=-1) for one in both)
    return hmac.new(_key(), text.encode(), "sha256").hexdigest()


def _key():
    """Returns this user's key; makes it where there is none."""
    path = cache_folder() / "proof_key"
    with contextlib.suppress(FileExistsError), open(path, "xb", 0) as stream:
        stream.write(secrets.token_bytes(_KEY))
    key = path.read_bytes()
    expect(len(key) == _KEY, f"{path}: the key's length", len(key), f"{_KEY} bytes")
    return key


def _append(path, line):
    try:
        with path.open("a", encoding="utf-8") as stream:
            stream.write(schema.json_text(line, indent=-1) + "\n")
    except OSError as error:
        raise InputError(
            f"{path}: cannot be written ({error.strerror}); expected a file that you "
            "may write."
        ) from None
