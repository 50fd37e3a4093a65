"""
A printer's shaper from its accelerometer
=========================================

Klipper shakes the tool and records its acceleration. jshape computes Klipper's spectrum and recommendation from the
record, and tunes a shaper that leaves no more vibration with less smoothing. The record is simulated.
"""

from pathlib import Path

import jax

import jshape as js
import jshape.calibration.report as calibration
from experiments.calibration import record

jax.config.update("jax_enable_x64", True)

spectra = js.calibration.read(Path(record.__file__).parent / "raw_data_x_simulated.csv")
found = js.calibration.calibrate(spectra, starts=4)
for mode in found.modes[0]:
    print(f"mode at {mode.frequency:.1f} Hz, damping ratio {mode.zeta:.3f}")

# %%
# Klipper's choice, and why.
print(found.choice.best.label, "-", found.choice.reason)
print(found.message)

# %%
# The line to paste into ``printer.cfg``.
print(calibration.lines(found, "x"))

# %%
# Spectrum and shapers, as Klipper's users know them.
axis = next(drawn for name, drawn in calibration.figures(found) if name == "calibration")
