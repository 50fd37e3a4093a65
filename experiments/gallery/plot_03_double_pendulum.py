"""
A double pendulum has two modes
===============================

A hook and a payload below it swing as two pendulums. A shaper for the slow mode alone leaves the fast one; the
convolution of two shapers removes both.
"""

import jax
import numpy as np

import jshape as js

jax.config.update("jax_enable_x64", True)

plant = js.plants.DoublePendulumCrane(hook_length=3.0, payload_length=1.2, hook_mass=50.0, payload_mass=150.0)
slow, fast = (float(w) for w in plant.natural_frequency())
print(f"modes at {slow:.3f} and {fast:.3f} rad/s")
one = js.design.linear.zv(slow)
both = one.convolve(js.design.linear.zv(fast))

# %%
# A fast trolley excites both modes.
move = js.Trapezoid(3.0, speed=1.5, acceleration=3.0)
shapers = {"unshaped": js.Shaper([1.0], [0.0]), "slow mode": one, "both modes": both}
energies = {name: float(js.residual_energy(plant, shaper, move)) for name, shaper in shapers.items()}
for name, energy in energies.items():
    print(f"{name}: {energy:.4g} J")

# %%
# The sway of the payload, in millimetres.
runs = {name: js.simulate(plant, move, shaper.pad(4), horizon=12.0) for name, shaper in shapers.items()}
axis = js.plot.curves(
    [(name, run.times, 1000 * np.asarray(run.deflection)) for name, run in runs.items()], ("time (s)", "sway (mm)")
)
