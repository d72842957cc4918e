"""A session in the lab: throws come into a folder, and the loop is closed as they do.

`command` is `python -m glider lab`; `session` does the work, and runs without a page.
"""
