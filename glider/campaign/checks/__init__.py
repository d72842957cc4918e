"""Are the logs what they say? Asked before anything is traced.

inspection: `inspect`, all checks in order. masks: what is set aside. motion: velocity
and acceleration of a log. rows, runs, standing: faulty rows, and rows of no flight.
frame: axes, units, the direction of a fall. clocks: does the elevator follow its
commands? planarity: of a throw.
"""
