"""
The worst case, the mean, and the tail
======================================

For an uncertain payload a shaper can be best in the worst case, on average, or in the mean of the worst tenth (the
conditional value at risk). Each is best by its own measure.
"""

import jax
import jax.numpy as jnp
import numpy as np

import jshape as js

jax.config.update("jax_enable_x64", True)

plant = js.plants.TwoMass(m2=1.0, spring=js.plants.Duffing(k1=10.0, k3=100.0))
over = {"m2": jnp.linspace(0.8, 1.2, 40)}
objectives = ("worst", "mean", "cvar")
solutions = {
    name: js.tune(plant, 1.0, impulses=3, duration=1.6, over=over, objective=name, starts=4) for name in objectives
}

# %%
# Every design by every measure, over the payloads for which it was tuned.
found = js.sweep(plant, {name: each.shaper for name, each in solutions.items()}, 1.0, over, "residual_energy")
energies = {name: np.sort(found.residual_energy.sel(shaper=name).values) for name in objectives}
tenth = len(over["m2"]) // 10
measured = {
    "worst": {name: values[-1] for name, values in energies.items()},
    "mean": {name: values.mean() for name, values in energies.items()},
    "cvar": {name: values[-tenth:].mean() for name, values in energies.items()},
}
for measure, row in measured.items():
    print(f"{measure} (J):", ", ".join(f"{value:.6f} tuned for {name}" for name, value in row.items()))

# %%
# The energy against the payload.
axis = js.plot.sweep(found)
