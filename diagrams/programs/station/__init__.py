"""The station: poses in from a bus, commands out to it, every throw a log.

scenario: a session, from YAML. bus: the messages. clocks, tracker, autopilot,
controllers: from a pose to a command. safety, operators, sender, wire: what keeps a
command harmless. throw_log, session: the record of a throw, its flight, and their
folder. station: all of it, as a state machine. realtime, processes: its loop.
simulated: a glider on the same bus. drivers: real cameras and servos.
"""
