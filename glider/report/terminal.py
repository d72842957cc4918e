"""The summary that the command prints: verdict, effects, errors, warnings."""

from collections.abc import Callable
from typing import Any

from rich import box
from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from glider.report import wording
from glider.report.error_table import columns_of, error_rows
from glider.sysid.result import Result

_Writer = Callable[..., None]


def writer(console: Console) -> _Writer:
    """A function that prints a text, which is no markup."""

    def write(text: str = "", style: str = "", indent: int = 0) -> None:
        console.print(Padding(Text(text, style), (0, 0, 0, indent)))

    return write


def print_summary(result: Result, console: Console) -> None:
    """Prints the verdict, the effects, the errors before and after, the warnings."""
    write = writer(console)
    write(wording.headline(result), "bold")
    for sentence in (result.reason, *wording.say("remarks", result)):
        write(sentence)
    write()
    for effect in result.effects:
        name, *lines = wording.say("effect", result, effect)
        write(name, "bold")
        for line in lines:
            write(line, indent=2)
        write()
    for name in ("differences", "air", "flown"):
        for sentence in wording.say(name, result):
            write(sentence[0].upper() + sentence[1:].rstrip(".") + ".")
    for sentence in wording.say("vehicle", result):
        write(sentence)
    write()
    console.print(_errors_table(result))
    write()
    for sentence in wording.say("footnotes", result):
        write(sentence)


def make_table(*headings: str, **style: Any) -> Table:
    """An empty table that all models of a report fit into, in 80 columns."""
    table = Table(
        box=box.SIMPLE_HEAD,
        show_edge=False,
        padding=(0, 0, 0, 1),
        pad_edge=False,
        **style,
    )
    for i, heading in enumerate(headings):
        table.add_column(heading, justify="right" if i else "left", no_wrap=bool(i))
    return table


def _errors_table(result: Result) -> Table:
    models = columns_of(result)
    flights = wording.counted(result.flights.predicted, "held-out flight")
    table = make_table(
        *("", *models, "floor", "gain"),
        title=f"Errors on {flights}",
        title_justify="left",
        title_style="bold",
    )
    group = ""
    for row in error_rows(result):
        if row.group != group:
            group = row.group
            table.add_row(Text(group, "bold"))
        cells = [*(row.cells[m] for m in models), row.floor, row.gain]
        table.add_row(Text(f"  {row.name} [{row.unit}]"), *cells)
    return table
