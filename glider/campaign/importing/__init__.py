"""Logs of other software made campaigns, as a mapping specifies.

campaign_import: `import_campaign`, all steps. readers: one for each file format;
recording: what each gives. Then one step after the other: splitting (several flights),
track (columns, units and axes), cutting (release to contact), clock_offset,
servo_logs. guess: proposes a mapping, with axes by frame_posterior (probabilities of
frames).
"""
