"""Are the logs what they claim to be? Checked before anything is traced.

inspection: `inspect`, all checks in order. masks: what is excluded. stamps: times that
jitter. motion: velocity and acceleration of a log. forces: gravity and forces fitted to
them, once for all checks. fall: the scales of lengths and times by gravity. rows,
smoothness: faulty rows, and rows of no flight. frame: axes, units, the direction of the
fall. signs: the axes and signs of an import's mapping. rates: clocks of rows and
commands. servo: whether the elevator follows its commands. servo_forms, servo_fit: the
servo that it follows. travel: how far it turns. planarity: roll and yaw.
"""
