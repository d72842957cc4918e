"""Compiles what many tests share, so that no two workers compile the same.

`make test` runs it before there are workers: python -m tests.warm_up
"""

from concurrent.futures import ThreadPoolExecutor

from glider import GliderModel, plan
from glider.sysid.replay.replayed import warm_up

if __name__ == "__main__":
    with ThreadPoolExecutor() as pool:
        list(pool.map(lambda work: work(), [warm_up, lambda: plan(GliderModel())]))
