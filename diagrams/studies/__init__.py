"""The examples' studies: what they fly, and the figures and words they make of it.

rehearsal: plan with one glider, fly another. sampled: searches and a controller that
sample. funnel_*: funnels made, flown in and shown. filter_*: filters. figures: paths.
"""
