"""Figures of the studies: arrays and an `ax` in, or a path to save to."""
