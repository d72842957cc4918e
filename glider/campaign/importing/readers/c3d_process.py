"""Program that reads a C3D file with ezc3d and writes its arrays as .npz.

A process of its own: of 400 damaged files ezc3d 1.7 crashed on 8 and hung on 3.
"""

import json
import sys

import ezc3d
import numpy as np

PARAMETERS = {
    "POINT": ("RATE", "UNITS", "ANGLES", "ANGLE_UNITS"),
    "ROTATION": ("RATE", "RATIO"),
    "ANALOG": ("RATE",),
}
"""Parameters that are read, beside the labels, by group."""


def main(source: str, target: str) -> None:
    """Reads one file and writes the other."""
    content = ezc3d.c3d(source)
    parameters = {}
    for group, wanted in PARAMETERS.items():
        for name, parameter in content["parameters"].get(group, {}).items():
            if name in wanted or name.startswith("LABELS"):
                values = np.ravel(parameter["value"]).tolist()
                parameters[f"{group}:{name}"] = values
    data = content["data"]
    np.savez(
        target,
        parameters=np.array(json.dumps(parameters)),
        points=data["points"],
        residuals=data["meta_points"]["residuals"],
        rotations=data["rotations"],
        analogs=data["analogs"],
    )


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except Exception as error:
        sys.exit(f"{error}")
