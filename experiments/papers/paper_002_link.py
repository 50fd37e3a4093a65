"""Results of jshape for the link of paper_002: its plant, its shapers that need no adaption, its spectra.

A two-foot link with modes of 8.5, 7.3, 5.7 and 74, 70, 66 rad/s at 0, 10 and 20 coins.
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jshape as js
from experiments.papers.paper_002_judge import DAMPING, MIDDLE, SERVO, STEP, TIP, ZETAS, modes, replay
from jshape.design import insensitive, linear

FIRST, SECOND = (9.0, 0.017), (70.0, 0.019)
"""What the shaper starts from: rad/s and damping ratio of both modes."""

BANDS = ((5.7, 8.5), (66.0, 74.0))
"""Where the modes lie with 0 to 20 coins, rad/s."""

COINS = np.linspace(0.0, 20.0, 41)
TICK, POINTS = 0.005, 3000
"""Sampling time of the experiment drawn here, s (not printed), and points of its DFT."""


def link(coins: Any) -> js.plants.FlexibleLink:
    return js.plants.FlexibleLink(coins, servo_omega=SERVO, servo_zeta=DAMPING)


def largest(shaper: js.Shaper) -> float:
    """The largest V of either mode at any of ``COINS``."""
    omega = np.array([np.asarray(link(coins).natural_frequency()) for coins in COINS])
    return float(jnp.max(js.percentage_vibration(shaper, omega, ZETAS)))


@jax.jit
def energies(shaper: js.Shaper, coins: jax.Array) -> jax.Array:
    """jshape's values of the judge's ``energy``, at each of those loads."""
    return jax.vmap(lambda load: js.residual_energy(link(load), shaper, STEP, steps=64))(coins)


def designs() -> dict[str, Any]:
    """The paper's fixed shaper and those of jshape's own that need no adaption; the limits are the paper's."""
    paper = linear.multi_mode([FIRST, SECOND])
    given: dict[str, Any] = dict(zeta=FIRST[1])
    robust = insensitive.solve(BANDS, duration=float(paper.duration), **given)
    tuned = js.tune(
        link(10.0), STEP, impulses=5, duration=float(paper.duration), over={"load": COINS[::4]}, relative=False,
        objective="worst", starts=8,
    )  # fmt: skip
    adapted = linear.multi_mode([(5.7, 0.017), (66.0, 0.019)])
    return {
        "paper": paper,
        "robust": robust,
        "short": insensitive.solve(BANDS, 0.28, **given),
        "adapted": adapted,
        "as adapted": insensitive.solve(BANDS, duration=float(adapted.duration), **given),
        "simultaneous": linear.simultaneous([FIRST, SECOND], order=1),
        "digital": linear.digital_zvd_n(*SECOND, sample_time=0.01, order=1),
        "tuned": tuned,
    }


def fixed(shaper: js.Shaper, reference: np.ndarray, coins: np.ndarray) -> dict[str, np.ndarray]:
    """The judge's ``replay`` of a reference (rad) through a shaper that stays as it is, its times on the ticks."""
    command = np.full_like(reference, reference[0])
    ticks = np.rint(np.asarray(shaper.times) / TICK).astype(int)
    for amplitude, delay in zip(np.asarray(shaper.amplitudes), ticks, strict=True):
        command[delay:] += amplitude * (reference[: len(reference) - delay] - reference[0])
    return replay(command, coins, TICK)


def free_peak(coins: float, signal: str, window: tuple[float, float]) -> float:
    """The frequency of the greatest DFT of an acceleration, rad/s, while the link swings after an unshaped step of 30°.

    The parabola through the highest point within ``window`` (rad/s) and its neighbours; the servo has settled.
    """
    command = np.where(np.arange(POINTS + 201) == 0, -STEP, 0.0)
    # A window that fades to its ends keeps the leakage of one mode away from the peak of the other.
    data = replay(command, np.full(len(command), coins), TICK)[signal][201:] * np.hanning(POINTS)
    magnitude = np.abs(np.fft.rfft(data))
    omega = 2 * np.pi / (POINTS * TICK) * np.arange(len(magnitude))
    inside = (omega >= window[0]) & (omega <= window[1])
    i = int(np.flatnonzero(inside)[np.argmax(magnitude[inside])])
    below, here, above = np.log(magnitude[i - 1 : i + 2])
    return float(omega[i] + (omega[1] - omega[0]) * (below - above) / (2 * (below - 2 * here + above)))


def gain(omega: np.ndarray, coins: float) -> np.ndarray:
    """|θp/θr| at those frequencies, rad/s."""
    s, own = 1j * omega[:, None], modes(coins)
    servo = SERVO**2 / (s**2 + 2 * DAMPING * SERVO * s + SERVO**2)
    bent = np.sum(-TIP * s**2 / (s**2 + 2 * ZETAS * own * s + own**2), axis=1)
    return np.abs(servo[:, 0] * (1 + bent))


def second_in_middle() -> float:
    """The ratio of the second mode to the first in the middle accelerometer, over that at the tip."""
    return float(np.abs((MIDDLE[1] / MIDDLE[0]) / (TIP[1] / TIP[0])))
