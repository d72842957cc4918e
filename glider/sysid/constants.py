"""The numbers that steer the analysis of a campaign, each with its reason and source.

Sources are "derived" from a stated probability or error, "measured" by the benchmark
that is named, or "convention" for a size that was chosen and never calibrated. What is
physics, or only the step of a numerical derivative, stands where it is used.
"""

import math

# -------------------------------------------------- predictions of held-out flights

FOLDS = 5  # Parts of the flights, each held out once. Convention.

BEGINNING = 0.2  # Share of a flight on which its launch state is fitted. Convention.
BEGINNING_WITH_TRIM = 0.4  # The same where a trim of the flight is fitted too.
BEGINNING_ROWS = 10  # Rows of a beginning at least: a launch has 7 states. Convention.

GAIN_CHANCE = 0.025
"""Probability that a correction which gains nothing is significant. Convention: one
side of 95 %."""

LEAST_UNSEEN_GAIN = -math.log(GAIN_CHANCE)
"""Gain on flights that nothing has seen [nats]. Derived: by Markov's inequality a wrong
model's likelihood ratio exceeds 1/p with a probability of p at most."""

GAIN_CLIP = 3.0
"""Standard deviations about the median that flights' gains are held within. Convention:
one flight may not decide."""

WORSE = 1.001, 1.02
"""Ratios of errors above which a correction makes flights worse, free and along the
measured pitch. Convention: a tie, and what chance does where the pitch is given."""

REPLICAS = 100
"""Replicas of a flight that its floor is drawn from. Derived: its RMS is known to 5 %,
less than flights differ."""

FLOOR_ACCURACY = 0.05  # Relative error of a floor. Measured (bench_floor).
FLOOR_FLIGHTS = 40  # Flights that a floor is compared on. Convention: it takes time.
FLOOR_CLIP = 3.0
"""Logarithm of a flight's error over its floor that counts at most. Convention: one
flight may not decide."""

LARGEST_FLOOR = 10.0  # Error of a replica above which it diverged [m]. Convention.

CURVE_ALLOWANCE = 4.5
"""Evidence that the strength of curves may cost, with which standard errors allow for
errors of formulas [nats]. Derived: three standard deviations, ½ 3²."""

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
