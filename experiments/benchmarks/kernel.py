"""The kernel beside its peers, in one run, on one thread: energies of many Duffing plants, and their gradients.

    python -m experiments.benchmarks.kernel        # a few minutes; writes kernel.json and kernel.md beside this file

Every method moves the papers' plant (m1 = 1, k1 = 10, k3 = 100) by 1 m with the same three impulses; the payload runs
from 0.6 to 1.4 kg. The default call, which chooses its steps and checks itself, comes first; then calls with steps that
were chosen by hand. Errors are the worst over all plants against this kernel with 128 steps, which in turn is held
against SciPy's DOP853 at a tolerance of 1e-13. Times are the least of several rounds, the methods taking turns. Needs
numba, casadi and heyoka besides jshape.
"""

import functools
from collections.abc import Callable
from typing import Any

import experiments.benchmarks.one_thread  # noqa: F401  # isort: skip

import diffrax
import heyoka
import jax
import jax.numpy as jnp
import numba
import numpy as np

import jshape as js
from experiments.benchmarks import duffing
from experiments.benchmarks.by_diffrax import ADJOINTS, diffrax_energies, diffrax_energy, diffrax_modal
from experiments.benchmarks.duffing import AMPLITUDES, GAPS, K1, K3, LEVELS, TIMES, energies, energy, scipy_energy
from experiments.benchmarks.record import about, keep, least, processor
from experiments.markdown import table

jax.config.update("jax_enable_x64", True)


DEFAULT = "jshape, the default call"

LANES = 32
"""Plants that heyoka integrates side by side: with fewer, calls from Python take most of its time."""


