"""Numbers that steer the analysis of a campaign, each with its reason and source.

Sources are (d) derived from a stated probability or error, (m) measured, by the
benchmark or page that is named, or (c) a convention: chosen, and never calibrated. What
is physics, or the step of a numerical method, stands where it is used; so may a number
of one module alone, with its reason.
"""

import math

# ------------------------------------------------------- chance, and how much of it
# Probability below which nothing is put down to chance (c): a faultless campaign of 400
# is claimed to have a fault.
UNLIKELY = 1.0 / 400.0
# Standard errors of what is not by chance, whatever is tried (d): no flight counts for
# more.
Z = 5.0
# Evidence, a gain of marginal likelihood, by which a search leaves one set for another,
# and which rivals lack at most [nats]; and that an effect must bring beside others, of
# which 40 are tried (d).
RIVAL_GAP = -math.log(UNLIKELY)
EVIDENCE_THRESHOLD = math.log(40.0 / UNLIKELY)
# Evidence above which errors of linearization decide nothing [nats] (c).
CLEAR = 30.0
MANY_FLIGHTS = 40  # More are thinned where sets or floors are compared (c).
FEW_FLIGHTS = 8  # That show a wrong sign, or what a model lacks (c).

# ------------------------------------------------------------------- noise
# Correlation time of unmodelled pitch accelerations, and of an elevator's departure
# from its path, over which its travel counts [s] (c).
MOMENT_TIME = 0.1
# Prior spread of a launch about its smoothed measurement, as the state [m, rad, s] (c);
# that of the elevator is a scale of the noise.
LAUNCH_SPREAD = (0.1, 0.1, 0.15, 0.0, 0.5, 0.5, 2.0)

# ------------------------------------------------- coefficients and unknowns
# Prior spread of effects' coefficients, in their scales: free functions have no larger
# one (c).
PRIOR_SCALES = 3.0
# Prior spread of an unknown tail's area over the default glider's (of other parameters,
# a half), and of an unmeasured elevator's travel over the one that its log says: the
# moment shows both only over the inertia. Beyond it the log is in doubt (c).
TAIL_SPREAD = 0.1
# Shift of a servo's log above which its clock is in doubt, and a lag that its samples
# do not hide [s] (d): three standard errors of a clock that an import finds.
CLOCK_ERROR = 0.015

# ---------------------------------------------------------- outlying flights
# Noise over the usual one under which flights, and their signs, are compared: errors of
# any one model count little (c).
COARSE_NOISE = 5.0
# Flights for each that may be an outlier: more outliers are no exceptions (c).
PER_OUTLIER = 5
# Least deviation of a log mean square, twice the median one (m: docs/theory/
# tracing.md).
LEAST_DEVIATION = 0.15
# Flight-to-flight variation that is reported, in a coefficient's scale (c).
LEAST_SPREAD = 0.1

# ------------------------------------------------- gliders of unknown forces
# Of effects of gliders of unknown forces, by predictions: e³ is 20 to 1, and 20 effects
# are tried (d); of a further coefficient, and of one that needs a cause (c).
HELD_OUT_THRESHOLD = {"effect": 3.0, "coefficient": 2.0, "uncommon": 8.0}
ALONG_ATTITUDE = {  # Noise of flights along their attitude, which ignore moments (c).
    "position": 1e-3,
    "pitch": 2e-3,
    "moment": 200.0,
    "air": 0.06,  # Errors of C_L and C_D to begin with.
    "air_time": 0.3,  # [s]
    "wind": 1e-3,
    "trim": 0.05,
    "pitch_zero": 3e-3,
    "rest": 0.1,
}

# ------------------------------------------------------------------ the search
MOST_EFFECTS = 8  # Of a set (c): logs that contradict themselves call for any number.
# Best sets that are followed up: by larger ones, by fits, by averages (c): each costs.
FOLLOWED = 3
# Share of the evidence that may be left out to first order, by a smaller set (c).
SLACK = 0.1

# -------------------------------------------------- free functions and fits
# RMS along flights, over its prior's, of what a function shows, and the strength of one
# that is as good as none (c). Below twice that, one stands for the errors of others (m:
# bench_forms and bench_adverse: right names have 0.05 at least, wrong ones 0.01, 0.02,
# 0.03 and 0.14).
RESOLVED = 0.02
# The same of coordinates with which functions are compared (c).
LEADING = 0.1

# --------------------------------------------- predictions of held-out flights
FOLDS = 5  # Parts of the flights, each held out once (c).
BEGINNING = 0.2  # Share of a flight on which its launch state is fitted (c).
LARGEST_ERROR = 10.0  # Above which a model, or a replica, says nothing [m] (c).
WORSE = 1.001  # Ratio of errors above which flights got worse: below is a tie (c).

# ---------------------------------------------------------------- the verdict
MOST_LEFT = 2.0  # Times a perfect model's error that effects may leave at most (c).
# Times a perfect model's error that is never put to chance (c): that of the few
# held-out flights varies, by up to 2.
NO_CHANCE = 2.5
# Share of the RMS pitch acceleration that a model may leave (m: bench_broken): at most
# 0.04 in campaigns with the right answer, 0.2 to 1 where elevator and pose are of
# different flights or clocks.
MOMENT_SHARE = 0.1
# Share by which the elevator may move more or less than commanded (m: bench_broken),
# with lag and delay fitted: 0.003 at most in 60 campaigns, servos of other forms than
# the library's among them; 0.04 and 0.05 where one clock is 5 % slow.
GAIN_ERROR = 0.03

# --------------------------------------------------------- what results report
# Share of the evidence below which an effect stands for the errors of free functions
# (m: bench_forms; of right names beside them the least had 0.02).
SLIGHT = 0.01
# Share of what a free function gains that a formula explains in its place at least to
# be its name (c): a constant thrust gains 0.12 of a push that dies away; a wrong name
# for turbulence gained 0.09. And where the function may only bend another formula, or
# varies with more than the formula does: 0.17 was gained by a moment over the angle of
# attack in the place of a damping that only the attached flow has.
EXPLAINED = 0.1
MOSTLY = 0.5
