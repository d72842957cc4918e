"""Which effects explain the flights? Candidates, evidence, and a decision.

candidates, beam_search: sets of effects, tried and weighed. residual_field: what has no
name. decision: one against the other. free_rollout_search: real flights without a
nominal model. signs: angles logged with the other sign. explanation: what was found.
"""
