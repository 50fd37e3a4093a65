"""
A crane that hoists while it drives
===================================

The cable is wound up during the move, so the crane has no fixed frequency. A shaper tuned on the crane as it is leaves
less than one that was made for the cable at the beginning.
"""

import jax

import jshape as js

jax.config.update("jax_enable_x64", True)

hoist = js.Trapezoid(-1.5, speed=0.5, acceleration=0.5)
plant = js.plants.HoistingCrane(cable_length=4.0, hoist=hoist)
move = js.Trapezoid(5.0, speed=1.0, acceleration=1.0)
linear = js.design.linear.zv(float(plant.natural_frequency()))
solution = js.tune(plant, move, impulses=2, starts=2)
shapers = {"linear ZV": linear, "tuned": solution.shaper}
left = {name: float(js.residual_energy(plant, shaper, move)) for name, shaper in shapers.items()}
for name, energy in left.items():
    print(f"{name}: {energy:.3g} J")

# %%
# The position of the payload, and its sway.
runs = {name: js.simulate(plant, move, shaper, horizon=14.0) for name, shaper in shapers.items()}
axes = js.plot.response(runs, names=("trolley", "payload"), sway="sway (m)")
