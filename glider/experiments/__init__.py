"""Design of experiments: which throw next, to distinguish rival explanations.

rehearsal: which effects the flights of a campaign would show. explanations: of a
campaign, from the findings of an analysis, weighed. throws and throw_limits: what may
be flown. forecast: what throws will show. throw_search and proposal: those that show
most.

Floor: above the tracing and the planning, below the reports.
"""
