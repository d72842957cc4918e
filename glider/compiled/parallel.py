"""Work over flights, side by side."""

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

_POOL = ThreadPoolExecutor(max_workers=os.cpu_count())


def in_parallel(function: Callable[[Any], Any], items: Iterable) -> list:
    """Returns function(item) for each; the compiled loops release Python's lock."""
    return list(_POOL.map(function, items))
