"""What the commands print: results on standard output, progress on a terminal.

The doctor prints where rich is not installed: it is imported by what uses it.
"""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from glider.progress import Progress, Step

if TYPE_CHECKING:
    from rich.console import Console


def line_width() -> int:
    """Width by COLUMNS or of the terminal [columns]; without, a sentence is a line."""
    return shutil.get_terminal_size((100_000, 24)).columns


@contextmanager
def output() -> Iterator["Console"]:
    """A console whose lines go to standard output, without blanks at their ends."""
    from rich.console import Console

    console = Console(width=line_width(), height=24)
    with console.capture() as printed:
        yield console
    for line in printed.get().splitlines():
        print(line.rstrip())


@contextmanager
def working(
    words: str = "starting ...", *, is_even: bool = False
) -> Iterator[Progress]:
    """Shows on a terminal what is being done, the share that is done, and the time.

    Args:
        words: shown first.
        is_even: equal shares take equal times, so that the rest can be estimated.
    """
    from rich import progress
    from rich.console import Console
    from rich.table import Column

    console = Console(stderr=True)
    with progress.Progress(
        progress.SpinnerColumn(),
        progress.BarColumn(20),
        progress.TaskProgressColumn(),
        progress.TimeRemainingColumn() if is_even else progress.TimeElapsedColumn(),
        progress.TextColumn(
            "{task.description}",
            markup=False,
            table_column=Column(ratio=1, no_wrap=True),
        ),
        console=console,
        expand=True,
        disable=not console.is_interactive,
        transient=True,
    ) as bar:
        task = bar.add_task(words, total=None)

        def follow(text: str) -> None:
            bar.update(task, description=f"{text} ...")
            if isinstance(text, Step):
                if text.share < bar.tasks[0].completed:
                    bar.reset(task)  # Other work begins.
                bar.update(task, completed=text.share, total=1.0)

        yield follow
