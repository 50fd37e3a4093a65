"""
A hundred thousand plants
=========================

Payload, stiffness and hardening of the spring are random. ``js.sweep`` runs every shaper on every sample, in bounded
memory, and states how accurate it is. With ``store=`` an interrupted sweep resumes; with ``client=``, a
``dask.distributed.Client``, the workers of a cluster share the work, and the bits are the same.
"""

import jax

import jshape as js

jax.config.update("jax_enable_x64", True)

plant = js.plants.TwoMass(m2=1.0, spring=js.plants.Duffing(k1=10.0, k3=100.0))
shapers = {
    "energy 2-impulse": js.design.energy.two_impulse(plant, 1.0),
    "energy 3-impulse": js.design.energy.three_impulse(plant, 1.0),
    "energy 4-impulse": js.design.energy.robust(plant, 1.0, rests=2),
}
over = {"m2": (0.7, 1.3), "spring.k1": (0.9, 1.1), "spring.k3": (0.8, 1.2)}
found = js.sweep(plant, shapers, 1.0, over, samples=100_000)

# %%
# Mean, 95 % quantile and worst of all samples.
vibration = found.residual_vibration
print(found)
for name in shapers:
    values = vibration.sel(shaper=name)
    mean, tail, worst = (float(x) for x in (values.mean(), values.quantile(0.95), values.max()))
    print(f"{name}: mean {mean:.4f}, 95 % {tail:.4f}, worst {worst:.4f}")

# %%
# The share of the plants on which each shaper leaves more than a given vibration.
axis = js.plot.sweep(found)
