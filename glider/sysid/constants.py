"""The numbers that steer the analysis of a campaign, each with its reason and source.

Sources are (d) derived from a stated probability or error, (m) measured, by the
benchmark or page that is named, or (c) a convention: chosen, and never calibrated. What
is physics, or the step of a numerical method, stands where it is used.
"""

# ------------------------------------------------------------------- noise
# Standard deviations, see `Scales` for units: where a fit starts, the least that a log
# shows, the most that a flight of a glider has (c).
NOISE = {
    "position": (1e-3, 1e-6, 0.2),
    "pitch": (5e-3, 1e-5, 0.3),
    "elevator": (1e-2, 1e-5, 0.3),
    "air": (0.05, 1e-3, 0.6),
    "air_time": (0.25, 0.04, 1.0),
    "moment": (1.0, 1e-2, 200.0),
    "servo": (5e-3, 1e-4, 0.3),
    "wind": (0.05, 1e-3, 0.5),
    "trim": (5e-3, 1e-4, 0.1),
    "pitch_zero": (5e-3, 1e-4, 0.03),
    "rate": (1e-2, 1e-4, 5.0),
}
# Prior spread of the logarithm of the gusts' correlation time, which flights in nearly
# still air do not determine: a factor of two (c).
AIR_TIME_SPREAD = 0.7
STILL = 2.0  # Gusts over their least, below which there are none (c).
MOMENT_TIME = 0.1  # Correlation time of unmodelled pitch accelerations [s] (c).
SERVO_TIME = 0.05  # The same of an elevator's departure from its path [s] (c).
# Prior spread of a launch about its smoothed measurement, as the state [m, rad, s] (c).
LAUNCH_SPREAD = (0.1, 0.1, 0.15, 0.1, 0.5, 0.5, 2.0)
STATE_SPREAD = 0.05  # The same of effects' states about rest, in their scales (c).

# ------------------------------------------------- coefficients and unknowns
PRIOR_SCALES = 3.0  # Prior spread of effects' coefficients, in their scales (c).
# Prior spread of unknown parameters over the default glider's, if not a half (c). A
# tail's area shows in the moment only over the inertia.
RELATIVE_SPREAD = {"elevator_area": 0.1}
UNKNOWN_SPREAD = {  # That of other unknowns [m, rad, m, m²] (c).
    ("parameters", "wing_offset"): 0.03,  # Of an unknown wing from the center of mass.
    ("elevator_trim", "angle"): 0.09,  # Of an elevator without a servo.
    ("pitch_moment", "coefficient"): 0.02,  # That an unknown tail may make.
    ("pitch_damping", "coefficient"): 0.016,  # Four times that of a usual glider.
}
TRAVEL_SPREAD = 0.2  # Of an elevator's travel over the commanded one (c).
GYRO_BIAS = 0.05  # Prior spread of the bias of a gyro [rad/s] (c).
CLOCK_REACH = 2.0  # Standard errors by which clocks differ at most (m: bench_clock).
HIDDEN_LAG = 0.015  # Lag that samples of an elevator do not hide, at most [s] (c).

# -------------------------------------------------------------- rows of logs
GAP = 1.6  # Time between rows, over the usual one, above which nodes are inserted (c).
FEWEST_ELEVATOR_ROWS = 10  # Below, a flight shows none of the elevator's noise (c).

# ---------------------------------------------------------- outlying flights
# Noise under which flights are compared: errors of any one model count little (c).
COARSE_NOISE = {
    **{"position": 0.01, "pitch": 0.02, "elevator": 0.05},
    **{"air": 0.3, "moment": 5.0, "servo": 0.02},
}
# Deviations of a log mean square that make an outlier, and the least deviation: both
# are twice the median (m: docs/how_it_works.md). Right flights are at 4.3 at most.
Z_OUTLYING, LEAST_DEVIATION = 5.0, 0.15
HEAVY_FLIGHT = 2.0  # Mean square over the median above which a flight counts less (c).
FEWEST_COMPARED = 5  # Flights below which none can be an outlier (c).
MOST_OUTLYING = 0.3  # Share of the flights that may be: more are no exceptions (c).
# Deviations of a flight's wind, trim or pitch offset that are no variation: no normal
# one is as large (d), and the least one, in a coefficient's scale (c).
Z_EXTREME, LEAST_EXTREME = 10.0, 0.3

