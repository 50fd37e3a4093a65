"""
Two parameters are uncertain
============================

Payload and stiffness are known to 20 % and 10 %. A sweep computes the residual vibration on a grid of both, and Sobol
indices say which of the two matters.
"""

import jax
import jax.numpy as jnp

import jshape as js

jax.config.update("jax_enable_x64", True)

plant = js.plants.TwoMass(m2=1.0, spring=js.plants.Duffing(k1=10.0, k3=100.0))
over = {"m2": jnp.linspace(0.8, 1.2, 21), "spring.k3": jnp.linspace(0.9, 1.1, 21)}
shapers = {
    "energy 2-impulse": js.design.energy.two_impulse(plant, 1.0),
    "energy 3-impulse": js.design.energy.three_impulse(plant, 1.0),
}

# %%
# The dataset has names and units; its greatest values are one call away.
found = js.sweep(plant, shapers, 1.0, over)
print(found.residual_vibration.max(["m2", "spring.k3"]).to_series())

# %%
# First-order indices: the share of the spread that each parameter causes alone.
indices = js.sensitivity_indices(
    plant, shapers["energy 3-impulse"], 1.0, {"m2": (0.8, 1.2), "spring.k3": (0.9, 1.1)}, samples=1024
)
print(indices)

# %%
# A panel for each shaper, with one scale of colours.
axes = js.plot.sweep(found)
