"""Lesson 8: a funnel, certified for the Taylor polynomials of the closed loop.

The article's section "A note on funnels", which stops before one: its figure is from
Moore's thesis. The cost-to-go of lesson 6 is a Lyapunov candidate about the plan,

    V(t, x̃) = x̃ᵀ S(t) x̃,   F(t) = {x̃: V(t, x̃) <= ρ(t)},

and F is a funnel if V̇ <= ρ̇ wherever V = ρ: no flight crosses its boundary. For the
closed loop's Taylor polynomials in x̃ that holds at a time if, with a multiplier L(x̃),

    ρ̇ - V̇ - L (ρ - V)   is a sum of squares in x̃, as in lesson 7.

`glider.funnels` alternates between multipliers, ρ and the shape, with the servo's
limits inside, and lets the funnel end within reach of the wire. From here on S is
divided by ρ, so that F = {V <= 1}. Then the certificate is checked in exact arithmetic,
and flights of the full dynamics from the boundary try to leave. A funnel that accounts
for what the polynomials leave out (`FunnelSettings(remainder=1.1)`) is proven in
continuous time by `glider check-funnel FILE --prove`.

    python examples/article/funnel.py --figure funnel.png
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from course import (
    SHOWN,
    compare,
    draw_wire,
    legend_beside,
    picture,
    read_options,
    start,
)
from diagrams import plot_tube
from glider import GliderModel, PerchingProblem, funnels, plan, tracking_policy
from glider.report.plots.style import BLUE

ARTICLE = {
    "A certified funnel around a perch": "figure (Moore's thesis)",
    "Certificate of the polynomials, in exact arithmetic": "-",
    "Half-width at the launch: height alone": "-",
    "Half-width at the launch: pitch alone": "-",
    "Half-width at the launch: speed alone": "-",
    "Flights from the boundary that leave": "-",
}

SAMPLES = 2000
"""Flights from the boundary, at several times."""

SHOWN_FLIGHTS = 40


def main(arguments: Sequence[str] | None = None) -> dict[str, str]:
    """Makes a funnel, checks it and tries to leave it."""
    path = read_options(__doc__, arguments)
    rng = np.random.default_rng(0)
    model, problem = GliderModel(), PerchingProblem()
    policy = tracking_policy(model, plan(model, problem))
    funnel = funnels.make_funnel(model, policy, funnels.FunnelSettings())
    verdict = funnels.check_funnel(funnel)
    levels = funnels.falsify_funnel(funnel, SAMPLES, rng)
    escapes = np.count_nonzero(levels > funnels.ESCAPE_LEVEL)

    times = funnel.nominal.times
    widths = funnel.half_widths(times)
    _, z, pitch, _, speed, *_ = widths[0]
    if path:
        inside = funnels.fly_inside(funnel, SHOWN_FLIGHTS, rng)
        draw(path, funnel, inside)
    return compare(
        ARTICLE,
        SHOWN,
        "holds" if verdict.holds else "does not hold",
        f"{100 * z:.1f} cm",
        f"{np.degrees(pitch):.1f}°",
        f"{speed:.2f} m/s",
        f"{escapes} of {len(levels)}",
    )


def draw(path: Path, funnel: funnels.Funnel, flights: np.ndarray) -> None:
    """Draws the tube with flights inside, and how wide it is over time."""
    times = funnel.nominal.times
    widths = funnel.half_widths(times)
    shown = (
        ("height z [m]", widths[:, 1]),
        ("pitch [°]", np.degrees(widths[:, 2])),
        ("speed xdot [m/s]", widths[:, 4]),
    )
    with picture(path, 9.0, 5.6) as figure:
        tube, *panels = figure.subplot_mosaic("AAA;BCD", height_ratios=[3, 2]).values()
        # The projection of {x̃ᵀ S x̃ <= 1} into the plane is the ellipse of S⁻¹ there.
        plot_tube(tube, funnel)
        for k, flight in enumerate(flights):
            label = f"{len(flights)} flights" if k == 0 else None
            tube.plot(*flight[:, :2].T, color="k", lw=0.4, alpha=0.5, label=label)
        draw_wire(tube)
        legend_beside(tube)
        for ax, (name, width) in zip(panels, shown, strict=True):
            ax.plot(times, width, color=BLUE)
            ax.set(xlabel="time [s]", ylabel=f"± {name} alone")
            ax.set_ylim(bottom=0.0)


if __name__ == "__main__":
    start(main)
