"""Are the logs what they claim to be? Checked before anything is traced.

inspection: `inspect`, all checks in order. masks: what is excluded. motion: velocity
and acceleration of a log. forces: gravity and forces fitted to them. rows, smoothness:
faulty rows, and rows of no flight. frame: axes, units, the direction of the fall.
clocks: rates, and whether the elevator follows its commands. planarity: of a throw.
"""
