"""
A crane that hoists while it drives
===================================

The cable is wound up during the move, so the crane has no fixed frequency. The command has two axes. A shaper of the
trolley that is chosen on the crane as it is leaves less than one that was made for the cable at the beginning.
"""

import jax
import numpy as np

import jshape as js

jax.config.update("jax_enable_x64", True)

plant = js.plants.HoistingCrane(cable_length=4.0)
move = js.Axes(
    trolley=js.Trapezoid(5.0, speed=1.0, acceleration=1.0), hoist=js.Trapezoid(-1.5, speed=0.5, acceleration=0.5)
)
linear = js.design.linear.zv(float(plant.natural_frequency()))

# %%
# A shaper for the trolley alone: of all delays of two equal impulses, the one that leaves least.
delays = np.linspace(0.5, 1.5, 41) * float(linear.duration)
energies = [
    float(js.residual_energy(plant, {"trolley": js.Shaper([0.5, 0.5], [0.0, t]), "hoist": None}, move)) for t in delays
]
chosen = js.Shaper([0.5, 0.5], [0.0, float(delays[np.argmin(energies)])])
before = float(js.residual_energy(plant, {"trolley": linear, "hoist": None}, move))
print(f"made for the cable at the beginning: {linear}, {before:.3g} J")
print(f"chosen on the crane as it is:        {chosen}, {min(energies):.3g} J")

# %%
# The residual energy against the delay.
axis = js.plot.curves(
    [("two equal impulses", delays, energies)], ("delay of the second impulse (s)", "residual energy (J)")
)
axis.axvline(float(linear.duration), color="0.5", linestyle=":")
note = axis.annotate(
    "made for the cable \nat the beginning ", (float(linear.duration), max(energies)), ha="right", va="top", fontsize=7
)
