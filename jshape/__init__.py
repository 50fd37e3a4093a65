"""jshape: input shapers for any nonlinear plant, tuned by exact gradients.

Names are loaded when they are first used (``__init__.pyi`` lists them), so that the command line can answer without
waiting for JAX. Data flows down this page; a module imports only from what stands above it.

What is commanded, and what vibrates:

- ``status``: outcomes: a status to compare, a sentence to read.
- ``memory``: compiled programs freed before there are too many.
- ``compilation_cache``: compiled programs kept from one process to the next, ``js.keep_programs``.
- ``quantisation``: rounding to the steps of a converter.
- ``levenberg_marquardt``: small nonlinear least squares under ``jit`` and ``vmap``.
- ``command``: reference motions as piecewise polynomials: ``js.Step``, ``js.Trapezoid``, ``js.SCurve`` …
- ``axes``: commands of several axes, ``js.Axes``.
- ``time_optimal``: the fastest motion under limits of speed, acceleration and jerk, ``js.TimeOptimal``.
- ``shaper``: ``js.Shaper``: amplitudes and times.
- ``plants``: what vibrates, a machine a file.
- ``vibration``: V(ω, ζ) and insensitivity: linear theory without a plant.
- ``klipper``: Klipper's shapers, as that firmware computes them.
- ``kalico``: Kalico's smooth shapers.

What happens, and what to command instead:

- ``simulation``: the response, and the state after the last impulse.
- ``metrics``: residual energy and vibration, overshoot, settling time …
- ``export``: shapers and plants as files and programs for machines.
- ``sweeps``: metrics of many uncertain plants.
- ``design``: closed forms, and shapers tuned by gradients.
- ``problems``: problem files, read and checked.
- ``reports``: figures, tables, result files.

From measurements, move after move, and for people:

- ``identification``: plants from measured data.
- ``calibration``: a printer's shaper from its accelerometer.
- ``trajectories``: sampled trajectories of robots, shaped.
- ``moves``: machines that make one move after another while their payload changes.
- ``adaptive``: identification and adaptation during the motion.
- ``studio``: the page in the browser.
- ``cli``: the command line.

Modules with an underscore, such as ``_check``, serve all the others.
"""

from importlib.metadata import version

import lazy_loader

__version__ = version("jshape")
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
