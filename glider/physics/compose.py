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
from glider.physics.effects.effect import STAGES, Coefficient, EffectKind
from glider.physics.effects.free_functions import (
    GROUPS,
    ROWS,
    basis_function,
    flow_variables,
    motion_variables,
)
from glider.physics.parameter_space import space_of
from glider.physics.parameters import NUM_PARAMETERS

_OF_FREE_FUNCTIONS = basis_function, flow_variables, motion_variables
_CHAIN = inspect.getsource(chain)
"""Read now: the file may be edited while this process runs."""


def _hooks_source(effects: tuple[EffectKind, ...], skip_absent: bool) -> str:
    """Returns Python text that defines the `*_terms` functions of these effects.

    The text calls formula `i` as `formula_i`, its state rate as `rate_i` and what is
    pending as `pending_i`. The coefficient of a free function is one of `values`. With
    `skip_absent` the text omits at run time the formulas whose sizes, the coefficients
    that are not mere shapes, are all at their defaults, and state rates at defaults
    that no search for the effect starts from. That saves a kernel with the whole
    library most of its work, and is right for floats and complex steps, but not for
    AutoDiffXd coefficients.
    """
    space = space_of(effects)
    free = [kind for kind in effects if kind.is_free]
    places: dict[str, int] = {}
    lines: list[str] = []
    for group, stages in GROUPS.items():
        rows = [ROWS[kind.kind] for kind in free if kind.stage in stages]
        names = [kind.kind for kind in free if kind.stage in stages]
        lines.append(_values_source(group, rows))
        places |= {name: place for place, name in enumerate(names)}

    def entries(i: int) -> list[tuple[str, Coefficient]]:
        """Returns the coefficients of an effect, each with its text."""
        if effects[i].is_free:
            [value] = effects[i].coefficients
            return [(f"values[{places[effects[i].kind]}]", value)]
        slots = space.slots_of(effects[i].kind)
        texts = [f"c[{slot - NUM_PARAMETERS}]" for slot in slots]
        return [*zip(texts, effects[i].coefficients, strict=True)]

    def call(name: str, i: int, *first: str) -> str:
        arguments = [*first]
        arguments += [f"x[{j}]" for j in space.states.get(effects[i].kind, ())]
        arguments += [text for text, _ in entries(i)]
        return f"{name}_{i}({', '.join(arguments)})"

    def add_rate(i: int, first: str) -> list[str]:
        """Adds the call of a state rate; returns the names of its results."""
        if effects[i].rate_by_alphadot:
            first += ", alpha_rate(flow, xdd, zdd)"
        line = f"    d{i} = {call('rate', i, first)}"
        count = len(effects[i].states)
        own = entries(i)
        if skip_absent and any(c.grid and c.default not in c.grid for _, c in own):
            moved = " or ".join(f"{text} != {c.default}" for text, c in own)
            zeros = ", ".join(["0.0 * x[0]"] * count)
            line += f" if {moved} else ({zeros})"
        lines.append(line)
        return [f"d{i}"] if count == 1 else [f"d{i}[{k}]" for k in range(count)]

    for stage, terms in STAGES.items():
        if stage in ("actuator", "log"):
            continue
        # A pose shows a fault of its log too.
        stages = (stage, "log") if stage == "sensor" else (stage,)
        first = "motion" if stage == "air" else "flow"
        sums: dict[str, list[str]] = {term: [] for term in terms}
        lines.append(f"def {stage}_terms({first}, x, c, values):")
        for i, effect in enumerate(effects):
            if effect.stage not in stages:
                continue
            line = f"    e{i} = {call('formula', i, first)}"
            targets = effect.adds_to
            if skip_absent and not effect.is_free:
                sizes = [(text, c) for text, c in entries(i) if not c.is_shape]
                present = [f"{text} != {c.default}" for text, c in sizes]
                zeros = ", ".join([f"0.0 * {first}.xdot"] * len(targets))
                line += f" if {' or '.join(present)} else ({zeros})"
            lines.append(line)
            for k, term in enumerate(targets):
                sums[term].append(f"e{i}" if len(targets) == 1 else f"e{i}[{k}]")
        parts = ", ".join(" + ".join(s) if s else "0.0" for s in sums.values())
        lines.append(f"    return {parts}\n")

    # Each actuator gets the rate that the one before makes.
    actuators = [i for i, effect in enumerate(effects) if effect.stage == "actuator"]
    steps = {i: f"    rate = {call('formula', i, 'rate')}" for i in actuators}
    lines += ["def actuator_terms(rate, x, c):", *steps.values(), "    return rate\n"]
    pending = [call("pending", i) for i in actuators if effects[i].pending is not None]
    lines += [
        "def pending_terms(x, c):",
        f"    return {' + '.join(pending) or '0.0'}\n",
    ]
    others = [i for i in range(len(effects)) if i not in steps]
    for hook, given, members in (
        ("actuator_rates", "rate", actuators),
        ("effect_rates", "flow, xdd, zdd", others),
    ):
        first, *_ = given.split(",")
        lines.append(f"def {hook}({given}, x, c):")
        rates = []
        for i in members:
            if effects[i].states:
                rates += add_rate(i, first)
            lines += [steps[i]] if i in steps else []
        lines.append(f"    return ({' '.join(d + ',' for d in rates)})\n")
    return "\n".join(lines)


