"""One problem, several planners, one `Plan`.

problem: what a perch asks for. dircol: direct collocation, with transcription, guess,
audit and multistart. ilqr, sampling: planners over explicit steps. plan: what all of
them return, and its file.
"""
