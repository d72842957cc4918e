"""One problem, several planners, one `Plan`.

problem: what a perch asks for, and its hook. constraints: what that demands of a
flight, read by all that follows. dircol: direct collocation, with our own solver in
structured and Drake's in program; path and guess. reach: launches that can perch.
sampling: planners over explicit steps. plan: what all of them return, and its file.
"""
