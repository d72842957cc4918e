"""Program that reads a C3D file with ezc3d and writes its arrays as .npz.

A process of its own: of 400 damaged files ezc3d 1.7 crashed on 8 and hung on 3.
"""

import json
import sys

import ezc3d
import numpy as np


def main(source: str, target: str) -> None:
    """Reads one file and writes the other."""
    content = ezc3d.c3d(source)
    parameters = {
        f"{group}:{name}": np.ravel(parameter["value"]).tolist()
        for group in ("POINT", "ANALOG")
        for name, parameter in content["parameters"].get(group, {}).items()
        if name != "__METADATA__"
    }
    data = content["data"]
    np.savez(
        target,
        parameters=np.array(json.dumps(parameters)),
        points=data["points"],
        residuals=data["meta_points"]["residuals"],
        analogs=data["analogs"],
    )


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except Exception as error:
        sys.exit(f"{error}")
