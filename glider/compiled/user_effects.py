"""Checks whether user effects can be traced beside those of the library.

A fault in a formula would otherwise show as an error of the compiler. What a kind must
be to be used at all, it checks itself, see EffectKind.
"""

from collections.abc import Sequence

from glider.compiled.kernel import check_compiles
from glider.errors import InputError, expect
from glider.physics.effects import KINDS, STAGES, EffectKind
from glider.physics.effects.effect import try_formulas


def check_user_effects(own: Sequence[EffectKind]) -> None:
    """Raises InputError about the first kind that cannot be used."""
    taken = {*KINDS, "parameters", "rbf_residual", "servo_log", "unexplained"}
    for effect in own:
        if not isinstance(effect, EffectKind):
            found = type(effect).__name__
            raise InputError(f"user effects: found a {found}; expected an EffectKind.")
        name = effect.kind
        if name in taken:
            raise InputError(
                f"user effect '{name}': the name is taken; expected a new one."
            )
        taken.add(name)
        stages = [stage for stage in STAGES if stage != "log"]
        needed = f"one of {', '.join(stages)}"
        expect(
            effect.stage in stages, f"user effect '{name}': stage", effect.stage, needed
        )
        if effect.replay is None or effect.stage != "actuator":
            try_formulas(effect, effect.defaults, check_compiles, "does not compile")
