"""The first call of a process, inside a user's own transformation, where jshape's rooms are still to be imported."""

import subprocess
import sys

import pytest

FIRST = """
import jax
jax.config.update("jax_enable_x64", True)
import jshape as js
left = lambda k: js.residual_energy(js.plants.TwoMass(spring=js.plants.Duffing(k, 100.0)), js.Shaper([1.0], [0.0]), 1.0)
print(float({transform}(10.0)))
"""


@pytest.mark.parametrize("transform", ["jax.jit(left)", pytest.param("jax.grad(left)", marks=pytest.mark.slow)])
def test_a_transformed_call_may_come_first(transform):
    program = FIRST.format(transform=transform)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    # A step of 1 m leaves the spring's energy, k/2 + 100/4, as it was; its derivative is 1/2.
    assert float(done.stdout) == pytest.approx(30.0 if "jit" in transform else 0.5, rel=1e-9)
