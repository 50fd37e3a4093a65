"""
A payload that changes unannounced
==================================

A flexible link moves to and fro; after 20 s, coins are taken from its tip. A fixed shaper goes on as before. The
strategy ``state-aware`` identifies the first mode while it moves, and begins each move with a shaper that also takes
away what the last one left.
"""

import jax
import numpy as np

import jshape as js

jax.config.update("jax_enable_x64", True)

sample_time = 0.005
schedule = js.adaptive.square_wave(0.5, 10.0, 50.0, [(0.0, 20.0), (20.0, 3.0)], sample_time)
link = js.adaptive.SampledLink(js.plants.FlexibleLink(), schedule.loads, sample_time)
names = ("unshaped", "I", "state-aware")
strategies = {name: js.adaptive.case(name, sample_time) for name in names}
traces = js.adaptive.run(link, strategies, schedule.reference, schedule.which)

# %%
# The greatest vibration of the tip in the last second of each move, in degrees.
since, move = np.asarray(schedule.since), np.asarray(schedule.move)
late = {
    name: [np.degrees(np.abs(np.asarray(traces[name].deflection)[(move == m) & (since > 4)]).max()) for m in range(10)]
    for name in names
}
for name in names:
    print(name, " ".join(f"{value:.3f}" for value in late[name]))

# %%
# The vibration over time.
times = sample_time * np.arange(len(move))
axis = js.plot.curves(
    [(name, times, np.degrees(np.asarray(traces[name].deflection))) for name in names], ("time (s)", "vibration (°)")
)
