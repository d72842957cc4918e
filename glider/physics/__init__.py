"""The glider as numbers, and the one text of its physics. No Drake System, no loop.

state: axes and signs. parameters, numbers: what the formulas take. chain: the forces,
link by link. effects: what may be added to a link. compose: joins the two.
parameter_space: the numbers of both as one vector, with names and bounds. model:
`GliderModel`, and its file. servo: limits of the elevator. covariance, confidence: how
well its numbers are known, and the set of gliders that the data allow.
"""
