"""What an effect does to a flight, and the residual that it leaves, as in a report."""

import dataclasses
from collections.abc import Iterator

import matplotlib
import numpy as np
from figure_file import to_png
from matplotlib.figure import Figure as Picture
from side_view import draw_glider

from glider.campaign.logs import Campaign, Flight
from glider.campaign.motion_capture import MotionCapture
from glider.campaign.turning import signs_of, turn_campaign
from glider.physics.effects import LIBRARY, Coefficient, Effect, EffectKind
from glider.physics.model import GliderModel
from glider.report.model_figures import RESIDUALS, residual_panel
from glider.report.plots.figure import Figure
from glider.report.plots.style import COLORS, STYLE
from glider.simulation.campaigns import CampaignPlan
from glider.sysid.replay.log_space import LIBRARY_SPACE, vector_of
from glider.sysid.replay.record import Noise, Record, measure_noise, prepare
from glider.sysid.replay.replayed import make_table
from glider.sysid.result import ResidualTable

FLIGHTS = CampaignPlan(flights=8)
"""Flights of each picture."""

SHOWN = CampaignPlan(
    flights=1, capture=MotionCapture(position=0.0, pitch=0.0, elevator=0.0)
)
"""The flight that a picture shows, without noise."""

INSTANTS = 7
"""Poses that are drawn of it."""

VISIBLE = 0.15
"""Largest distance between two flights that is seen without magnification [m]."""

MOST_TURN = 0.5
"""Largest difference of pitch that is drawn magnified [rad]."""

HIDDEN = 0.1
"""Share of the RMS of the noise below which a contribution is not visible."""

CLEAR = 0.25
"""Share of its own RMS that the mean of a contribution must reach to have a sign."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Signature:
    """The residual that an effect leaves in flights.

    Attributes:
        effect: of the glider that flew.
        without: residual of the model that lacks it.
        known: residual of the model that has it.
        flights: one launch and its commands, of the glider without and with it.
    """

    effect: Effect
    without: ResidualTable
    known: ResidualTable
    flights: tuple[Flight, Flight]

    @property
    def variable(self) -> str:
        """Name of the variable that the picture is drawn over."""
        there = [v for v in self.effect.kind.depends_on if v in self.without.variables]
        return there[0]

    def direction(self, column: int) -> str:
        """Sign of the contribution to a residual: "+", "−", "±" or "0"."""
        added = self.without.residual[:, column] - self.known.residual[:, column]
        rms = np.sqrt(np.mean(added**2))
        if rms < HIDDEN * np.sqrt(np.mean(self.known.residual[:, column] ** 2)):
            return "0"
        mean = np.mean(added)
        return "±" if abs(mean) < CLEAR * rms else "+" if mean > 0.0 else "−"

    @property
    def magnification(self) -> int:
        """Factor of the drawn difference between the flights: 1, 2, 5, 10, ..."""
        without, known = (flight.pose for flight in self.flights)
        apart = np.abs(known - without)
        distance = np.hypot(apart[:, 0], apart[:, 1]).max()
        turn = apart[:, 2].max()
        if distance == 0.0:
            return 1
        most = min(VISIBLE / distance, MOST_TURN / max(turn, 1e-9))
        steps = [digit * 10**power for power in range(4) for digit in (1, 2, 5)]
        return max([step for step in steps if step <= max(1.0, most)])


def typical(kind: EffectKind) -> Effect:
    """Returns an effect at its typical size, with its default shape."""
    if kind.stage == "log":
        return kind(pitch=-1.0)
    sizes = sizes_of(kind)
    return kind(**{c.name: c.default + c.scale for c in sizes})


def sizes_of(kind: EffectKind) -> tuple[Coefficient, ...]:
    """Returns the coefficients that set the size of an effect, not its shape."""
    sizes = tuple(c for c in kind.coefficients if not c.is_shape)
    return sizes or kind.coefficients


def signatures() -> Iterator[Signature]:
    """Flies a glider with each effect and evaluates the logs as a report does."""
    noise = measure_noise(_flown(GliderModel()))
    for kind in LIBRARY:
        effect = typical(kind)
        truth = GliderModel(effects=(effect,))
        logged = _flown(truth)
        records = _records(logged, noise)
        without = _table(records, GliderModel())
        if kind.stage == "log":  # It is undone before a model sees it.
            records = _records(turn_campaign(logged, signs_of(truth)), noise)
        known = _table(records, truth)
        flights = _shown(GliderModel()), _shown(truth)
        yield Signature(effect=effect, without=without, known=known, flights=flights)


def _flown(truth: GliderModel) -> Campaign:
    return FLIGHTS.simulate(truth, np.random.default_rng(0))


def _shown(truth: GliderModel) -> Flight:
    [flight] = SHOWN.simulate(truth, np.random.default_rng(0)).flights
    return flight


def _records(campaign: Campaign, noise: Noise) -> list[Record]:
    return prepare(campaign.flights, campaign, noise, LIBRARY_SPACE)


def _table(records: list[Record], model: GliderModel) -> ResidualTable:
    return make_table(records, vector_of(model), [0.0] * len(records))


def draw(signature: Signature) -> bytes:
    """Draws the three residuals over the variable that they vary with most, as PNG."""
    tables = {"nominal": signature.without, "corrected": signature.known}
    figure = Figure(
        keys={key: key for key in tables},
        panels=[
            residual_panel(tables, signature.variable, column)
            for column in range(len(RESIDUALS))
        ],
    )
    return to_png(figure, dpi=100)


def draw_flights(signature: Signature) -> Picture:
    """Draws both flights from the side, their differences magnified."""
    poses = []
    for flight in signature.flights:
        assert flight.elevator is not None
        poses.append(np.column_stack([flight.pose, flight.elevator]))
    without, known = poses
    known = without + signature.magnification * (known - without)
    rows = np.linspace(0, len(without) - 1, INSTANTS).astype(int)
    parameters = GliderModel().parameters
    with matplotlib.rc_context(STYLE):
        picture = Picture(figsize=(10.0, 2.6), layout="constrained")
        ax = picture.subplots()
        for track, key in ((without, "nominal"), (known, "corrected")):
            color = COLORS[key]
            ax.plot(*track[:, :2].T, color=color, lw=0.8)
            for pose in track[rows]:
                draw_glider(ax, parameters, pose, color=color, alpha=0.85)
        ax.set_aspect("equal", adjustable="datalim")
        ax.set(xlabel="x [m]", ylabel="z [m]")
    return picture
