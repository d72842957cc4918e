"""The waist: everything above this module meets the physics here.

`compose` joins the chain of `glider.physics.chain` with a tuple of effects and returns
functions that run on floats, AutoDiffXd, Expression and complex numbers;
`glider.compiled.kernel` compiles the very same text.
"""

import functools
import inspect
import linecache
import types
from collections.abc import Callable

from glider.physics import chain
from glider.physics.effects.effect import STAGES, EffectKind
from glider.physics.effects.field import field_terms
from glider.physics.state import NUM_STATES

_CHAIN = inspect.getsource(chain)
"""Read now: the file may be edited while this process runs."""

_HOOKS = {
    "air": ("air_terms", "motion"),
    "geometry": ("geometry_terms", "flow"),
    "surface": ("surface_terms", "flow"),
    "wrench": ("wrench_terms", "flow"),
    "inertia": ("inertia_terms", "flow"),
    "sensor": ("sensor_terms", "flow"),
}


def ordered(effects: tuple[EffectKind, ...]) -> tuple[EffectKind, ...]:
    """Returns effects with states of actuators first, as the state holds them."""
    return tuple(sorted(effects, key=lambda e: e.stage != "actuator"))


def coefficient_slices(effects: tuple[EffectKind, ...]) -> dict[str, slice]:
    """Returns where each kind's coefficients lie in the vector c."""
    slices, start = {}, 0
    for effect in effects:
        slices[effect.kind] = slice(start, start + len(effect.coefficients))
        start += len(effect.coefficients)
    return slices


def state_slices(effects: tuple[EffectKind, ...]) -> dict[str, slice]:
    """Returns where each kind's own states lie among the extra states."""
    slices, start = {}, 0
    for effect in ordered(effects):
        slices[effect.kind] = slice(start, start + len(effect.states))
        start += len(effect.states)
    return slices


def hooks_source(effects: tuple[EffectKind, ...], skip_absent: bool = False) -> str:
    """Returns Python text that defines the `*_terms` functions of these effects.

    The text calls formula `i` as `formula_i` and its state rate as `rate_i`.

    Args:
        effects: the kinds.
        skip_absent: whether the text leaves out at run time the formulas whose
            coefficients that are not mere shapes are all zero. That saves a
            kernel with the whole library most of its work. It is right for
            floats and for complex steps, but not for AutoDiffXd coefficients.
    """
    coefficients, states = coefficient_slices(effects), state_slices(effects)

    def call(name: str, i: int, first: str) -> str:
        own = states[effects[i].kind]
        mine = coefficients[effects[i].kind]
        arguments = [first]
        arguments += [f"x[{NUM_STATES + j}]" for j in range(own.start, own.stop)]
        arguments += [f"c[{j}]" for j in range(mine.start, mine.stop)]
        return f"{name}_{i}({', '.join(arguments)})"

    lines = []
    for stage, (hook, first) in _HOOKS.items():
        # A pose shows a fault of its log too.
        stages = (stage, "log") if stage == "sensor" else (stage,)
        members = [i for i, e in enumerate(effects) if e.stage in stages]
        sums: dict[str, list[str]] = {term: [] for term in STAGES[stage]}
        lines.append(f"def {hook}({first}, x, c):")
        for i in members:
            line = f"    e{i} = {call('formula', i, first)}"
            if skip_absent:
                present = _present(effects[i], coefficients)
                line += f" if {present} else {_zero(effects[i], first)}"
            lines.append(line)
            targets = effects[i].adds_to
            for k, term in enumerate(targets):
                sums[term].append(f"e{i}" if len(targets) == 1 else f"e{i}[{k}]")
        terms = ", ".join(" + ".join(s) if s else "0.0" for s in sums.values())
        lines.append(f"    return {terms}\n")

    actuators = [e for e in ordered(effects) if e.stage == "actuator"]
    lines.append("def actuator_terms(rate, x, c):")
    rates = ["def actuator_rates(rate, x, c):"]
    derivatives_of: list[str] = []
    for effect in actuators:
        i = effects.index(effect)
        if effect.states:
            derivatives_of += _unpack(rates, call("rate", i, "rate"), effect, i)
        step = f"    rate = {call('formula', i, 'rate')}"
        lines.append(step)
        rates.append(step)
    lines.append("    return rate\n")
    lines += [*rates, f"    return ({' '.join(d + ',' for d in derivatives_of)})\n"]

    lines.append("def effect_rates(flow, x, c):")
    derivatives_of = []
    for effect in ordered(effects):
        if effect.states and effect.stage != "actuator":
            i = effects.index(effect)
            derivatives_of += _unpack(lines, call("rate", i, "flow"), effect, i)
    lines.append(f"    return ({' '.join(d + ',' for d in derivatives_of)})\n")
    return "\n".join(lines)


