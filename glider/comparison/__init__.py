"""Compares the reports of two campaigns: did a change to the glider show?

`differences` reads and compares two of them; `as_text` and `comparison_page` show the
outcome. Standard errors are those of the reports, and two campaigns are taken to be
independent.
"""
