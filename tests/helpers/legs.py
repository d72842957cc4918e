"""Tests that need not run with each of the two Drakes."""

import shutil
import sys

import pytest

WITHOUT_DRAKE = pytest.mark.skipif(
    sys.version_info >= (3, 12) and shutil.which("python3.11") is not None,
    reason="tracing does not touch Drake: it is tested with Python 3.11",
)
"""Mark of long tests in which Drake has no part: where there are both interpreters, one
of them runs these."""
