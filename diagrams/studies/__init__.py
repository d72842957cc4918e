"""Studies in diagrams: what the examples fly, and the figures and words made of it.

perch_study: a plan, replayed and defended. rehearsal: plan with one glider, fly
another. sampled: a controller that samples. funnel_*: funnels, made, flown in and
shown. controllers: who plans anew, against TVLQR. filter_report: filters. figures:
pictures of paths.
"""
