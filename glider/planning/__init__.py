"""One problem, several planners, one `Plan`.

problem: what a perch asks for, and its hook. constraints: what that demands of a
flight, read by all that follows. dircol: Drake's direct collocation, of the program in
program; path. sampling: planners over explicit steps. plan: what all of them return,
and its file.
"""
