"""Checks of the compiler, of Drake, its solvers and Meshcat: each is tried."""

import importlib.metadata
import re
import urllib.request
from collections.abc import Iterator

from glider.doctor.finding import Finding, fails, look, works

_SOLVERS = ("Snopt", "Ipopt", "Clarabel", "Csdp", "Scs")
"""Those that the planners (the first two) and the funnels take."""

_NEEDED = ("Snopt", "Ipopt", "Clarabel")
_TIMEOUT = 5.0  # Seconds that Meshcat may take to answer.


def check_compiler() -> Finding:
    """Compiles a function with numba."""
    try:
        import numba

        double = numba.njit(lambda x: 2.0 * x)
        good = double(1.5) == 3.0
    except Exception as error:  # Whatever is wrong with LLVM or its libraries.
        return fails("compiler", _line(error), "pip install --force-reinstall numba")
    if not good:
        return fails("compiler", "numba computes wrong", "reinstall numba")
    return works("compiler", f"numba {numba.__version__} compiles")


def check_drake() -> Finding:
    """Imports Drake."""
    try:
        version = importlib.metadata.version("drake")
        import pydrake.common  # noqa: F401
    except Exception as error:
        advice = "pip install drake; on Linux it needs glibc 2.35 or later"
        return fails("Drake", _line(error), advice)
    return works("Drake", version)


def check_solvers() -> Iterator[Finding]:
    """Solves a small problem with each solver."""
    try:
        from pydrake import solvers
    except Exception:
        return  # Told by check_drake.
    good, bad = [], {}
    for name in _SOLVERS:
        solver = getattr(solvers, f"{name}Solver")()
        try:
            if not (solver.available() and solver.enabled()):
                bad[name.upper()] = "is not there"
                continue
            program = solvers.MathematicalProgram()
            x = program.NewContinuousVariables(1)
            program.AddBoundingBoxConstraint(1.0, 2.0, x)
            program.AddLinearCost(x[0])
            found = solver.Solve(program, None, None)
            if abs(float(found.GetSolution(x)[0]) - 1.0) < 1e-3:
                good.append(name.upper())
            else:
                bad[name.upper()] = "does not solve"
        except Exception as error:
            bad[name.upper()] = _line(error)
    if good:
        yield works("solvers", f"{', '.join(good)} solve")
    for name, words in bad.items():
        advice = "pip install --force-reinstall drake"
        if name in {needed.upper() for needed in _NEEDED}:
            yield fails(f"solver {name}", words, advice)
        else:
            yield look(f"solver {name}", words, f"{advice}, if a funnel asks for it")


def check_meshcat() -> Finding:
    """Starts Meshcat and fetches its page."""
    try:
        from pydrake.common import configure_logging
        from pydrake.geometry import Meshcat
    except Exception:
        return look("Meshcat", "needs Drake", "see Drake above")
    import logging

    configure_logging()
    logging.getLogger("drake").setLevel(logging.ERROR)  # It tells its address.
    try:
        meshcat = Meshcat()
        address = meshcat.web_url()
    except Exception as error:
        advice = "free one of the ports 7000 to 7099, which other programs hold"
        return look("Meshcat", _line(error), advice)
    port = int(re.findall(r":(\d+)", address)[-1])
    # No proxy: it is this machine.
    direct = urllib.request.build_opener(urllib.request.ProxyHandler({}))
    try:
        with direct.open(address, timeout=_TIMEOUT) as answer:
            answer.read(1)
    except OSError as error:
        advice = f"let programs connect to {address} (is there a firewall?)"
        return look("Meshcat", _line(error), advice)
    meshcat.Flush()  # It lives until here.
    taken = "" if port == 7000 else "; those before it are taken"
    return works("Meshcat", f"answers at port {port}{taken}")


def _line(error: Exception) -> str:
    """Returns what an error says, in one line that is not too long."""
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= 120 else f"{text[:120]}..."
