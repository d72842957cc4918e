"""Progress of work that takes its time: a line of text, and the share that is done."""

from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

T = TypeVar("T")

Progress = Callable[[str], None]
"""Takes a line of text as the work goes on; a `Step` where the share is known."""

Shares = Callable[[float], None]
"""Takes the share of the work that is done, from 0 to 1."""


def silent(word: object) -> None:
    """Takes word of progress and drops it."""


class Step(str):
    """What is being done, and the share of the work that was done before it."""

    share: float

    def __new__(cls, text: str, share: float) -> "Step":
        """A line of text with a share from 0 to 1."""
        step = super().__new__(cls, text)
        step.share = share
        return step


def announced(items: Sequence[T], words: str, progress: Progress) -> Iterator[T]:
    """Yields items, and announces each with the share of those before it."""
    for number, item in enumerate(items):
        progress(Step(f"{words} {item}", number / len(items)))
        yield item
