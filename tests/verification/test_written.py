"""A written proof, and the program that verifies it without this package."""

import copy
import dataclasses
import gzip
import importlib.util
import json
import subprocess
import sys

import numpy as np
import pytest

from glider.__main__ import main
from glider.errors import InputError
from glider.paths import PACKAGE, models_path
from glider.physics.effects import KINDS, Effect
from glider.physics.servo import STOPPING_TIME
from glider.physics.state import ELEVATOR
from glider.planning.problem import PerchingProblem
from glider.verification.dynamics.nominal import open_loop_rates
from glider.verification.funnel.funnel import save_funnel
from glider.verification.proof import check, exact_check, written

PROGRAM = PACKAGE.parent / "tools" / "verify_proof.py"


@pytest.fixture(scope="module")
def verifier():
    """The program, as a module."""
    spec = importlib.util.spec_from_file_location("verify_proof", PROGRAM)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def alone(funnel, k):
    """Returns a funnel of one interval."""
    piece = funnel.between(k, k + 1)
    times = piece.nominal.times - piece.nominal.times[0]
    return dataclasses.replace(
        piece, nominal=dataclasses.replace(piece.nominal, times=times)
    )


def proof_of(piece, path):
    """Returns the lines of a proof, from where its flight begins to where it ends."""
    written.write_proof(path, piece, PerchingProblem())
    text = gzip.decompress(path.read_bytes()).decode()
    found = [json.loads(line) for line in text.splitlines()]
    first, last = piece.nominal.states
    found[0] |= {"launch": first.tolist(), "goal": [9.0] * 7, "reach": 10.0}
    found[0]["wire"] = last[:2].tolist()
    return found


@pytest.fixture(scope="module")
def piece(proven):
    return alone(proven, 75)


@pytest.fixture(scope="module")
def lines(piece, tmp_path_factory):
    return proof_of(piece, tmp_path_factory.mktemp("proof") / "proof.json.gz")


@pytest.fixture(scope="module")
def late(proven, tmp_path_factory):
    """Where the sets contain states in which the tail is nearly at rest in the air."""
    path = tmp_path_factory.mktemp("late") / "proof.json.gz"
    return proof_of(alone(proven, 150), path)


def save(path, lines):
    text = "".join(json.dumps(line) + "\n" for line in lines)
    path.write_bytes(gzip.compress(text.encode()))
    return path


@pytest.fixture
def run(tmp_path):
    """Runs the program on lines, or on bytes."""

    def run(lines):
        path = tmp_path / "proof.json.gz"
        if isinstance(lines, bytes):
            path.write_bytes(lines)
        else:
            save(path, lines)
        command = [sys.executable, "-P", PROGRAM, path]
        return subprocess.run(
            command, capture_output=True, text=True, cwd=tmp_path, check=False
        )

    return run


def test_a_proven_interval_is_verified(run, lines):
    done = run(lines)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Proven: every flight that starts in the inlet stays" in done.stdout
    assert "mass 0.08" in done.stdout


def test_what_the_theorem_depends_on_is_printed(
    verifier, lines, tmp_path, monkeypatch, capsys
):
    """A wire elsewhere, or a servo without limits, does not look like the real one."""
    monkeypatch.setattr(verifier, "verify_interval", lambda *given: 1)

    def print_of(lines):
        path = save(tmp_path / "proof.json.gz", lines)
        monkeypatch.setattr(sys, "argv", [PROGRAM, str(path)])
        verifier.main()
        return capsys.readouterr().out

    printed, (header, *rest) = print_of(lines), lines
    for key, value in (("wire", [0.01, 0.0]), ("reach", 0.3), ("funnel", "\x1b[2J")):
        other = print_of([header | {key: value}, *rest])
        assert other.isprintable() or "\x1b" not in other
        assert other != printed, key
    parameters = header["parameters"] | {"elevator_rate_limit": 14.0}
    assert print_of([header | {"parameters": parameters}, *rest]) != printed


@pytest.mark.parametrize(("count", "code"), [("2", 0), ("1", 2), ("0", 1), ("-5", 1)])
def test_a_sample_of_the_intervals_is_no_proof(
    verifier, lines, tmp_path, monkeypatch, count, code
):
    path = tmp_path / "proof.json.gz"
    save(path, lines)
    header, knots, intervals = verifier.read_proof(path)
    found = header, knots, [*intervals, *intervals]
    monkeypatch.setattr(verifier, "read_proof", lambda path: found)
    monkeypatch.setattr(verifier, "verify_interval", lambda *given: 1)
    monkeypatch.setattr(sys, "argv", [PROGRAM, str(path), "--intervals", count])
    assert verifier.main() == code


