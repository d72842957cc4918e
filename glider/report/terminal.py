"""The summary that the command prints: the verdict, the errors and the effects."""

from rich import box
from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from glider.report.error_table import error_rows
from glider.report.numbers import (
    MISSING,
    format_angle,
    format_length,
)
from glider.report.plots.style import LABELS
from glider.report.wording import (
    counted,
    effect_view,
    headline,
    left_words,
    notes_of,
    remarks,
)
from glider.sysid.result import (
    MODELS,
    Result,
)


def print_summary(result: Result, console: Console) -> None:
    """Prints the verdict, the errors before and after and the effects."""

    def say(text: str = "", style: str = "", indent: int = 0) -> None:
        console.print(Padding(Text(_plain(text, console), style), (0, 0, 0, indent)))

    say(headline(result), "bold")
    for remark in remarks(result):
        say(remark)
    say()
    models = [m for m in MODELS if result.errors.get(m) is not None]
    table = Table(
        box=box.SIMPLE_HEAD,
        title=f"Errors on {counted(result.held_out_flights, 'held-out flight')}",
        title_justify="left",
        title_style="bold",
        pad_edge=False,
    )
    table.add_column("")
    for model in models:
        table.add_column(LABELS[model], justify="right", no_wrap=True)
    table.add_column("gain", justify="right", no_wrap=True)
    group = ""
    for row in error_rows(result):
        if row.group != group:
            group = row.group
            table.add_row(Text(group, "bold"))
        cells = [Text(_plain(row.cells[m], console)) for m in models]
        gain = Text(_plain(row.gain, console))
        table.add_row(Text("  " + row.name), *cells, gain)
    console.print(table)

    for effect in (effect_view(e, result) for e in result.effects):
        say(f"{effect['words']} ({effect['kind']})", "bold")
        for name, value in effect["coefficients"]:
            say(f"{name} = {value}", indent=2)
        if effect["more"]:
            say(f"and {effect['more']} more in model.yaml", indent=2)
        say(
            f"evidence {effect['evidence']} nats; explains {effect['share']} of "
            "the error",
            indent=2,
        )
        if effect["confused"]:
            say(f"could be confused with: {'; '.join(effect['confused'])}", indent=2)
        elif not effect["is_unexplained"]:
            say("could be confused with: nothing in the library", indent=2)
        if effect["depends_on"]:
            say(f"varies with: {', '.join(effect['depends_on'])}", indent=2)
        say()
    noise = format_length(result.noise_position_m)
    noise += f", {format_angle(result.noise_pitch_rad)}"
    left = left_words(result)
    say(f"Noise: {noise}. {'' if left in remarks(result) else left}".rstrip())
    for note in notes_of(result):
        say(f"Note: {note}")


def _plain(text: str, console: Console) -> str:
    """Returns the text in ASCII where the console can show no more."""
    if not console.options.ascii_only:
        return text
    table = str.maketrans(
        {"±": "+/-", "×": "x", "²": "^2", "³": "^3", "°": " deg", "σ": "sigma"}
        | {MISSING: "-", "∞": "inf"}
    )
    return text.translate(table).encode("ascii", "replace").decode()
