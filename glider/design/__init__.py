"""Which throw next: flights that tell rival explanations of a campaign apart.

Floor: above the tracing, the planning and the funnels, below the reports.
"""