def main() -> None:
    masses = np.linspace(0.6, 1.4, 10_000)
    few = masses[:: len(masses) // 40]
    exact = np.asarray(energies(masses, 128))
    check = np.array([scipy_energy(m, "DOP853", 1e-13) for m in few])
    reference_error = float(np.max(np.abs(check - exact[:: len(masses) // 40])))
    print(f"reference: this kernel with 128 steps is within {reference_error:.1e} J of DOP853 at 1e-13")

    methods: dict[str, tuple[Callable[[np.ndarray], Any], np.ndarray]] = {
        DEFAULT: (lambda m: energies(m, None), masses),
        "jshape, dopri8, 16 steps": (lambda m: energies(m, 16), masses),
        "jshape, dopri8, 32 steps": (lambda m: energies(m, 32), masses),
        "jshape, tsit5, 32 steps": (lambda m: energies(m, 32, "tsit5"), masses),
        "numba, the same dopri8, 16 steps": (lambda m: _numba_energies(m, 16, _A, _B, LEVELS, GAPS), masses),
        f"heyoka, {LANES} plants at a time, 1e-9": (lambda m: heyoka_energies(m, 1e-9), masses),
        f"heyoka, {LANES} plants at a time, 1e-12": (lambda m: heyoka_energies(m, 1e-12), masses),
        "diffrax diffeqsolve, Dopri8, 1e-8": (lambda m: diffrax_energies(m, 1e-8, diffrax.Dopri8()), masses[::10]),
        "diffrax diffeqsolve, Dopri8, 3e-9": (lambda m: diffrax_energies(m, 3e-9, diffrax.Dopri8()), masses[::10]),
        "diffrax diffeqsolve, Tsit5, 1e-8": (lambda m: diffrax_energies(m, 1e-8, diffrax.Tsit5()), masses[::10]),
        "diffrax diffeqsolve, Tsit5, 2e-9": (lambda m: diffrax_energies(m, 2e-9, diffrax.Tsit5()), masses[::10]),
        "SciPy DOP853, 1e-8": (lambda m: [scipy_energy(x, "DOP853", 1e-8) for x in m], few),
        "SciPy LSODA, 1e-8": (lambda m: [scipy_energy(x, "LSODA", 1e-8) for x in m], few),
    }
    forward = compare(methods, lambda m: np.asarray(energies(m, 128)))
    gradient = gradients()
    cost = one_design()
    write(forward, gradient, cost, reference_error)


# --- residual energies of many plants ---------------------------------------------------------------------------------


def _heyoka_system() -> list:
    """The equation, its parameters the mass and the level of the base."""
    x, v = heyoka.make_vars("x", "v")
    z = x - heyoka.par[1]
    return [(x, v), (v, -(K1 * z + K3 * z**3) / heyoka.par[0])]


@functools.cache
def _heyoka(tolerance: float, varied: bool = False) -> Any:
    """Taylor's method for ``LANES`` plants, with its variational equations or without."""
    system: Any = _heyoka_system()
    if varied:
        system = heyoka.var_ode_sys(system, heyoka.var_args.vars | heyoka.var_args.params, order=1)
    return heyoka.taylor_adaptive_batch(system, np.zeros((2, LANES)), pars=np.ones((2, LANES)), tol=tolerance)


def heyoka_energies(masses, tolerance: float) -> np.ndarray:
    """Residual energies by heyoka, begun anew at every impulse."""
    plants, found = _heyoka(tolerance), []
    for first in range(0, len(masses), LANES):
        mass = masses[np.minimum(np.arange(first, first + LANES), len(masses) - 1)]
        plants.state[:], plants.pars[0] = 0.0, mass
        for level, gap in zip(LEVELS, GAPS, strict=True):
            plants.pars[1] = level
            plants.propagate_for(gap)
        x = plants.state[0] - 1
        found.append(mass * plants.state[1] ** 2 / 2 + K1 * x**2 / 2 + K3 * x**4 / 4)
    return np.concatenate(found)[: len(masses)]


def heyoka_gradient(masses, amplitudes, times, tolerance: float) -> tuple[float, tuple[np.ndarray, np.ndarray]]:
    """The mean residual energy and its gradient in amplitudes and times, by heyoka's variational equations."""
    plants, levels, gaps = _heyoka(tolerance, varied=True), np.cumsum(amplitudes), np.diff(times)
    total, slopes = 0.0, np.zeros(2 * len(times))
    identity = np.eye(2, 4)[:, :, None]
    for first in range(0, len(masses), LANES):
        there = np.arange(first, first + LANES) < len(masses)
        mass = masses[np.minimum(np.arange(first, first + LANES), len(masses) - 1)]
        state, by_levels, by_gaps = np.zeros((2, LANES)), np.zeros((2, 3, LANES)), np.zeros((2, 2, LANES))
        for i, gap in enumerate(gaps):
            plants.state[:2], plants.state[2:] = state, np.broadcast_to(identity, (2, 4, LANES)).reshape(8, LANES)
            plants.pars[0], plants.pars[1] = mass, levels[i]
            plants.propagate_for(gap)
            state = plants.state[:2].copy()
            moved = plants.state[2:].reshape(2, 4, LANES)
            by_levels = np.einsum("ijn,jkn->ikn", moved[:, :2], by_levels)
            by_gaps = np.einsum("ijn,jkn->ikn", moved[:, :2], by_gaps)
            by_levels[:, i] += moved[:, 3]
            x = state[0] - levels[i]
            by_gaps[:, i] = np.stack([state[1], -(K1 * x + K3 * x**3) / mass])
        x = state[0] - levels[-1]
        force, speed = K1 * x + K3 * x**3, mass * state[1]
        total += np.sum((speed * state[1] / 2 + K1 * x**2 / 2 + K3 * x**4 / 4)[there])
        along_levels = np.einsum("n,kn->kn", force, by_levels[0]) + np.einsum("n,kn->kn", speed, by_levels[1])
        along_levels[-1] -= force
        along_gaps = force * by_gaps[0] + speed * by_gaps[1]
        # A level is the sum of the amplitudes so far, a gap the difference of two times.
        along_amplitudes = np.cumsum(along_levels[::-1], axis=0)[::-1]
        along_times = -np.diff(np.pad(along_gaps, ((1, 1), (0, 0))), axis=0)
        slopes += np.concatenate([along_amplitudes, along_times])[:, there].sum(axis=1)
    return total / len(masses), tuple(np.split(slopes / len(masses), 2))


_tableau = diffrax.Dopri8.tableau
_A = np.zeros((len(_tableau.b_sol), len(_tableau.b_sol)))
for _i, _row in enumerate(_tableau.a_lower):
    _A[_i + 1, : len(_row)] = _row
_B = np.asarray(_tableau.b_sol)


@numba.njit(fastmath=True)
def _numba_energies(masses, steps, a, b, levels, gaps):
    """The same tableau, steps and segments as a loop over plants."""
    stages = len(b)
    out = np.empty(len(masses))
    kx, kv = np.empty(stages), np.empty(stages)
    for n in range(len(masses)):
        m, x, v = masses[n], 0.0, 0.0
        for segment in range(len(gaps)):
            h, level = gaps[segment] / steps, levels[segment]
            for _ in range(steps):
                for i in range(stages):
                    zx, zv = x, v
                    for j in range(i):
                        zx += h * a[i, j] * kx[j]
                        zv += h * a[i, j] * kv[j]
                    kx[i] = zv
                    kv[i] = -(10.0 * (zx - level) + 100.0 * (zx - level) ** 3) / m
                for i in range(stages):
                    x += h * b[i] * kx[i]
                    v += h * b[i] * kv[i]
        d = x - 1.0
        out[n] = m * v * v / 2 + 10.0 * d * d / 2 + 100.0 * d**4 / 4
    return out


def compare(methods, exact) -> list[dict[str, Any]]:
    """Time and error of each method, taking turns."""
    whole = least({name: functools.partial(run, masses) for name, (run, masses) in methods.items()})
    best = {name: whole[name] / len(masses) for name, (_, masses) in methods.items()}
    rows = []
    base = best[DEFAULT]
    for name, (run, masses) in methods.items():
        error = float(np.max(np.abs(np.asarray(run(masses)) - exact(masses))))
        rows.append(dict(method=name, microseconds=1e6 * best[name], ratio=best[name] / base, error=error))
        print(f"{name:40s} {1e6 * best[name]:10.3f} µs {best[name] / base:9.1f} x  {error:.1e} J")
    return rows


# --- value and gradient -----------------------------------------------------------------------------------------------


def gradients() -> list[dict[str, Any]]:
    """The mean over 1,000 plants and its gradient in all amplitudes and times; 2, 4 and 8 states.

    The plants' masses are arguments of the compiled programs, or constants of theirs, which XLA then folds.
    """
    default = [gradient_row(states, False, None) for states in (2, 4, 8)]
    return default + [gradient_row(*case, 16) for case in ((2, False), (2, True), (4, True), (8, True))]


def gradient_row(states: int, constant: bool, steps: int | None) -> dict[str, Any]:
    """One row, for a number of states, the masses constants of the programs or arguments of theirs."""
    masses, point = jnp.linspace(0.6, 1.4, 1000), (jnp.asarray(AMPLITUDES), jnp.asarray(TIMES))
    if states == 2:
        ours = functools.partial(energy, steps=steps)

        def theirs(solver, adjoint):
            return functools.partial(diffrax_energy, tolerance=1e-8, solver=solver, adjoint=adjoint)
    else:
        omega = jnp.asarray([4.0, 6.0, 8.0, 10.0][: states // 2])

        def ours(r, a, t):
            return js.residual_energy(js.plants.ModalPlant(omega * r, 0.01), js.Shaper(a, t), 1.0, steps=steps)

        theirs = functools.partial(diffrax_modal, omega)
    programs: dict[str, Callable[..., Any]] = {
        "value": duffing.mean_energy(ours, masses, constant=constant),
        "gradient": duffing.mean_energy(ours, masses, functools.partial(jax.value_and_grad, argnums=(0, 1)), constant),
    }
    for name, (adjoint, solver, derive) in ADJOINTS.items():
        both = functools.partial(derive, argnums=(0, 1))
        programs[f"diffrax {name}"] = duffing.mean_energy(theirs(solver, adjoint), masses, both, constant)
    if states == 2:
        programs["heyoka"] = lambda a, t: heyoka_gradient(np.asarray(masses), np.asarray(a), np.asarray(t), 1e-9)
    best = least({name: functools.partial(program, *point) for name, program in programs.items()})
    slopes = zip(*(programs[name](*point)[1] for name in ("gradient", "diffrax reverse")), strict=True)
    reverse, forward = (best[f"diffrax {name}"] / best["gradient"] for name in ADJOINTS)
    row = dict(
        states=states,
        masses="constants" if constant else "arguments",
        steps=steps,
        value_microseconds=1e3 * best["value"],
        gradient_microseconds=1e3 * best["gradient"],
        gradient_over_value=best["gradient"] / best["value"],
        diffrax_reverse_over_ours=reverse,
        diffrax_forward_over_ours=forward,
        best_diffrax_over_ours=min(reverse, forward),
        heyoka_over_ours=best["heyoka"] / best["gradient"] if states == 2 else None,
        gradients_differ=max(float(jnp.max(jnp.abs(x - y))) for x, y in slopes),
    )
    if states == 2:
        pairs = zip(programs["gradient"](*point)[1], programs["heyoka"](*point)[1], strict=True)
        row["heyoka_differs"] = max(float(np.max(np.abs(np.asarray(x) - y))) for x, y in pairs)
    numbers = ", ".join(f"{k} {v:.3g}" for k, v in row.items() if isinstance(v, float))
    print(f"{states} states, masses as {row['masses']}, {steps or 'default'} steps: {numbers}")
    return row


# --- one cost and gradient --------------------------------------------------------------------------------------------


def one_design() -> dict[str, Any]:
    """The force-driven Duffing mass (m = k = a = x_f = 1): cost and gradient in the first force and the time."""
    import casadi as ca

    def casadi_function(steps: int):
        x, p = ca.SX.sym("x", 2), ca.SX.sym("p", 2)
        field = ca.Function("f", [x, p], [ca.vertcat(x[1], p[0] - x[0] - x[0] ** 3)])
        y, h = ca.SX([0, 0]), p[1] / steps
        for _ in range(steps):
            k1 = field(y, p)
            k2 = field(y + h / 2 * k1, p)
            k3 = field(y + h / 2 * k2, p)
            k4 = field(y + h * k3, p)
            y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        cost = y[1] ** 2 / 2 + y[0] ** 2 / 2 + y[0] ** 4 / 4 - 2 * y[0] + 1.25
        return ca.Function("c", [p], [cost, ca.gradient(cost, p)])

    plant = js.plants.ForcedMass(1.0, js.plants.Duffing(1.0, 1.0))

    def cost(p, steps):
        share = p[0] / 2
        shaper = js.Shaper(jnp.stack([share, 1 - share]), jnp.stack([jnp.zeros_like(p[1]), p[1]]))
        return js.residual_energy(plant, shaper, 2.0, steps=steps)

    ours = jax.jit(jax.value_and_grad(cost), static_argnums=1)
    point = np.array([0.7, 2.2])
    exact = ours(point, 256)

    def error(value, slope):
        return max(abs(float(value) - float(exact[0])), float(np.max(np.abs(slope - exact[1]))))

    wanted = error(*ours(point, 8))
    steps, peer = 32, casadi_function(32)
    while error(peer(point)[0], np.array(peer(point)[1])[:, 0]) > wanted and steps < 4096:
        steps *= 2
        peer = casadi_function(steps)
    argument = jnp.asarray(point)
    best = least({"ours": lambda: ours(argument, 8), "casadi": lambda: peer(point)}, rounds=200)
    row = dict(
        ours_microseconds=1e6 * best["ours"],
        casadi_microseconds=1e6 * best["casadi"],
        casadi_over_ours=best["casadi"] / best["ours"],
        ours_steps=8,
        casadi_steps=steps,
        ours_error=wanted,
        casadi_error=error(peer(point)[0], np.array(peer(point)[1])[:, 0]),
    )
    print("one design: " + ", ".join(f"{k} {v:.3g}" for k, v in row.items()))
    return row


# --- what is kept -----------------------------------------------------------------------------------------------------


def write(forward, gradient, cost, reference_error: float) -> None:
    head = ("10,000 plants, residual energy", "µs a plant", "over jshape's", "worst error (J)")
    cells = [(r["method"], f"{r['microseconds']:.3g}", f"{r['ratio']:.3g}", f"{r['error']:.1e}") for r in forward]
    lines = [*table(head, cells), ""]
    head = (
        "1,000 plants, mean and gradient in 6 variables", "gradient, µs a plant", "over the value's",
        "diffrax's best adjoint over ours", "heyoka over ours",
    )  # fmt: skip
    cells = []
    for r in gradient:
        steps = "the default call" if r["steps"] is None else f"{r['steps']} steps"
        heyoka_over = "" if r["heyoka_over_ours"] is None else f"{r['heyoka_over_ours']:.3g}"
        cells.append((
            f"{r['states']} states, masses as {r['masses']}, {steps}", f"{r['gradient_microseconds']:.3g}",
            f"{r['gradient_over_value']:.3g}", f"{r['best_diffrax_over_ours']:.3g}", heyoka_over,
        ))  # fmt: skip
    lines += table(head, cells)
    words = f"CasADi (RK4, {cost['casadi_steps']} steps) takes {cost['casadi_over_ours']:.2g} times as long"
    lines += ["", f"One cost and gradient of the force-driven Duffing shaper: {words} at the same error."]
    packages = ("jshape", "jax", "diffrax", "heyoka", "scipy", "numba", "casadi", "numpy")
    ran = about(f"one thread of {processor()}", *packages) | dict(reference_error=reference_error)
    keep(__file__, dict(about=ran, forward=forward, gradient=gradient, one_design=cost), lines)


if __name__ == "__main__":
    main()