@pytest.mark.parametrize("name", ["air_density", "wing_area"])
def test_numbers_that_doubles_may_lose_are_refused(run, lines, name):
    header, *rest = lines
    parameters = header["parameters"] | {name: 1e-165}
    done = run([header | {"parameters": parameters}, *rest])
    assert done.returncode == 1
    assert "too small" in done.stdout


@pytest.mark.nightly
def test_a_late_interval_is_verified(run, late):
    done = run(late)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.nightly
def test_bounds_that_r_exceeds_are_refused(run, proven, tmp_path):
    """The largest |R| found there is 0.93 of the bound; Gram matrices are for 0.7."""
    piece = alone(proven, 150)
    forged = dataclasses.replace(piece, beta=0.7 * piece.beta)
    done = run(proof_of(forged, tmp_path / "proof.json.gz"))
    assert done.returncode == 1, done.stdout + done.stderr
    assert "R exceeds its bound" in done.stdout


def remainder(verifier, lines):
    """Returns the last ball of a proof of one interval, and its bound of R."""
    header, knots, given = lines
    glider = verifier.Glider(header)
    knots = {
        name: verifier.array(knots[name], (2, *shape))
        for name, shape in verifier.KNOTS.items()
    }
    ends = zip(knots["states"], knots["inputs"], strict=True)
    P = [verifier.taylor_of(glider, *end) for end in ends]
    span, ball = list(verifier.tile(given["balls"], "balls"))[-1]
    basis = verifier.array(ball["basis"], (6, 6))
    return verifier.Remainder(verifier.Interval(knots, 0, P), glider, span, basis)


def interval_of(verifier, lines, **changes):
    """The polynomials of a proof of one interval, with some values at its ends."""
    knots = {
        name: verifier.array(lines[1][name], (2, *shape))
        for name, shape in verifier.KNOTS.items()
    }
    own = {
        name: verifier.array([float(v) for v in values], (2,))
        for name, values in changes.items()
    }
    return verifier.Interval(knots | own, 0, ([], []))


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("limit", ["rate", "stop"])
def test_each_limit_of_the_servo_counts_alone(verifier, lines, piece, limit, sign):
    """Where others are far: what the sets need."""
    inputs, along = np.full(2, 2.0 * sign), piece.nominal.gains
    middle, far = inputs, 1000
    if limit == "stop":
        along = np.eye(7)[ELEVATOR] - STOPPING_TIME * along
        middle = piece.nominal.states[:, ELEVATOR] + STOPPING_TIME * inputs
    reach = np.sqrt(np.einsum("ti,tij,tj->t", along, np.linalg.inv(piece.S), along))
    needed = float(np.max(sign * middle + reach))
    glider = verifier.Glider(lines[0])
    interval = interval_of(verifier, lines, inputs=inputs)
    for room, kept in ((0.01, True), (-0.01, False)):
        glider.rate, glider.low, glider.high = far, -far, far
        name = "rate" if limit == "rate" else ("high" if sign > 0 else "low")
        bound = verifier.rational(needed + room * float(reach.max()))
        setattr(glider, name, -bound if name == "low" else bound)
        if kept:
            interval.check_sets(glider)
        else:
            with pytest.raises(verifier.Fault, match="would meet its limits"):
                interval.check_sets(glider)


def test_a_defect_needs_its_slack(verifier, lines, piece):
    """Of a command that the elevator does not follow: 2 |d| √S."""
    off = 0.1
    interval = interval_of(verifier, lines, inputs=piece.nominal.inputs + off)
    most, least = (of(piece.S[:, ELEVATOR, ELEVATOR]) for of in (np.max, np.min))
    interval.check_slack(verifier.rational(1.01 * 2.0 * off * float(np.sqrt(most))))
    with pytest.raises(verifier.Fault, match="defect exceeds the slack"):
        interval.check_slack(
            verifier.rational(0.99 * 2.0 * off * float(np.sqrt(least)))
        )


