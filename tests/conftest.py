"""What the tests share: JAX in 64 bits, the papers' plant, and SciPy as an independent judge."""

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np  # noqa: E402
import pytest  # noqa: E402
from hypothesis import settings  # noqa: E402
from problems import two_mass  # noqa: E402
from scipy.integrate import solve_ivp  # noqa: E402

from jshape import compilation_cache as programs  # noqa: E402

# The first example compiles; how long that takes is no property of the code.
settings.register_profile("jshape", deadline=None)
settings.load_profile("jshape")


@pytest.fixture(scope="module", autouse=True)
def forget_programs():
    """Each file's compiled programs go when it is done: a thousand tests' worth of them takes gigabytes."""
    yield
    jax.clear_caches()
    # A command that was run here keeps its programs; the tests after it shall compile their own.
    programs._folder = None


@pytest.fixture(scope="session")
def plant():
    """The plant of both energy papers: m1 = m2 = 1 kg, k1 = 10 N/m, k3 = 100 N/m³, no damper."""
    return two_mass()


@pytest.fixture(scope="session")
def damped():
    """The same with the cubic damper of the first paper's example, c = 0.1 N s³/m³."""
    return two_mass(c=0.1)


@pytest.fixture(scope="session")
def staircase():
    return scipy_staircase


def scipy_staircase(field, state, times, levels, at):
    """States at the instants ``at`` of y' = field(t, y, u), where u jumps to ``levels[i]`` at ``times[i]``.

    By SciPy's DOP853 at a relative tolerance of 1e-12, begun anew after every jump: shares nothing with jshape.
    """
    at, ends = np.asarray(at, float), [*np.asarray(times, float)[1:], np.inf]
    found = np.full((len(at), len(state)), np.nan)
    for begin, end, level in zip(np.asarray(times, float), ends, np.asarray(levels, float), strict=True):
        inside = (at >= begin) & (at < end)
        last = end if np.isfinite(end) else max(at.max(), begin)
        if last == begin:
            found[inside] = state
            continue
        run = solve_ivp(
            lambda t, y, u=level: field(t, y, u),
            (begin, last),
            state,
            method="DOP853",
            rtol=1e-12,
            atol=1e-14,
            dense_output=True,
        )
        assert run.success, run.message
        if inside.any():
            found[inside] = run.sol(at[inside]).T
        state = run.y[:, -1]
    return found