# ---------------------------------------------------------- evidence of effects
# Evidence, a gain of marginal likelihood, that an effect must bring beside others
# [nats] (d): odds of 400 to 1 that none of 40 acts. Where one effect and moving air
# explain the flights it need only be likelier than that none does.
EVIDENCE_THRESHOLD = 10.0
THRESHOLD_FLIGHTS = 40  # Above which thresholds grow: of the tries that set them (m).
SIMPLE_MOMENT = 0.3  # Pitch acceleration of errors of formulas [rad/s²] (c).
# Of effects of gliders of unknown forces, by predictions: e³ is 20 to 1, and 20 effects
# are tried (d); of a further coefficient, and of one that needs a cause (c).
HELD_OUT_THRESHOLD, HELD_OUT_COEFFICIENT, HELD_OUT_UNCOMMON = 3.0, 2.0, 8.0
ALONG_ATTITUDE = {  # Noise of flights along their attitude, which ignore moments (c).
    **{"position": 1e-3, "pitch": 2e-3, "moment": 200.0},
    **{"air": 0.06, "air_time": 0.3},  # Errors of C_L and C_D to begin with, and [s].
    **{"wind": 1e-3, "trim": 0.05, "pitch_zero": 3e-3},
}

# ------------------------------------------------------------------ the search
MOST_EFFECTS = 8  # Of a set (c).
MOST_COMPARED = 60  # Flights that sets are compared on before they are fitted (c).
BEAM = 4  # Sets that each size is reached from (c).
HOPELESS = 30.0  # Loss below the best set at which larger ones are left [nats] (c).
SLACK = 0.1  # Share of the evidence that a smaller set may lack, to first order (c).
OFF = 5.0  # Standard errors by which a mean over flights is off zero (d): by no chance.
# Evidence, to first order, that another effect may cost (c), and below which a model is
# refitted without one [nats] (m: bench_forms; of 60 refits of seeds 0, 1, 4, 9 and 14,
# none without an effect of more than 3 was worth more).
UNDERVALUED = 30.0
MOST_TRIED = 3  # Sets with another effect that are fitted: each costs a fit (c).
# Evidence that a fit lacks which is not worth ending [nats] (c).
CLEAR = 100.0
FORCE_ROUNDS = 4  # Of sets and strengths of errors that depend on each other (c).
# Log-likelihood of a median flight by which other signs are better, and the flights
# compared [nats] (c): a wrong sign shows in any.
SIGN_GAIN, SIGN_FLIGHTS = 20.0, 6

# ------------------------------------------------------- support of an effect
RESAMPLES = 25, 200  # Sets of flights drawn: at least, and at most in doubt (c).
# Share of them that must choose an effect or a rival, and of a single effect, which
# needs that share of its threshold there (c).
LEAST_SUPPORT, SIMPLE_SUPPORT, RESAMPLED_SHARE = 0.85, 0.5, 0.5
# Evidence between rivals at most, by which a search leaves one set for another [nats]
# (d): odds of 400 to 1.
RIVAL_GAP = 6.0
LEAST_STAND_IN = 0.1  # Share of draws with another effect that make it a rival (c).
MOST_RIVALS = 0.5  # Share of the library above which rivals are no support (c).
DOUBTED = 60.0  # Evidence up to which too little support drops an effect [nats] (c).
OFFERED = 25.0  # Loss up to which draws are offered an effect [nats] (c).

