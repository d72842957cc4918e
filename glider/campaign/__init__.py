"""Flights in and out: folders of logs, read, checked and written; motion capture.

logs: `Campaign` and `Flight` in memory. reader, settings, flight_table: a folder, its
campaign.yaml, the columns of its flights. writer: the way back. samples: campaigns
that ship. importing: logs of other software. checks: are the logs right? turning:
angles with the other sign. smoothing: splines and their noise. motion_capture: logs of
simulated flights.
"""
