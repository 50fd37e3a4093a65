"""The move that the kernel's benchmarks share: the papers' plant (m1 = 1, k1 = 10, k3 = 100), 1 m, three impulses."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp

import jshape as js

K1, K3 = 10.0, 100.0
AMPLITUDES = np.array([0.25, 0.5, 0.25])
TIMES = np.array([0.0, 0.8214899715396663, 1.6429799430793326])
LEVELS = np.cumsum(AMPLITUDES)[:-1]
GAPS = np.diff(TIMES)


def energy(mass, amplitudes, times, steps, method="dopri8"):
    """One plant's residual energy, J."""
    plant = js.plants.TwoMass(m2=mass, spring=js.plants.Duffing(K1, K3))
    return js.residual_energy(plant, js.Shaper(amplitudes, times), 1.0, steps=steps, method=method)


@functools.partial(jax.jit, static_argnums=(1, 2))
def energies(masses, steps: int | None, method: str = "dopri8"):
    """The energies as a user writes them: ``vmap`` of ``js.residual_energy``."""
    return jax.vmap(lambda m: energy(m, AMPLITUDES, TIMES, steps, method))(masses)


def mean_energy(energy, masses, derive=lambda function: function, constant: bool = False):
    """The compiled mean of ``energy(mass, amplitudes, times)``, derived, as a function of amplitudes and times; the
    masses are its constants or its arguments."""

    def mean(masses, amplitudes, times):
        return jnp.mean(jax.vmap(energy, in_axes=(0, None, None))(masses, amplitudes, times))

    def derived(masses, amplitudes, times):
        return derive(functools.partial(mean, masses))(amplitudes, times)

    return jax.jit(functools.partial(derived, masses)) if constant else functools.partial(jax.jit(derived), masses)


def scipy_energy(mass: float, method: str, tolerance: float) -> float:
    """The same by SciPy, on equations of its own."""
    state = np.zeros(2)
    for level, gap in zip(LEVELS, GAPS, strict=True):

        def field(t, y, level=level):
            x = y[0] - level
            return [y[1], -(K1 * x + K3 * x**3) / mass]

        state = solve_ivp(field, (0, gap), state, method=method, rtol=tolerance, atol=tolerance).y[:, -1]
    x = state[0] - 1
    return mass * state[1] ** 2 / 2 + K1 * x**2 / 2 + K3 * x**4 / 4
