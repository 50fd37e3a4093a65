"""What the tests share: JAX in 64 bits, checked annotations, programs on disk, the papers' plant, SciPy as a judge."""

import contextlib
import gc
import os
import resource
import sys
from pathlib import Path

# Workers and the processes that tests start find the programs that one of them has compiled. JAX knows a program by its
# code and by what compiled it, so that a changed number is another program.
PROGRAMS = Path(__file__).parents[1] / ".pytest_cache" / "programs"
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(PROGRAMS))
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.05")
os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "-1")
# The workers share the processor; the threads of one would wait for those of another.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import annotations  # noqa: E402
import jax  # noqa: E402
import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
import pytest  # noqa: E402
from hypothesis import settings  # noqa: E402
from jaxtyping import install_import_hook  # noqa: E402
from scipy.integrate import solve_ivp  # noqa: E402

jax.config.update("jax_enable_x64", True)
# As in a command: traces are hundreds of thousands of small objects, through which the collector would walk by default
# for every few hundred of them, which takes a tenth of the time.
gc.set_threshold(100_000, 50, 50)
pytest.raises = annotations.raises

# The first example compiles; how long that takes is no property of the code.
settings.register_profile("jshape", deadline=None)
settings.load_profile("jshape")

LONGEST = (
    *("simulate", "linear", "plants", "metrics", "plants_flexible", "command", "insensitive", "adaptive_loop"),
    *("plants_cranes", "envs_gym", "papers_energy", "adaptive_identifiers", "switching", "adaptive_shaper"),
    *("envs_core", "envs_learning", "components", "calibration_tuned", "sweep", "envs_baselines", "cli_sweep"),
)
"""Files that take longest, longest first: begun first, so that no worker is left alone with one at the end."""

OPTIMISED = (
    *("adaptive_loop", "local_search", "experiments_papers", "steps", "identification_files", "studio_browser"),
    *("sweep_processes", "cli", "readme", "compilation_cache", "first_call"),
)
"""Files of the slow set whose programs are optimised as a user's are: those that compute for long, longest first, and
those of commands, pages and scripts as users start them."""

SLOWEST = (
    *OPTIMISED,
    *("tune_limits", "studio", "plants_mujoco_axes", "tune_axes", "gallery", "tune", "axes", "plants_mujoco"),
    *("envs_gym", "identification_duffing", "identification"),
)
"""Likewise in the slow set."""

MOST_MEMORY = 6.0
"""GB of a process beyond which its compiled programs are dropped."""


def pytest_configure(config):
    """All programs are compiled as jshape's own are; those of most tests, whose time is compiling, optimised less.

    In the quick set, which calls everything, arrays of different ranks meet only where the code says so, and every
    annotated shape is checked at run time. The hook for that comes before jshape is first imported, and not at all for
    the slow set alone, which checks none: what it wraps around every function takes a good part of its time.
    """
    if config.option.markexpr != "slow":
        install_import_hook(["jshape", "jshape_envs"], "annotations.checked")
    if config.option.markexpr == "not slow":
        jax.config.update("jax_numpy_rank_promotion", "raise")
    from jshape._compiling import LEAN

    os.environ.setdefault("XLA_FLAGS", " ".join(f"--{name}={str(value).lower()}" for name, value in LEAN.items()))


def pytest_collection_modifyitems(config, items):
    if not hasattr(config, "workerinput"):
        # Without workers files come in the order in which they are named.
        return
    first = SLOWEST if config.option.markexpr == "slow" else LONGEST
    place = {f"test_{name}.py": i for i, name in enumerate(first)}
    items.sort(key=lambda item: place.get(item.path.name, len(place)))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item):
    """Annotations are checked in the quick set, which calls everything; not where that would take most of the time."""
    apart = item.get_closest_marker("slow") or item.get_closest_marker("unchecked")
    with annotations.unchecked() if apart else contextlib.nullcontext():
        return (yield)


def memory() -> float:
    """What this process holds now, in GB; the most that it ever held where that is not known."""
    try:
        return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 1e9
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1e3) / 1e9


@pytest.fixture(scope="module", autouse=True)
def forget_programs(request):
    """Compiled programs stay from one file to the next, as long as there is room for them."""
    less = request.config.option.markexpr == "not slow" or request.path.stem.removeprefix("test_") not in OPTIMISED
    if jax.config.values["jax_disable_most_optimizations"] != less:
        # JAX would go on with those compiled the other way until room is made for others: other bits within one test.
        jax.clear_caches()
        jax.config.update("jax_disable_most_optimizations", less)
    # The processes that its tests start give the same bits.
    os.environ["JAX_DISABLE_MOST_OPTIMIZATIONS"] = str(less)
    yield
    if memory() > MOST_MEMORY:
        jax.clear_caches()
    # A command that was run here keeps its programs; the tests after it shall compile their own.
    if cache := sys.modules.get("jshape.compilation_cache"):
        cache._folder = None


@pytest.fixture(scope="session")
def plant():
    """The plant of both energy papers: m1 = m2 = 1 kg, k1 = 10 N/m, k3 = 100 N/m³, no damper."""
    from problems import two_mass

    return two_mass()


@pytest.fixture(scope="session")
def damped():
    """The same with the cubic damper of the first paper's example, c = 0.1 N s³/m³."""
    from problems import two_mass

    return two_mass(c=0.1)


@pytest.fixture(scope="session")
def staircase():
    return scipy_staircase


def differences(function, x, ways=None, step=1e-4):
    """Derivatives of a function along ``ways`` (rows; the axes unless given), by central differences extrapolated from
    two steps: a last axis of ways."""
    x = np.asarray(x, float)

    def central(way, step):
        return (np.asarray(function(jnp.asarray(x + step * way))) - function(jnp.asarray(x - step * way))) / (2 * step)

    ways = np.eye(len(x)) if ways is None else ways
    return np.stack([(4 * central(way, step) - central(way, 2 * step)) / 3 for way in ways], axis=-1)


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