@pytest.mark.parametrize("half", [0.5, 0.125, 0.03125])
def test_boxes_enclose_the_physics_of_the_package(verifier, late, proven, half):
    """In the middle of the time, in boxes on all sides, near rest too."""
    bound, model = remainder(verifier, late), proven.nominal.model
    rng = np.random.default_rng(0)
    exponents = np.array(verifier.monomials().exponents)
    nearest = []
    for center in rng.uniform(-0.6, 0.6, size=(60, 6)):
        found = bound._rates(list(center), [half] * 6)
        for v in rng.choice([-1.0, -0.3, 0.7, 1.0], size=(20, 6)):
            s = rng.choice([-1.0, 0.0, 1.0])
            y = np.array(bound.path) @ s ** np.arange(4)
            y += np.array(bound.basis) @ (center + half * v)
            rates = open_loop_rates(model, [0.0, 0.0, *y[:-1]], y[-1])
            values = np.prod(np.append(v, s) ** exponents, axis=1)
            for true, jet in zip(rates[4:], found, strict=True):
                off = abs(values @ jet.coefficients - true)
                assert off <= jet.rest + 1e-9
                nearest.append(off / jet.rest)
    assert max(nearest) > 0.05, "the bounds are not tight enough to be tested"


def test_boxes_that_are_left_are_bounded_in_both_halves_of_the_time(
    verifier, monkeypatch
):
    seen = []

    class Remainder:
        boxes = 1

        def __init__(self, interval, glider, span, basis):
            self.span = span

        def cover(self, boxes):
            seen.append((self.span, boxes))
            return ["late"] if self.span[1] - self.span[0] > 0.25 else []

    monkeypatch.setattr(verifier, "Remainder", Remainder)
    assert verifier.bound_remainder(None, None, (0.0, 1.0), None, ["all"]) == 7
    ends = [span for span, boxes in seen if span[1] - span[0] == 0.25]
    assert ends == [(0.0, 0.25), (0.25, 0.5), (0.5, 0.75), (0.75, 1.0)]
    assert [boxes for _, boxes in seen] == [["all"]] + 6 * [["late"]]
    with pytest.raises(verifier.OpenFault):
        verifier.bound_remainder(None, None, (0.0, 1.0), None, ["all"], 1)


@pytest.mark.parametrize("name", ["length", "near rest", "sine", "cosine", "product"])
def test_functions_of_polynomials_are_enclosed(verifier, name):
    rng, shares = np.random.default_rng(1), []
    exponents = np.array(verifier.monomials().exponents)
    size = {"length": 0.3, "near rest": 3.0}.get(name, 0.7)
    for _ in range(40):
        a, b = rng.normal(size=(2, len(exponents)))
        # Few terms, which are largest together; in half of the cases linear.
        few = rng.integers(1, rng.choice([7, len(exponents)]), size=3)
        for c in (a, b):
            c[np.setdiff1d(np.arange(1, len(c)), few)] = 0.0
            c[1:] *= rng.uniform(0.1, 1.0) * size / np.abs(c[1:]).sum()
            c[0] = 1.0 if name == "length" else c[0]
        jets = [verifier.Jet(list(c), 0.0, 10.0) for c in (a, b)]
        v = rng.choice([-1.0, 1.0], size=(200, 7))
        x, y = np.array([a, b]) @ np.prod(v[:, None] ** exponents, axis=2).T
        if name == "product":
            found, true = jets[0] * jets[1], x * y
        elif name in ("sine", "cosine"):
            found = verifier.sine_and_cosine(jets[0])[name == "cosine"]
            true = np.cos(x) if name == "cosine" else np.sin(x)
        else:
            found, true = verifier.length(*jets, 1e-8), np.sqrt(x * x + y * y + 1e-8)
        value = np.prod(v[:, None] ** exponents, axis=2) @ found.coefficients
        shares.append(np.abs(value - true).max() / found.rest)
    assert max(shares) <= 1.0
    assert max(shares) > 0.3, "the bound is too wide for a test"


