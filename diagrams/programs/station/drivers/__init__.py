"""Drivers, each a process of its own between hardware and the bus.

poses: from any tracker to the bus, a driver in twenty lines.
servo_board: from the bus to a servo, over a serial line.
"""
