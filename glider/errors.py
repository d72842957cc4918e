"""The errors that a user of this package can meet and mend."""


class InputError(ValueError):
    """Input that cannot be used; the message is one sentence for the user.

    It names the file, the column or field, what was found and what is needed.
    The command line prints it and exits with code 2.
    """


def os_error_line(error: OSError) -> str:
    """Returns what went wrong with a file, and with which, in one line."""
    if error.filename is None:
        return str(error)
    return f"{error.filename}: {error.strerror}."