def test_it_is_independent_of_the_package():
    code = (
        f"import runpy, sys; runpy.run_path({str(PROGRAM)!r}); "
        "print([m for m in sys.modules if m.split('.')[0] in ('glider', 'numpy')])"
    )
    command = [sys.executable, "-P", "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "[]", done.stderr


def scale(name, factor):
    def change(header, knots, interval):
        def scaled(value):
            return (
                list(map(scaled, value)) if isinstance(value, list) else value * factor
            )

        knots[name] = scaled(knots[name])

    return change


def wider(header, knots, interval):
    scale("S", 0.97)(header, knots, interval)
    scale("S_slopes", 0.97)(header, knots, interval)


def other_gram(header, knots, interval):
    interval["parts"][0]["grams"][2][9][3] += 64


def not_definite(header, knots, interval):
    """The same polynomial: z0^2 z6^2 from elsewhere."""
    gram = interval["parts"][0]["grams"][2]
    gram[6][-1] -= 2**36
    gram[27][7] += 2**35


def other_multiplier(header, knots, interval):
    interval["parts"][0]["multiplier"][1][2][2] += 2**36


def no_number(header, knots, interval):
    knots["beta"][0][4] = float("nan")


def huge_number(header, knots, interval):
    knots["beta"][0][4] = 10**400


def heavier(header, knots, interval):
    header["parameters"]["mass"] = 0.09


def windy(header, knots, interval):
    header["wind"] = [-0.3, 0.0]


def late_balls(header, knots, interval):
    interval["balls"][0]["span"][0] = 0.125


def short_balls(header, knots, interval):
    interval["balls"][-1]["span"][1] = 0.875


def no_balls(header, knots, interval):
    interval["balls"] = []


def small_ball(header, knots, interval):
    for ball in interval["balls"]:
        ball["basis"] = [[0.98 * value for value in row] for row in ball["basis"]]


def hole_in_parts(header, knots, interval):
    interval["parts"][0]["span"][0] = 0.5


def no_slack(header, knots, interval):
    interval["slack"] = 0.0


def renamed(header, knots, interval):
    interval["interval"] = 1


def elsewhere(header, knots, interval):
    header["launch"][1] += 0.01


def far_wire(header, knots, interval):
    header["wire"][0] += 2.0


def small_goal(header, knots, interval):
    header["goal"][6] = 0.1


def skew(header, knots, interval):
    knots["S"][0][0][1] *= 1.001


def negative(header, knots, interval):
    knots["weights"][0][4] *= -1.0


def other_effects(header, knots, interval):
    header["beyond"] = "servo_lag"


FORGED = {
    "smaller bounds": (scale("beta", 0.5), ""),
    "no bounds": (scale("beta", 0.0), "a bound of R is zero"),
    "larger sets": (wider, ""),
    "other gains": (scale("gains", 1.3), ""),
    "another Gram matrix": (other_gram, "a Gram matrix is not that of V'"),
    "a Gram matrix that is not definite": (not_definite, "does not prove that V"),
    "another multiplier": (other_multiplier, "a Gram matrix is not that of V'"),
    "NaN": (no_number, "is no finite number"),
    "a number of 401 digits": (huge_number, "no finite number"),
    "a heavier glider": (heavier, ""),
    "a wind": (windy, ""),
    "balls that start late": (late_balls, "the balls leave a hole at 0"),
    "balls that end early": (short_balls, "the balls end at 7/8"),
    "no balls": (no_balls, "there are no balls"),
    "a ball 2 % smaller": (small_ball, "a ball does not contain the sets"),
    "a hole between parts": (hole_in_parts, "leave a hole at 0"),
    "no slack": (no_slack, "defect exceeds the slack"),
    "a wrong interval": (renamed, "not all 1 intervals are there"),
    "another launch": (elsewhere, "does not start at the launch"),
    "another wire": (far_wire, "not within the hook's reach"),
    "a smaller goal": (small_goal, "the last set is not within the goal"),
    "a set of two triangles": (skew, "S is not symmetric"),
    "a negative weight": (negative, "is negative"),
    "other effects": (other_effects, "this program knows no 'servo_lag'"),
}


@pytest.mark.parametrize("name", FORGED)
def test_forged_proofs_are_refused(run, lines, name):
    change, words = FORGED[name]
    forged = copy.deepcopy(lines)
    change(*forged)
    done = run(forged)
    assert done.returncode == 1, done.stdout + done.stderr
    assert done.stdout.splitlines()[-1].startswith("Not proven: ")
    assert words in done.stdout
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 0.999])
def test_truncated_files_are_refused(run, lines, tmp_path, share):
    content = save(tmp_path / "whole", lines).read_bytes()
    done = run(content[: int(share * len(content))])
    assert done.returncode == 1
    assert done.stdout.startswith("Not proven: ")
    assert done.stderr == ""


