"""Tests. The article's programs and what stands beside them are imported by name."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "examples" / "article"))
