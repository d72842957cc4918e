"""Closes the loop on a campaign: what does the model lack, and what is it worth?

python examples/close_the_loop.py [CAMPAIGN]
"""

import argparse
import json
import math
from pathlib import Path

from glider.paths import models_path
from glider.physics.model import save_model
from glider.sysid.pipeline import close_the_loop
from glider.sysid.result import Result


def describe(result: Result) -> str:
    """Returns what was found in a few lines."""
    lines = [f"{result.campaign}: {result.verdict}"]
    for effect in result.effects:
        lines.append(f"  {effect.kind} ({effect.words})")
        for name, c in effect.coefficients.items():
            error = f" ± {c.std:.2g}" if math.isfinite(c.std) else ""
            lines.append(f"    {name} = {c.value:.4g}{error} {c.unit}")
    for model, errors in result.errors.items():
        if errors is not None:
            position = 1000.0 * errors.position_rms_m
            lines.append(f"  {model}: held-out position error {position:.1f} mm")
    return "\n".join(lines)


def main():
    """Runs the main job and prints what it found."""
    parser = argparse.ArgumentParser(description=__doc__)
    sample = models_path("campaigns", "attached_lift")
    parser.add_argument("campaign", nargs="?", type=Path, default=sample)
    parser.add_argument("--model", type=Path, help="where to save the corrected model")
    parser.add_argument("--json", type=Path, help="where to save the key figures")
    args = parser.parse_args()

    result = close_the_loop(args.campaign)
    print(describe(result))
    if args.model:
        save_model(args.model, result.model)
    if args.json:
        kinds = [effect.kind for effect in result.effects]
        figures = {"verdict": result.verdict, "effects": kinds}
        args.json.write_text(json.dumps(figures))


if __name__ == "__main__":
    main()
