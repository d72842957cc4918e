"""Flights in and out: folders of logs, read, checked and written; motion capture.

reader, flight_reader, csv_table: a folder, one flight, one file of numbers. logs: what
they hold, in memory. writer: the way back. motion_capture: logs of simulated flights.
"""
