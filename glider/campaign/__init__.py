"""Flights in and out: folders of logs, read, checked and written; motion capture.

logs: `Campaign` and `Flight` in memory. Files and tables of any kind are recordings
(`importing`). reader, settings: a folder and its campaign.yaml; in_memory: arrays and
data frames; importing: logs of other software. flights makes flights of recordings,
writer files of flights. samples: campaigns that ship. checks: are the logs right?
turning: angles with the other sign. smoothing: splines and their noise. motion_capture:
logs of simulated flights.
"""
