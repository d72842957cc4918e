"""The numbers that steer the analysis of a campaign, each with its reason and source.

Sources are "derived" from a stated probability or error, "measured" by the benchmark
that is named, or "convention" for a size that was chosen and never calibrated. What is
physics, or only the step of a numerical derivative, stands where it is used.

Read them as `constants.NAME`: a benchmark may then change one for all modules.
"""

# ----------------------------------------------------------------- the verdict

UNLIKELY = 0.005
"""Probability, by chance, below which errors are not those of a perfect model, or gusts
not turbulence. Derived: one of 200 campaigns without a fault is claimed to have one."""

MOMENT_SHARE = 0.2
"""Unmodelled pitch acceleration over the RMS pitch acceleration above which the model
does not explain it. Measured (bench_broken): at most 0.04 in campaigns with the right
answer, 0.2 to 1 where elevator and pose are of different flights or clocks."""

NEAR_CEILING = 0.97
"""Share of its ceiling above which a scale is at it. Convention: a fit stops there."""

GAIN_ERROR = 0.03
"""Share by which the elevator may move more or less than commanded. Measured, with lag
and delay fitted: 0.003 at most in 60 campaigns, servos of other forms than the
library's among them; 0.04 and 0.05 where one clock is 5 % slow (bench_broken)."""

GAIN_Z = 4.0
"""Standard errors over flights above which that share is significant. Derived: of
normal errors one in 16,000 is as large."""

TRAVEL_WINDOW = 0.1  # Time over which an elevator's travel counts [s]. Convention.
LEAST_TRAVEL = 0.1
"""Sum of squared travels above which a flight determines a gain [rad²]. Convention."""

SHIFTED = 0.015
"""Shift of a servo's log above which its clock is in doubt [s]. Derived: three standard
errors of a clock that an import finds."""

TRAVEL_ERROR = 0.1
"""Share by which an elevator may turn farther than its log says. Convention."""

MOST_LOST = 0.25
"""Share of flights that a correction may make worse without a warning. Convention."""

# -------------------------------------------------------- what a result reports

LEAST_SPREAD = 0.1
"""Least flight-to-flight variation to report, in a coefficient's scale. Convention."""

CURVE_Z = 5.0
"""Standard errors by which a curve must differ from zero, somewhere in the central 90 %
of the flown angles. Derived: at its ten independent places none does so by chance."""
