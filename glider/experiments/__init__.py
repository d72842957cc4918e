"""Design of experiments: which throw next, to distinguish rival explanations.

explanations: of a campaign, from the findings of an analysis, weighed. throws,
throw_limits, known_funnel and funnel_throws: what may be flown. forecast: what throws
will show. throw_search and proposal: those that show most.

Floor: above the tracing, the planning and the funnels, below the reports.
"""
