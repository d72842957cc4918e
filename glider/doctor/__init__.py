"""What works of this installation, and what to do where something does not.

finding: one line of the examination. checks: of the machine and of what is installed.
solvers: of Drake, its solvers and Meshcat. examine: all of them in order.

Nothing but the standard library is imported at the top: the doctor is called when the
rest does not work.
"""
