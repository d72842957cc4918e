"""Compares the reports of two campaigns: did a change to the glider show?

`saved` reads a report.json, `differences` compares two of them; `terminal`,
`comparison_page` and `as_json` show the outcome. Standard errors are those of the
reports, and two campaigns are taken to be independent.
"""