# -------------------------------------------------- free functions and fits
RESOLVED = 0.02  # RMS along flights, over its prior's, of what a function shows (c).
LEAST_STRENGTH = 0.02  # Of a free function over its prior's, as good as none (c).
STRENGTHS_TRIED = 0.1, 0.3, 1.0  # Of one that does not act yet (c).
LARGEST_STRENGTH = 5.0  # That no error of a formula has (c).
# Of free functions, in prior spreads: a fit that diverges does not overflow (c).
LARGEST_COORDINATE = 30.0
LARGEST_PUSH = 1e3  # Change of a state in an interval that no flight has (c).
SURVEY_FLIGHTS = 12  # On which the remainder is compared with free functions (c).
FIT_TOLERANCE = 0.3  # Gain of an iteration below which a fit stops [nats] (c).
MOST_TRIES = 3  # Of shorter steps in a fit (c).

# --------------------------------------------- predictions of held-out flights
FOLDS = 5  # Parts of the flights, each held out once (c).
BEGINNING = 0.2  # Share of a flight on which its launch state is fitted (c),
BEGINNING_WITH_TRIM = 0.4  # where a trim of the flight is fitted too (c).
BEGINNING_ROWS = 10  # Its rows at least: a launch has seven states (c).
GAIN_CHANCE = 0.025  # That a gain of nothing is significant: one side of 95 % (c).
# Standard deviations about the median that gains of flights are held within: one flight
# may not decide (c).
GAIN_CLIP = 3.0
WORSE = 1.001  # Ratio of errors above which flights got worse: below is a tie (c).
REPLICAS = 100  # Of a flight: the RMS of its floor is known to 5 % (d).
FLOOR_ACCURACY = 0.05  # Relative error of a floor (m: bench_floor).
FLOOR_FLIGHTS = 40  # Flights that a floor is compared on; it takes time (c).
FLOOR_CLIP = 3.0  # Log of an error over its floor that counts: no flight decides (c).
LARGEST_FLOOR = 10.0  # Error above which a replica says nothing [m] (c).
MOST_AVERAGED = 4  # Rivals that standard errors average over: each costs two fits (c).

# ---------------------------------------------------------------- the verdict
# Probability below which errors are not those of a perfect model, or gusts not
# turbulence (d): one faultless campaign of 200 is claimed to have a fault.
UNLIKELY = 0.005
# Unmodelled pitch acceleration over the RMS one above which the model does not explain
# it (m: bench_broken): at most 0.04 in campaigns with the right answer, 0.2 to 1 where
# elevator and pose are of different flights or clocks.
MOMENT_SHARE = 0.2
NEAR_CEILING = 0.97  # Share of its ceiling above which a scale is at it (c).
# Share by which the elevator may move more or less than commanded (m: bench_broken),
# with lag and delay fitted: 0.003 at most in 60 campaigns, servos of other forms than
# the library's among them; 0.04 and 0.05 where one clock is 5 % slow.
GAIN_ERROR = 0.03
GAIN_Z = 4.0  # Standard errors above which that is significant (d): one in 16,000.
TRAVEL_WINDOW = 0.1  # Time over which an elevator's travel counts [s] (c).
LEAST_TRAVEL = 0.1  # Sum of squared travels that determines a gain [rad²] (c).
# Shift of a servo's log above which its clock is in doubt [s] (d): three standard
# errors of a clock that an import finds.
SHIFTED = 0.015
TRAVEL_ERROR = 0.1  # Share by which an elevator may turn farther than its log says (c).
MOST_LOST = 0.25  # Share of flights that may lose by a correction unwarned (c).

# --------------------------------------------------------- what results report
# Share of the evidence below which an effect stands for the errors of free functions
# (m: bench_forms; of right names beside them the least had 0.02).
SLIGHT = 0.01
LEAST_SPREAD = 0.1  # Flight-to-flight variation, in a coefficient's scale (c).
