"""
Residual energy against the duration of the shaper
==================================================

A shaper may take more time and leave less. ``js.pareto`` tunes along that front, for two and for three impulses, and
sets the closed forms beside it.
"""

import jax
import jax.numpy as jnp

import jshape as js

jax.config.update("jax_enable_x64", True)

plant = js.plants.TwoMass(m2=1.0, spring=js.plants.Duffing(k1=10.0, k3=100.0))
front = js.pareto(
    plant, 1.0, impulses=(2, 3), durations=[0.6, 1.0, 1.4, 1.7], over={"m2": jnp.linspace(0.8, 1.2, 9)}, starts=4
)

# %%
# The worst residual energy (J) for each duration (s).
print(front.objective.to_pandas())

# %%
# The front, with the closed forms that no shorter one beats.
axis = js.plot.pareto(front)
