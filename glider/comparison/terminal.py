"""A comparison as tables in the terminal."""

from rich.console import Console
from rich.table import Table
from rich.text import Text

from glider.comparison.differences import Comparison
from glider.comparison.wording import error_rows, facts, headline, rows, title
from glider.report.terminal import for_console, make_table, writer


def print_comparison(comparison: Comparison, console: Console) -> None:
    """Prints what changed, the values side by side, and the errors."""
    say = writer(console)
    say(title(comparison))
    say(headline(comparison), "bold")
    for note in comparison.notes:
        say(f"Note: {note}")
    say()
    console.print(_differences(comparison, console))
    for row in rows(comparison):
        if row.note:
            say(f"{row.kind}, {row.name}: {row.note}.")
    say(
        "σ: change divided by its standard error; * marks changes beyond "
        f"{comparison.z_significant:.1f} σ, more than chance explains."
    )
    say()
    console.print(_errors(comparison, console))
    say()
    for name, first, second in facts(comparison):
        say(f"{name}: {first} in A, {second} in B")


def _differences(comparison: Comparison, console: Console) -> Table:
    table = make_table(console, "", "A", "B", "change", "σ", "")
    heading = ""
    for row in rows(comparison):
        if row.kind != heading:
            heading = row.kind
            table.add_row(Text(for_console(heading, console), "bold"))
        unit = f" [{row.unit}]" if row.unit else ""
        cells = (
            f"  {row.name}{unit}",
            row.first,
            row.second,
            row.change.partition(" ±")[0],
            row.z,
            "*" if row.changed else "",
        )
        style = "bold" if row.changed else ""
        table.add_row(*(Text(for_console(c, console), style) for c in cells))
    return table


def _errors(comparison: Comparison, console: Console) -> Table:
    table = make_table(console, "Errors on held-out flights", "", "A", "B", "A over B")
    name = ""
    for row in error_rows(comparison):
        if row.name != name:
            name = row.name
            table.add_row(Text(f"{name}", "bold"))
        cells = (f"  {row.model}", f"[{row.unit}]", row.first, row.second, row.gain)
        table.add_row(*(Text(for_console(c, console)) for c in cells))
    return table
