"""
From a measured record to a shaper
==================================

A machine is struck and its ring-down recorded. ``js.identify`` finds the modes, their number by Bayes's criterion, and
how certain they are; the result is a plant like any other. The record here is computed, with noise.
"""

import jax
import numpy as np

import jshape as js

jax.config.update("jax_enable_x64", True)

times = np.arange(0.0, 8.0, 0.005)
noise = 0.01 * np.random.default_rng(0).normal(size=times.size)
record = np.exp(-0.15 * times) * np.cos(8.5 * times) + noise

# %%
# Frequency and damping ratio with their intervals of 95 %.
found = js.identify(times, record)
low, high = found.interval(0.95)
print(f"omega {found.omega[0]:.4f} rad/s, zeta {found.zeta[0]:.5f}; 95 %: {np.ravel(low)} to {np.ravel(high)}")

# %%
# A shaper for the machine that was measured.
solution = js.tune(found.plant, 1.0, impulses=2)
print(solution.shaper)
left = float(js.percentage_vibration(solution.shaper, found.omega[0], found.zeta[0]))
print(f"vibration of the identified mode that stays: {100 * left:.2g} %")

# %%
# The record, the fit over it, and the residual.
axes = js.plot.prediction(found.axis, found.values, found.predict(), found.names)
