"""The station: poses in from a bus, commands out to it, every throw a log.

scenario: what a session is made of, from YAML. bus: the messages. clocks, estimation,
release, controllers: from a pose to a command. safety, wire: what keeps a command
harmless. throw_log: the record of a throw, and its flight. station: all of it, as a
machine of states. realtime: its loop. simulated: a glider on the same bus. drivers:
real cameras and servos.
"""
