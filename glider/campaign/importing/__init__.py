"""Logs of other software made campaigns, as a mapping says.

run: `import_campaign`. mapping: `columns:`, `units:`, `frame:` of a MAP file or of
campaign.yaml. readers: one for each file format, each giving a raw table; recordings:
files that belong together. Then one step after the other: selection (columns and
units), track (axes), cutting (release to contact), clock, servo, flights (all of them),
signs (is the mapping right?). guess: proposes a mapping. units, optional: what their
names say.
"""
