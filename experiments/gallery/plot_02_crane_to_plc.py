"""
A crane with an unknown payload, and the code for its controller
================================================================

An overhead crane has a hook of 250 kg on 6.5 m of cable, and slings of 1.5 m below it. The payload is between 1 t and
8 t, and nobody weighs it. The controller has a cycle of 10 ms. One shaper shall serve all payloads.
"""

import jax
import numpy as np

import jshape as js

jax.config.update("jax_enable_x64", True)

plant = js.plants.DoublePendulumCrane(hook_length=6.5, payload_length=1.5, hook_mass=250.0, payload_mass=4000.0)
move = js.Trapezoid(8.0, speed=1.0, acceleration=0.3)
modes = [(float(w), 0.0) for w in plant.natural_frequency()]

# %%
# The fast mode depends on the payload. Which closed form, made for the middle of the range, leaves least in the worst
# case? The nonlinear crane decides, over the whole range. (``jshape tune`` tunes one for that case; it takes longer.)
bare = js.Shaper([1.0], [0.0])
shapers = {"unshaped": bare} | {kind: js.design.linear.multi_mode(modes, kind=kind) for kind in ("zv", "zvd", "ei")}
over = {"payload_mass": np.linspace(1000.0, 8000.0, 15)}
found = js.sweep(plant, shapers, move, over, relative=False)
worst = 1000 * float(move.distance) * found.residual_vibration.max("payload_mass")
for name, shaper in shapers.items():
    print(f"{name}: {float(shaper.duration):.2f} s longer, at most {float(worst.sel(shaper=name)):.2f} mm of sway")
best = str(worst.idxmin("shaper").values)

# %%
# The function block for the controller, in IEC 61131-3 Structured Text.
code = js.export(shapers[best], "structured_text", sample_time=0.01, name="TrolleyShaper")
print(code)

axis = js.plot.sweep(found)
