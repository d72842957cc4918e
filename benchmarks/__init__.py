"""Benchmarks, and the tables of README and docs that they measure."""

import tests  # The article's programs are imported by name.
