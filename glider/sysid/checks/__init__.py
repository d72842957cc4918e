"""Are the logs what they say? Asked before anything is traced.

inspection: `inspect`, all checks in order. motion: velocities and accelerations of a
log. rows, runs: faulty rows. standing: rows that are no flight. frame: axes, units,
the direction of a fall. clocks: does the elevator follow its commands? planarity.
"""
