"""Progress of work that takes its time: a line of text, and the share that is done."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TypeVar

T = TypeVar("T")

Progress = Callable[[str], None]
"""Takes a line of text as the work goes on; a `Step` where the share is known."""


def silent(text: str) -> None:
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


class Stages:
    """Announces stages whose usual shares of the time are known, in their order."""

    def __init__(self, progress: Progress, shares: Mapping[str, float]) -> None:
        """Announces to `progress`; the shares sum to one."""
        self._progress, self._shares, self._done = progress, shares, 0.0

    def enter(self, name: str, words: str = "") -> None:
        """Begins a stage, or, at the share that it has reached, one again."""
        names = list(self._shares)
        before = sum(self._shares[n] for n in names[: names.index(name)])
        self._done = max(self._done, before)
        self(words or name)

    def __call__(self, text: str) -> None:
        """Announces a step of the stage."""
        self._progress(Step(text, self._done))