def test_an_interval_that_was_removed_is_missed(run, lines):
    done = run(lines[:-1])
    assert done.returncode == 1
    assert "not all 1 intervals are there" in done.stdout


def test_its_physics_is_that_of_the_package(verifier, lines, proven):
    """Two independent texts; beside the nominal and in a wind."""
    glider = verifier.Glider(lines[0])
    nominal = proven.nominal
    state, command = nominal.states[75], nominal.inputs[75]
    found = verifier.taylor_of(
        glider, list(map(verifier.rational, state)), verifier.rational(command)
    )
    ours = nominal.open_loop[75]
    for row, coefficients in zip(ours[4:], found, strict=True):
        slopes = [float(verifier.arb(c)) for c in coefficients[:6]]
        assert slopes == pytest.approx(row[3:9].tolist(), rel=1e-12, abs=1e-12)


def test_other_gliders_are_refused_in_a_sentence(tmp_path, proven):
    model = proven.nominal.model
    kind = next(kind for name, kind in KINDS.items() if name != "wind")
    effect = Effect(kind=kind, values=(0.01,) * len(kind.coefficients))
    model = dataclasses.replace(model, effects=(effect,))
    other = dataclasses.replace(
        proven, nominal=dataclasses.replace(proven.nominal, model=model)
    )
    with pytest.raises(InputError, match="this model has other effects"):
        written.write_proof(tmp_path / "proof.json.gz", other, PerchingProblem())


def test_the_command_line_writes_what_it_has_proven(
    tmp_path, piece, capsys, monkeypatch
):
    funnel, path = tmp_path / "funnel.npz", tmp_path / "proof.json.gz"
    save_funnel(funnel, piece)
    monkeypatch.setattr(check.purpose, "problem_faults", lambda *given: [])
    monkeypatch.setattr(exact_check, "_within_goal", lambda funnel: True)
    command = ["check-funnel", str(funnel), "--prove", "--write-proof", str(path)]
    assert main(command) == 0
    assert "1 intervals" in capsys.readouterr().out
    assert len(gzip.decompress(path.read_bytes()).splitlines()) == 3


def test_what_cannot_be_written_is_refused_before_it_is_proven(tmp_path, capsys):
    funnel = models_path("funnels", "disturbed_hook.npz")
    path = tmp_path / "proof.json.gz"
    command = ["check-funnel", str(funnel), "--prove", "--write-proof", str(path)]
    assert main(command) == 2
    out, complaint = capsys.readouterr()
    assert not out
    assert "--write-proof is for a loop without disturbances." in complaint


def test_a_box_shrinks_to_no_less_than_what_of_it_is_in_the_ball(verifier):
    rng, unit = np.random.default_rng(0), 1 << verifier.GRID
    missed = shrunk = 0
    for _ in range(300):
        half = rng.integers(1, unit, 6)
        center = rng.integers(-unit, unit + 1, 6)
        low, high = np.maximum(center - half, -unit), np.minimum(center + half, unit)
        points = rng.uniform(low, high, (3000, 6))
        points = points[(points**2).sum(axis=1) <= unit**2]
        box = verifier.in_ball(center.tolist(), half.tolist())
        if box is None:
            missed += 1
            assert not len(points)
            continue
        assert np.all(np.abs(points - box[0]) <= box[1])
        shrunk += np.prod(box[1]) < 0.5 * np.prod(half)
    assert missed > 30 and shrunk > 30


def test_halves_of_a_box_cover_it(verifier):
    """Of any width on the grid, also an odd one."""
    halves, axis = [], 2

    class Remainder(verifier.Remainder):
        def __init__(self):
            self.boxes, self.table = 0, verifier.fmpz_mat([[0]] * 84)

        def _examine(self, c, h, claims, values):
            halves.append((c, h))
            blame = [0.0] * 7
            blame[axis] = 1.0
            return claims if len(halves) == 1 else [], blame

    Remainder().cover([((10, 20, 30, 40, 50, 60), (7, 7, 7, 7, 7, 7), ["one"])])
    (low, half_low), (high, half_high) = sorted(halves[1:])
    assert low[axis] - half_low[axis] <= 23
    assert low[axis] + half_low[axis] >= high[axis] - half_high[axis]
    assert high[axis] + half_high[axis] >= 37
