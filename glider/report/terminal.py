"""The summary that the command prints: verdict, effects, errors, warnings."""

from rich import box
from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from glider.report.error_table import columns_of, error_rows
from glider.report.numbers import MISSING, format_angle, format_length
from glider.report.plots.style import LABELS
from glider.report.tables import vehicle_rows
from glider.report.wording import (
    air_words,
    counted,
    differences,
    effect_view,
    headline,
    notes_of,
    remarks,
    set_aside_words,
)
from glider.sysid.result import Result

_MOST_SET_ASIDE = 5
"""Further ones are in the report."""


def print_summary(result: Result, console: Console) -> None:
    """Prints the verdict, the effects, the errors before and after, the warnings."""

    def say(text: str = "", style: str = "", indent: int = 0) -> None:
        console.print(
            Padding(Text(for_console(text, console), style), (0, 0, 0, indent))
        )

    say(headline(result), "bold")
    for sentence in (result.reason, *remarks(result)):
        say(sentence)
    say()
    for effect in result.effects:
        _say_effect(effect_view(effect, result), say)
    for sentence in (*differences(result), air_words(result)):
        if sentence:
            say(sentence[0].upper() + sentence[1:].rstrip(".") + ".")
    for name, value in vehicle_rows(result):
        say(f"Vehicle: {name} = {value}")
    say()
    console.print(_errors_table(result, console))
    say()
    noise = format_length(result.noise.position_m)
    say(f"Noise: {noise}, {format_angle(result.noise.pitch_rad)}.")
    for warning in result.warnings:
        say(f"Warning: {warning}")
    for rows in result.set_aside[:_MOST_SET_ASIDE]:
        say(f"Excluded: {set_aside_words(rows)}")
    more = len(result.set_aside) - _MOST_SET_ASIDE
    if more > 0:
        say(f"Excluded: {more} more, see report.html.")
    for note in notes_of(result):
        say(f"Note: {note}")


def _say_effect(effect, say):
    say(f"{effect['words']} ({effect['kind']})", "bold")
    for name, value in effect["coefficients"]:
        say(f"{name} = {value}", indent=2)
    if effect["more"]:
        say(f"and {effect['more']} more in model.yaml", indent=2)
    for name, spread in effect["spread"]:
        say(f"{name} varies from flight to flight by {spread}", indent=2)
    say(
        f"evidence {effect['evidence']} nats; chosen in {effect['inclusion']} of "
        f"resampled sets of flights; {effect['share']} of all evidence",
        indent=2,
    )
    if not effect["shape_fits"]:
        say("shape not the library's", indent=2)
    if effect["confused"]:
        say(f"indistinguishable from: {'; '.join(effect['confused'])}", indent=2)
    elif not effect["is_unexplained"]:
        say("indistinguishable from: nothing in the library", indent=2)
    if effect["depends_on"]:
        say(f"varies with: {', '.join(effect['depends_on'])}", indent=2)
    say()


def _errors_table(result: Result, console: Console) -> Table:
    models = columns_of(result)
    table = Table(
        box=box.SIMPLE_HEAD,
        title=f"Errors on {counted(result.flights.held_out, 'held-out flight')}",
        title_justify="left",
        title_style="bold",
        show_edge=False,
        padding=(0, 0, 0, 1),  # All models fit into 80 columns.
        pad_edge=False,
    )
    table.add_column("")
    for heading in (*(LABELS[m] for m in models), "noise", "gain"):
        table.add_column(heading, justify="right", no_wrap=True)
    group = ""
    for row in error_rows(result):
        if row.group != group:
            group = row.group
            table.add_row(Text(group, "bold"))
        cells = [*(row.cells[m] for m in models), row.noise, row.gain]
        table.add_row(
            Text(for_console(f"  {row.name} [{row.unit}]", console)),
            *(Text(for_console(cell, console)) for cell in cells),
        )
    return table


def for_console(text: str, console: Console) -> str:
    """Returns a text in ASCII where the console can show no more."""
    if not console.options.ascii_only:
        return text
    table = str.maketrans(
        {"±": "+/-", "×": "x", "²": "^2", "³": "^3", "°": " deg", "σ": "sigma"}
        | {MISSING: "-", "∞": "inf"}
    )
    text = text.replace("[°]", "[deg]").translate(table)
    return text.encode("ascii", "replace").decode()
