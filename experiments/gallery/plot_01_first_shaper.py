"""
A first shaper
==============

A payload on a spring is moved by one metre. Commanded at once, it swings for ever; commanded in two halves, half a
period apart, it arrives and stands still.
"""

import jax

import jshape as js

jax.config.update("jax_enable_x64", True)

# %%
# The plant: a base that follows the command, and a payload of 1 kg on a linear spring of 10 N/m.
plant = js.plants.TwoMass(m2=1.0, spring=js.plants.LinearSpring(10.0))
omega = float(plant.natural_frequency())
shaper = js.design.linear.zv(omega)
print(f"natural frequency {omega:.4f} rad/s")
print(shaper)

# %%
# What each leaves: the energy in the payload and its spring after the last impulse.
bare = js.Shaper([1.0], [0.0])
left = {name: float(js.residual_energy(plant, each, 1.0)) for name, each in (("unshaped", bare), ("ZV", shaper))}
for name, energy in left.items():
    print(f"{name}: {energy:.3g} J")

# %%
# The response of each.
runs = {"unshaped": js.simulate(plant, 1.0, horizon=6.0), "ZV": js.simulate(plant, 1.0, shaper, horizon=6.0)}
axes = js.plot.response(runs, names=("base", "payload"))
