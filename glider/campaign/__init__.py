"""Flights in and out: folders of logs, read, checked and written; motion capture.

reader, flight_reader, flight_table: a folder, one flight, its columns. logs: what
they hold, in memory. writer: the way back. motion_capture: logs of simulated flights.
"""
