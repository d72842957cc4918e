"""One problem, several planners, one `Plan`.

problem: what a perch asks for. dircol: direct collocation, with structured (our own
solver), closest, transcription, guess, audit, optimality and multistart. reach: which
launches can perch. sampling: planners over explicit steps. plan: what all of them
return, and its file.
"""
