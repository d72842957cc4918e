"""Writes what closing the loop found: for programs, for people, as a model.

`report.json` is SI throughout, and NaN or infinity become null. The page and the
terminal show degrees and millimetres where those read better. A number that is missing
reads "–"; a rollout whose state diverged reads "diverges". Figures are specified by
`model_figures` and `flight_figures`; sentences are in `templates/sentences.txt`.
"""
