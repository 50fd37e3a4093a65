"""Shapers for a 3D printer from its accelerometer: Klipper's choice, why, and a better one.

Read a measured spectrum or a raw record, let Klipper's own method choose, then tune a shaper on the same spectrum::

    spectra = calibration.read("resonances_x.csv")             # one file or several that must share a shaper
    fits = calibration.fit_all(spectra)                        # Klipper's five, each at its best frequency
    choice = calibration.recommend(fits)                       # and what each alternative costs
    stock = calibration.tune_firmware(spectra, vibration=choice.best.vibration)   # Klipper's own, parameters tuned
    stock.rated.name, stock.rated.frequency, stock.rated.zeta                     # as its configuration takes them
    offer = calibration.tune(spectra, vibration=choice.best.vibration, duration=0.0144)
    offer.shaper, offer.message, offer.rated.smoothing, offer.rated.vibration, offer.finer, offer.simulated
    calibration.calibrate(spectra)                             # all of this at once

Klipper's numbers are those of its August 2026 state (``version="current"``) and of December 2024 (``"2024"``).
Smoothing is in mm, accelerations in mm/s², frequencies in Hz, as printer owners know them; impulse times in s.
Modules are loaded when they are first used: other files need Klipper's shapers alone.

- ``report``: ``calibrate``: all of it; begin here.
- ``files``: ``read``: Klipper's files.
- ``spectrum``: power density over frequency, as Klipper computes it.
- ``smoothing``: how much (mm) a shaper rounds a corner, and the acceleration that keeps it small.
- ``score``: residual vibration, smoothing and score of a shaper on spectra.
- ``fit``: Klipper's shapers, each at the frequency that Klipper gives it.
- ``recommend``: which of them Klipper chooses, and why.
- ``family``: ``tune_firmware``: the best shaper that the firmware can compute.
- ``tuned``: ``tune``: amplitudes and times tuned on the spectra.
- ``modes``: modes of a spectrum, and a simulation beside its sums.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
