"""Which throw next: flights that tell rival explanations of a campaign apart.

Floor: above the tracing and the planning, below the reports.
"""
