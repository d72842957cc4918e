"""Places of boxes, lines and words in the block diagrams of the docs."""

import dataclasses

Point = tuple[float, float]
Pair = tuple[str, str]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Layout:
    """Layout of a block diagram; lines and words by the boxes that they connect."""

    boxes: dict[str, tuple[float, float, str]]  #: Center, and what makes the system.
    routes: dict[Pair, list[Point]]  #: Corners of each line.
    labels: dict[Pair, tuple[float, float, str]]  #: Place of its words, alignment.
    size: Point  #: Of the figure [in].
    x_limits: Point
    y_limits: Point


LAYOUTS = {
    "autopilot": Layout(
        boxes={
            "station": (0.0, 0.0, "poses in, commands out"),
            "tracker": (5.5, 0.0, "PoseTracker"),
            "controller": (9.5, 0.0, "tracking_regulator"),
        },
        routes={
            ("station", "tracker"): [(1.05, 0.15), (4.45, 0.15)],
            ("tracker", "station"): [(4.45, -0.2), (1.05, -0.2)],
            ("tracker", "controller"): [(6.55, 0.0), (8.45, 0.0)],
            ("controller", "station"): [
                (9.5, -0.45),
                (9.5, -1.5),
                (0.0, -1.5),
                (0.0, -0.45),
            ],
        },
        labels={
            ("station", "tracker"): (2.75, 0.55, "center"),
            ("tracker", "station"): (2.75, -0.75, "center"),
            ("tracker", "controller"): (7.5, 0.22, "center"),
            ("controller", "station"): (7.0, -1.28, "center"),
        },
        size=(8.2, 2.2),
        x_limits=(-1.3, 10.8),
        y_limits=(-1.8, 1.1),
    ),
    "drake_diagram": Layout(
        boxes={
            "regulator": (0.0, 0.0, "tracking_regulator"),
            "hold": (3.5, 0.0, "ZeroOrderHold"),
            "servo": (6.5, 0.0, "ElevatorServo"),
            "glider": (10.3, 0.0, "GliderPlant"),
            "estimator": (0.0, -2.4, "ExtendedKalmanFilter"),
            "cameras": (10.3, -2.4, "SampledNoise"),
            "log": (5.0, -3.9, "LogVectorOutput"),
            "scene": (10.3, 1.9, "AddScene"),
        },
        routes={
            ("regulator", "hold"): [(1.05, 0.0), (2.45, 0.0)],
            ("hold", "servo"): [(4.55, 0.0), (5.45, 0.0)],
            ("servo", "glider"): [(7.55, 0.0), (9.25, 0.0)],
            ("glider", "cameras"): [(10.3, -0.45), (10.3, -1.95)],
            ("cameras", "estimator"): [(9.25, -2.4), (1.05, -2.4)],
            ("estimator", "regulator"): [(0.0, -1.95), (0.0, -0.45)],
            ("servo", "estimator"): [
                (6.5, -0.45),
                (6.5, -1.45),
                (0.7, -1.45),
                (0.7, -1.95),
            ],
            ("glider", "servo"): [(9.7, 0.45), (9.7, 0.95), (6.5, 0.95), (6.5, 0.45)],
            ("glider", "scene"): [(10.5, 0.45), (10.5, 1.45)],
            ("glider", "log"): [
                (11.35, -0.2),
                (11.9, -0.2),
                (11.9, -3.75),
                (6.05, -3.75),
            ],
            ("cameras", "log"): [(10.3, -2.85), (10.3, -4.05), (6.05, -4.05)],
            ("regulator", "log"): [
                (-1.05, 0.0),
                (-1.5, 0.0),
                (-1.5, -3.9),
                (3.95, -3.9),
            ],
        },
        labels={
            ("regulator", "hold"): (1.75, 0.22, "center"),
            ("hold", "servo"): (5.0, 0.22, "center"),
            ("servo", "glider"): (8.4, 0.22, "center"),
            ("glider", "cameras"): (10.2, -1.2, "right"),
            ("cameras", "estimator"): (5.0, -2.2, "center"),
            ("estimator", "regulator"): (-0.1, -1.2, "right"),
            ("servo", "estimator"): (3.6, -1.25, "center"),
            ("glider", "servo"): (8.1, 1.15, "center"),
            ("glider", "scene"): (10.6, 0.95, "left"),
            ("glider", "log"): (8.1, -3.55, "center"),
            ("cameras", "log"): (8.1, -4.27, "center"),
            ("regulator", "log"): (1.3, -3.7, "center"),
        },
        size=(9.6, 5.0),
        x_limits=(-1.7, 12.1),
        y_limits=(-4.6, 2.45),
    ),
    "closed_loop": Layout(
        boxes={
            "regulator": (0.0, 0.0, "tracking_regulator"),
            "command_hold": (3.5, 0.0, "ZeroOrderHold"),
            "servo": (6.5, 0.0, "ElevatorServo"),
            "glider": (10.3, 0.0, "GliderPlant"),
            "motion_capture": (10.3, -2.6, "SampledNoise"),
            "log": (5.0, -2.6, "LogVectorOutput"),
        },
        routes={
            ("regulator", "command_hold"): [(1.05, 0.0), (2.45, 0.0)],
            ("command_hold", "servo"): [(4.55, 0.0), (5.45, 0.0)],
            ("servo", "glider"): [(7.55, 0.0), (9.25, 0.0)],
            ("glider", "servo"): [(9.7, 0.45), (9.7, 0.95), (6.5, 0.95), (6.5, 0.45)],
            ("glider", "regulator"): [
                (9.6, -0.45),
                (9.6, -1.1),
                (0.0, -1.1),
                (0.0, -0.45),
            ],
            ("glider", "motion_capture"): [(10.5, -0.45), (10.5, -2.15)],
            ("command_hold", "log"): [(3.5, -0.45), (3.5, -2.6), (3.95, -2.6)],
            ("servo", "log"): [(6.5, -0.45), (6.5, -2.4), (6.05, -2.4)],
            ("motion_capture", "log"): [(9.25, -2.7), (6.05, -2.7)],
            ("glider", "log"): [
                (11.35, 0.0),
                (11.9, 0.0),
                (11.9, -3.6),
                (5.0, -3.6),
                (5.0, -3.05),
            ],
        },
        labels={
            ("regulator", "command_hold"): (1.75, 0.22, "center"),
            ("command_hold", "servo"): (5.0, 0.22, "center"),
            ("servo", "glider"): (8.4, 0.22, "center"),
            ("glider", "servo"): (8.1, 1.15, "center"),
            ("glider", "regulator"): (1.75, -0.9, "center"),
            ("glider", "motion_capture"): (10.4, -1.55, "right"),
            ("command_hold", "log"): (3.4, -1.9, "right"),
            ("servo", "log"): (6.6, -1.9, "left"),
            ("motion_capture", "log"): (7.7, -2.5, "center"),
            ("glider", "log"): (8.1, -3.3, "center"),
        },
        size=(9.6, 3.6),
        x_limits=(-1.2, 12.1),
        y_limits=(-3.75, 1.4),
    ),
    "estimated_loop": Layout(
        boxes={
            "regulator": (-0.6, 0.0, "tracking_regulator"),
            "command_hold": (3.8, 0.0, "ZeroOrderHold"),
            "servo": (6.8, 0.0, "ElevatorServo"),
            "glider": (10.6, 0.0, "GliderPlant"),
            "estimator": (-0.6, -2.1, "ExtendedKalmanFilter"),
            "believed_servo": (3.2, -2.1, "ElevatorServo"),
            "motion_capture": (10.6, -3.2, "SampledNoise"),
            "log": (6.8, -4.6, "LogVectorOutput"),
        },
        routes={
            ("regulator", "command_hold"): [(0.45, 0.0), (2.75, 0.0)],
            ("command_hold", "servo"): [(4.85, 0.0), (5.75, 0.0)],
            ("servo", "glider"): [(7.85, 0.0), (9.55, 0.0)],
            ("glider", "servo"): [(10.0, 0.45), (10.0, 0.95), (6.8, 0.95), (6.8, 0.45)],
            ("glider", "motion_capture"): [(10.6, -0.45), (10.6, -2.75)],
            ("motion_capture", "estimator"): [
                (9.55, -3.2),
                (-0.2, -3.2),
                (-0.2, -2.55),
            ],
            ("estimator", "regulator"): [(-0.6, -1.65), (-0.6, -0.45)],
            ("estimator", "believed_servo"): [(0.45, -2.25), (2.15, -2.25)],
            ("believed_servo", "estimator"): [(2.15, -1.95), (0.45, -1.95)],
            ("command_hold", "believed_servo"): [(3.4, -0.45), (3.4, -1.65)],
            ("command_hold", "log"): [(4.6, -0.45), (4.6, -4.4), (5.75, -4.4)],
            ("servo", "log"): [(6.8, -0.45), (6.8, -4.15)],
            ("motion_capture", "log"): [(10.6, -3.65), (10.6, -4.45), (7.85, -4.45)],
            ("glider", "log"): [
                (11.65, 0.0),
                (12.2, 0.0),
                (12.2, -4.75),
                (7.85, -4.75),
            ],
            ("estimator", "log"): [(-1.0, -2.55), (-1.0, -4.75), (5.75, -4.75)],
        },
        labels={
            ("regulator", "command_hold"): (1.6, 0.22, "center"),
            ("command_hold", "servo"): (5.3, 0.22, "center"),
            ("servo", "glider"): (8.7, 0.22, "center"),
            ("glider", "servo"): (8.4, 1.15, "center"),
            ("glider", "motion_capture"): (10.5, -1.6, "right"),
            ("motion_capture", "estimator"): (2.3, -3.0, "center"),
            ("estimator", "regulator"): (-0.7, -1.05, "right"),
            ("estimator", "believed_servo"): (1.3, -2.45, "center"),
            ("believed_servo", "estimator"): (1.3, -1.75, "center"),
            ("command_hold", "believed_servo"): (3.3, -1.05, "right"),
            ("command_hold", "log"): (4.7, -1.6, "left"),
            ("servo", "log"): (6.9, -1.6, "left"),
            ("motion_capture", "log"): (9.2, -4.25, "center"),
            ("glider", "log"): (9.2, -5.05, "center"),
            ("estimator", "log"): (2.3, -4.55, "center"),
        },
        size=(9.6, 4.6),
        x_limits=(-1.8, 12.4),
        y_limits=(-5.4, 1.4),
    ),
}
"""Layout of each picture."""