_SPANS = {
    "air": ("motion", "motion_variables", "0", "gaussians.num_air"),
    "body": ("flow", "flow_variables", "gaussians.num_air", "gaussians.num_flown"),
    "sensor": (
        "flow",
        "motion_variables",
        "gaussians.num_flown",
        "gaussians.weights.shape[1]",
    ),
}
"""What the free functions of a group vary with, and which Gaussians are theirs."""


def _values_source(group: str, rows: list[int]) -> str:
    """Returns Python text of the values of a group's free functions.

    Those that sensors show are never linear about a point.
    """
    first, variables, start, end = _SPANS[group]
    if not rows:
        return f"def {group}_values({first}, gaussians):\n    return ()\n"
    names = [f"v{row}" for row in rows]
    gaussian = [
        f"            v{row} = v{row} + basis * gaussians.weights[{row}, m]"
        for row in rows
    ]
    slopes = [
        f"            v{row} = v{row} + apart * gaussians.tangent[d, {1 + row}]"
        for row in rows
    ]
    at_point = [
        f"        v{row} = v{row} + gaussians.tangent[last, {1 + row}]" for row in rows
    ]
    lines = [
        f"def {group}_values({first}, gaussians):",
        f"    {' = '.join(names)} = 0.0 * {first}.xdot",
        f"    if {end} > {start}:",
        f"        variables = {variables}({first})",
        f"        for m in range({start}, {end}):",
        "            basis = basis_function(variables, gaussians, m)",
        *gaussian,
    ]
    if group != "sensor":
        lines += [
            "    if gaussians.tangent.shape[0] > 0:",
            f"        variables = {variables}({first})",
            "        last = gaussians.tangent.shape[0] - 1",
            "        for d in range(min(last, len(variables))):",
            "            apart = variables[d] - gaussians.tangent[d, 0]",
            *slopes,
            *at_point,
        ]
    lines.append(f"    return ({', '.join(names)},)\n")
    return "\n".join(lines)


def formulas(effects: tuple[EffectKind, ...]) -> dict[str, Callable]:
    """Returns the names that the text of `_hooks_source` needs."""
    names: dict[str, Callable] = {f.__name__: f for f in _OF_FREE_FUNCTIONS}
    for i, effect in enumerate(effects):
        names[f"formula_{i}"] = effect.formula
        if effect.state_rate is not None:
            names[f"rate_{i}"] = effect.state_rate
        if effect.pending is not None:
            names[f"pending_{i}"] = effect.pending
    return names


def source(effects: tuple[EffectKind, ...], skip_absent: bool = False) -> str:
    """Returns the text of the chain with these effects joined in.

    The functions that `_hooks_source` defines come last and so replace those of
    the nominal model.
    """
    return "\n\n".join([_CHAIN, _hooks_source(effects, skip_absent)])


@functools.lru_cache(maxsize=64)
def compose(effects: tuple[EffectKind, ...] = ()) -> types.SimpleNamespace:
    """The functions of the chain, `derivatives` and others, with effects joined in.

    The effects are in the order in which their coefficients follow each other in `c`.
    """
    tag = "-".join(e.kind for e in effects) or "nominal"
    filename = f"<dynamics of {tag}>"
    text = source(effects)
    linecache.cache[filename] = (len(text), None, text.splitlines(True), filename)
    names = formulas(effects)
    exec(compile(text, filename, "exec"), names)  # Our own text only.
    return types.SimpleNamespace(**{k: v for k, v in names.items() if callable(v)})


def initial_extra(space, flow, rate, c):
    """Returns the effects' own states at rest in a flow, in the state's order."""
    extra: list = []
    for name in space.states:
        effect = space.kinds[name]
        if effect.steady_state is not None:
            first = rate if effect.stage == "actuator" else flow
            own = [c[slot - NUM_PARAMETERS] for slot in space.slots_of(name)]
            value = effect.steady_state(first, *own)
            extra.extend(value if isinstance(value, tuple) else (value,))
    return extra
