"""Our solvers beside those of other libraries, on the same problems.

Each module compares with one library, which it imports when it is asked to. The
physics is ours on both sides, so that solver is held against solver.
"""
