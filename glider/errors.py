"""The errors that a user of this package can meet and mend."""


class InputError(ValueError):
    """Input that cannot be used; the message is one sentence for the user.

    It names the file, the column or field, what was found and what is needed.
    The command line prints it and exits with code 2.
    """


MISPLACED = (RuntimeError, ValueError, TypeError, AssertionError, AttributeError)
"""What Drake's reader of YAML raises where a file's values are not the schema's."""


def one_line(error: Exception) -> str:
    """Returns the first line of what one of MISPLACED says, for a user."""
    if isinstance(error, (AssertionError, AttributeError)):  # Of no use to a user.
        return "a value, a list or a mapping is where something else is needed"
    return str(error).strip().splitlines()[0]