def _present(effect: EffectKind, coefficients: dict[str, slice]) -> str:
    start = coefficients[effect.kind].start
    sizes = [j for j, c in enumerate(effect.coefficients) if not c.is_shape]
    return " or ".join(f"c[{start + j}] != 0.0" for j in sizes)


def _zero(effect: EffectKind, first: str) -> str:
    zero = f"0.0 * {first}.xdot"
    return (
        zero
        if len(effect.adds_to) == 1
        else f"({', '.join([zero] * len(effect.adds_to))})"
    )


def _unpack(lines: list[str], call: str, effect: EffectKind, i: int) -> list[str]:
    """Appends the call of a state rate; returns the names of its results."""
    lines.append(f"    d{i} = {call}")
    if len(effect.states) == 1:
        return [f"d{i}"]
    return [f"d{i}[{k}]" for k in range(len(effect.states))]


def formulas(effects: tuple[EffectKind, ...]) -> dict[str, Callable]:
    """Returns the names that the text of `hooks_source` needs."""
    names: dict[str, Callable] = {"field_terms": field_terms}
    for i, effect in enumerate(effects):
        names[f"formula_{i}"] = effect.formula
        if effect.state_rate is not None:
            names[f"rate_{i}"] = effect.state_rate
    return names


def source(
    effects: tuple[EffectKind, ...], has_field: bool, skip_absent: bool = False
) -> str:
    """Returns the text of the chain with these effects joined in.

    The functions that `hooks_source` defines come last and so replace those of
    the nominal model.
    """
    parts = [_CHAIN, hooks_source(effects, skip_absent)]
    if has_field:
        parts.append("residual_terms = field_terms")
    return "\n\n".join(parts)


@functools.lru_cache(maxsize=64)
def compose(
    effects: tuple[EffectKind, ...] = (), has_field: bool = False
) -> types.SimpleNamespace:
    """Joins the chain with effects.

    Args:
        effects: the kinds, in the order in which their coefficients follow each
            other in `c`.
        has_field: whether a residual Field acts; else `field` is not looked at.

    Returns:
        A namespace with `derivatives`, `measure`, `meet_air`, `wrench` and the
        other functions of the chain, for these effects.
    """
    tag = "-".join(e.kind for e in effects) or "nominal"
    tag += "-field" * has_field
    filename, text = f"<dynamics of {tag}>", source(effects, has_field)
    linecache.cache[filename] = (len(text), None, text.splitlines(True), filename)
    names = formulas(effects)
    exec(compile(text, filename, "exec"), names)  # Our own text only.
    return types.SimpleNamespace(**{k: v for k, v in names.items() if callable(v)})


def initial_extra(effects, flow, rate, c):
    """Returns the effects' own states at rest in a flow, in the state's order."""
    slices = coefficient_slices(effects)
    extra: list = []
    for effect in ordered(effects):
        if effect.steady_state is not None:
            first = rate if effect.stage == "actuator" else flow
            value = effect.steady_state(first, *c[slices[effect.kind]])
            extra.extend(value if isinstance(value, tuple) else (value,))
    return extra
