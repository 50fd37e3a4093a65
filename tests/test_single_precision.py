"""What happens to someone who leaves JAX in its 32-bit mode: a warning, and answers right to about six digits."""

import subprocess
import sys

import pytest

CODE = """
import warnings
import jax.numpy as jnp
import jshape as js
from scipy.integrate import solve_ivp

duffing = js.plants.Duffing(10.0, 100.0)
plant = js.plants.TwoMass(spring=duffing)
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    shaper = js.design.energy.two_impulse(plant, 1.0)
assert any("32-bit" in str(w.message) for w in caught), caught
warnings.simplefilter("ignore")
assert shaper.times.dtype == jnp.float32
close = lambda x, y, tolerance=2e-5: abs(float(x) - y) < tolerance * abs(y)
assert close(shaper.times[1], 0.591240537428156)
damped = js.plants.TwoMass(spring=duffing, damper=js.plants.PowerDamper(0.1, 3))
assert close(js.design.energy.two_impulse(damped, 1.0).amplitudes[0], 0.5256241522156421)
lighter = js.plants.TwoMass(m2=0.8, spring=duffing)
assert close(js.residual_vibration(lighter, shaper, 1.0), 0.3014710630908722)
run = js.simulate(lighter, 1.0, shaper)
assert run.converged, run.message
assert close(run.energy[-1], 0.6609251897300579, 1e-3)
tuned = js.tune(plant, 1.0, impulses=2)
assert tuned.converged, tuned.message
assert close(tuned.shaper.times[1], 0.591240537428156, 1e-4)

worst = js.tune(plant, 1.0, 2, 0.6, over={"m2": [0.8, 1.0, 1.2]}, objective="worst", starts=2)
first, second = map(float, worst.shaper.amplitudes)


def left(m2):
    # By DOP853 in double precision.
    slope = lambda t, y: [y[1], -(10 * (y[0] - first) + 100 * (y[0] - first) ** 3) / m2]
    x, v = solve_ivp(slope, (0, float(worst.shaper.times[1])), [0, 0], "DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    z = x - first - second
    return m2 * v**2 / 2 + 5 * z**2 + 25 * z**4


apart = abs(worst.objective - max(map(left, (0.8, 1.0, 1.2))))
assert apart <= worst.error < 1e-4 and worst.error > 0, (apart, worst.error)
"""


@pytest.mark.slow
def test_single_precision_in_a_process_of_its_own():
    subprocess.run([sys.executable, "-c", CODE], check=True)
