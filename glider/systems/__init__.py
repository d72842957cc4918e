"""Drake Systems, one to a module: shells of ports and context; `diagrams` wires them.

plant: the glider. elevator_servo: its servo. noise: measurement noise. observer: states
that are not measured. kalman_filter: an extended Kalman filter. regulator: feedback
along a plan. mpc, mppi: controllers that plan again. funnel_monitor: whether a state is
in a funnel. command_tape: recorded commands.
"""
