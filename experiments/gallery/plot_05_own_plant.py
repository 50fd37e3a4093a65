"""
A plant of one's own
====================

A plant takes ten lines: its parameters, what drives it, its equation of motion, its energy, and where it rests. Then
everything works with it: tuning by exact gradients, sweeps, environments.
"""

import jax
import jax.numpy as jnp
import numpy as np

import jshape as js

jax.config.update("jax_enable_x64", True)


class SinhMass(js.plants.AbstractPlant):
    """A mass on a spring whose force grows as sinh: m x'' + k sinh(x − u) = 0, with u the position of the base."""

    m: jax.Array
    k: jax.Array
    drive = "displacement"

    def vector_field(self, t, state, inputs):
        x, v = state
        return jnp.stack([v, -self.k / self.m * jnp.sinh(x - inputs)])

    def residual_energy(self, state, inputs):
        x, v = state
        return self.m * v**2 / 2 + self.k * (jnp.cosh(x - inputs) - 1)

    def rest_state(self, inputs):
        return jnp.stack([inputs, 0.0 * inputs])


# %%
# A shaper of linear theory is for small swings; over two metres this spring is stiffer.
plant = SinhMass(jnp.asarray(1.0), jnp.asarray(10.0))
linear = js.design.linear.zv(float(plant.natural_frequency()))
solution = js.tune(plant, 2.0, impulses=2)
shapers = {"linear ZV": linear, "tuned": solution.shaper}
left = {name: float(js.residual_energy(plant, shaper, 2.0)) for name, shaper in shapers.items()}
for name, shaper in shapers.items():
    print(f"{name}: {shaper}, {left[name]:.3g} J")

# %%
# The payload over time.
runs = {name: js.simulate(plant, 2.0, shaper, horizon=4.0) for name, shaper in shapers.items()}
axes = js.plot.response(runs, names=("base", "payload"))
print(f"payload at the end: {np.asarray(runs['tuned'].payload)[-1]:.6f} m")
