"""The main job: from flight logs to the effect that the model lacks.

pipeline: `close_the_loop`, which checks its input. analysis: the stages in order.
replay: a log flown again. fit: coefficients from many flights. search: which effects?
evaluation, verdict: do they hold? outcome, result: what is handed back.
"""
