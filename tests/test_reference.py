"""Reference answers that no other file holds: one table, each value to the digits that it has.

They were computed apart from jshape. The answers to the two energy papers stand in ``problems.py``, those to the other
papers and the benchmarks beside what they judge: in the tests of the linear, insensitive and switched shapers, of
digital taps, and of the plants.
"""

import numpy as np
import pytest
from problems import ANSWERS, Answer
from scipy.integrate import quad

import jshape as js
from jshape.design import linear

# A ZV shaper with ζ = 0.3 and ωd = 1.626 rad/s, as Fig. 2 of Peláez, Doval-Gandoy, Caparrini and García-Prada (2006).
POSICAST = linear.zv(1.626 / np.sqrt(1 - 0.3**2), 0.3)

ROWS = {
    # Chatlatanagulchai, Chotana and Prutthapong, after Eq. 4: K = exp(−ζπ/√(1 − ζ²)).
    Answer("002.zvd.9", "K for ζ = 0.017", 0.9479867116174657, 1e-11): lambda: ratio(linear.zv(9.0, 0.017)),
    Answer("002.zvd.70", "K for ζ = 0.019", 0.9420461280222642, 1e-11): lambda: ratio(
        linear.zv(70.0, 0.019)
    ),
    # Peláez et al., Eq. 1. The paper calls Td the half period, but delays by Td/2.
    Answer("003.posicast.delta", "overshoot of the mode", 0.3723261049, 1e-10): lambda: ratio(POSICAST),
    Answer("003.posicast.A", "amplitudes", (0.7286897745, 0.2713102255), 1e-10): lambda: POSICAST.amplitudes,
    Answer("003.posicast.t", "delay, half a damped period (s)", 1.9320988029, 1e-10): lambda: POSICAST.duration,
    # A ZV for each mode of a crane with two masses: half periods add up. Frequencies by the plant itself.
    Answer("double_pendulum.zv", "duration, mass ratio 1, both cables 1 m, g = 9.81 (s)", 1.85336, 5e-6): lambda: (
        linear.multi_mode(
            [(omega, 0.0) for omega in js.plants.DoublePendulumCrane(1.0, 1.0, 1.0, 1.0).natural_frequency()], kind="zv"
        ).duration
    ),
}  # fmt: skip


def ratio(zv):
    """What a mode keeps of its amplitude in half a period: the second impulse over the first."""
    return zv.amplitudes[1] / zv.amplitudes[0]


@pytest.mark.parametrize("answer", ROWS, ids=lambda answer: answer.id)
def test_answer(answer):
    answer.check(ROWS[answer]())


def test_two_steps_of_force():
    # Chen, Yang, Ou and Yin (2009), m = k = a = x_f = 1: the first step lifts to the destination, the other holds.
    first, final, t2 = np.asarray(ANSWERS["force.hardening"].value)
    energy = lambda x: x**2 / 2 + x**4 / 4
    assert first == pytest.approx(energy(1.0), abs=1e-15)
    assert final == 1.0 + 1.0
    # With x = sin² s the integrand of ∫ dx/√(2 (F1 x − U)) is smooth.
    speed = lambda x: np.sqrt(2 * np.polyval(np.polydiv([-0.25, 0, -0.5, first, 0], [-1, 1, 0])[0], x))
    exact, _ = quad(lambda s: 2 / speed(np.sin(s) ** 2), 0, np.pi / 2, epsabs=1e-14)
    assert t2 == pytest.approx(exact, abs=1e-12)
    plant = js.plants.ForcedMass(1.0, js.plants.Duffing(1.0, 1.0))
    shaper = js.Shaper([first / final, 1 - first / final], [0.0, t2])
    assert float(js.residual_energy(plant, shaper, final, steps=128)) < 1e-20
