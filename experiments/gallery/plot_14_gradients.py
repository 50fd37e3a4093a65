"""
Gradients of anything
=====================

Plants, shapers and commands are pytrees, and every result is a differentiable function of them. Here the residual
energy is differentiated by the payload, the amplitudes and the times at once, and compared with differences.
"""

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

import jshape as js

jax.config.update("jax_enable_x64", True)

closed = js.design.energy.three_impulse(js.plants.TwoMass(spring=js.plants.Duffing(10.0, 100.0)), 1.0)


def energy(m2, amplitudes, times):
    """The residual energy of a move of 1 m, J."""
    plant = js.plants.TwoMass(m2=m2, spring=js.plants.Duffing(10.0, 100.0))
    return js.residual_energy(plant, js.Shaper(amplitudes, times), 1.0)


value, slopes = jax.value_and_grad(energy, argnums=(0, 1, 2))(1.1, closed.amplitudes, closed.times)
print(f"energy {value:.6f} J, by the payload {slopes[0]:.6f} J/kg")
print("by the times (J/s):", np.asarray(slopes[2]))

# %%
# Central differences agree.
step = 1e-5
difference = (
    energy(1.1 + step, closed.amplitudes, closed.times) - energy(1.1 - step, closed.amplitudes, closed.times)
) / (2 * step)
print(f"differences: {difference:.6f} J/kg")

# %%
# Thousands of payloads are one ``vmap``: the energy, and its slope.
masses = jnp.linspace(0.6, 1.4, 401)
energies, along = jax.vmap(jax.value_and_grad(energy), in_axes=(0, None, None))(masses, closed.amplitudes, closed.times)
with plt.style.context(js.plot.STYLE):
    figure, (above, below) = plt.subplots(2, 1, sharex=True, figsize=(3.5, 3.2))
    js.plot.curves([("energy", masses, energies)], ("", "residual energy (J)"), ax=above)
    axis = js.plot.curves([("slope", masses, along)], ("payload (kg)", "its slope (J/kg)"), ax=below)
