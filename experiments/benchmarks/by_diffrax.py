"""The kernel's benchmark problems by diffrax, as its documentation has it: an adaptive solve between two impulses."""

import functools

import diffrax
import jax
import jax.numpy as jnp

from experiments.benchmarks.duffing import AMPLITUDES, K1, K3, TIMES


def _by_forward_mode(function, argnums):
    def both(amplitudes, times):
        return function(amplitudes, times), jax.jacfwd(function, argnums)(amplitudes, times)

    return both


ADJOINTS = {
    "reverse": (diffrax.RecursiveCheckpointAdjoint(), diffrax.Dopri8(), jax.value_and_grad),
    "forward": (diffrax.ForwardMode(), diffrax.Dopri8(scan_kind="bounded"), _by_forward_mode),
}
"""diffrax's ways to a gradient: adjoint, solver, and how value and gradient are taken."""


def _diffrax_end(field, start, amplitudes, times, parameter, step, tolerance, solver, adjoint):
    """The state at the last impulse."""
    state, level = start, 0.0
    for i in range(len(amplitudes) - 1):
        level = level + amplitudes[i]
        state = diffrax.diffeqsolve(
            diffrax.ODETerm(field), solver, times[i], times[i + 1], step, state, (parameter, level), adjoint=adjoint,
            stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=tolerance),
        ).ys[-1]  # fmt: skip
    return state


def diffrax_energy(mass, amplitudes, times, tolerance, solver, adjoint):
    def field(t, y, args):
        mass, level = args
        x = y[0] - level
        return jnp.stack([y[1], -(K1 * x + K3 * x**3) / mass])

    state = _diffrax_end(field, jnp.zeros(2), amplitudes, times, mass, 0.05, tolerance, solver, adjoint)
    x = state[0] - jnp.sum(amplitudes)
    return mass * state[1] ** 2 / 2 + K1 * x**2 / 2 + K3 * x**4 / 4


@functools.partial(jax.jit, static_argnums=2)
def diffrax_energies(masses, tolerance, solver):
    """The energies as a user of diffrax writes them: ``vmap`` of an adaptive solve."""
    adjoint = diffrax.RecursiveCheckpointAdjoint()
    return jax.vmap(lambda m: diffrax_energy(m, AMPLITUDES, TIMES, tolerance, solver, adjoint))(masses)


def diffrax_modal(omega, solver, adjoint):
    """The energy of modes side by side, as a function of ratio, amplitudes and times."""
    modes = len(omega)

    def field(t, y, args):
        w, level = args
        q, v = y[:modes], y[modes:]
        return jnp.concatenate([v, w**2 * (level - q) - 0.02 * w * v])

    def modal_energy(r, a, t):
        y = _diffrax_end(field, jnp.zeros(2 * modes), a, t, omega * r, 0.02, 1e-8, solver, adjoint)
        w = omega * r
        return jnp.sum(y[modes:] ** 2 + (w * (y[:modes] - jnp.sum(a))) ** 2) / modes**2 / 2

    return modal_energy
