"""Identifiers in a control loop: microseconds a sample, one at a time in NumPy and a thousand side by side in JAX.

    python experiments/benchmarks/adaptive.py      # some minutes; writes adaptive.json and adaptive.md beside this file

The signal is a vibration of 8.5 rad/s with offset and noise, the paper's 3,000 points and its two bands, sampled every
5 ms. Beside the sliding DFT: the same magnitudes by the DFT's sum and by numpy.fft after every sample, and
scipy.signal.lfilter called for every sample with a resonator a bin, which is what a filter would take. Times are those
of one thread of the processor, the least of several rounds. How long rounding errors live is measured over three
million samples against the recursion of the textbooks.
"""

import json
import os
import platform
import time
from collections.abc import Callable
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

# One thread for everybody, before any library looks at the processors.
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
os.environ["XLA_FLAGS"] = os.environ.get("XLA_FLAGS", "") + " --xla_cpu_multi_thread_eigen=false"

import jax
import jax.numpy as jnp
import numpy as np
from scipy.signal import lfilter

from jshape.adaptive.damped_sinusoids import DampedSinusoids
from jshape.adaptive.decrement import Decrement
from jshape.adaptive.frequency_tracker import FrequencyTracker
from jshape.adaptive.shaper import AdaptiveShaper
from jshape.adaptive.sliding_dft import SlidingDFT

jax.config.update("jax_enable_x64", True)

TIME = 0.005
LOOPS = 1000
ROUNDS = 3
LOW, HIGH = SlidingDFT(TIME), SlidingDFT(TIME, band=(50.0, 105.0), threshold=10.0)
IDENTIFIERS = {
    "sliding DFT, 26 bins": LOW,
    "sliding DFT, 26 bins, Hann": SlidingDFT(TIME, window="hann"),
    "sliding DFT, 133 bins": HIGH,
    "damped sinusoids, one mode": DampedSinusoids(TIME, modes=1),
    "frequency tracker": FrequencyTracker(TIME, noise=0.02),
    "decrement": Decrement(TIME, threshold=0.1),
}


def main() -> None:
    record = dict(online=online(), peers=peers(), loop=whole_loop(), many=many(), drift=drift())
    write(record)


def signal(count: int) -> np.ndarray:
    times = TIME * np.arange(count)
    return (
        np.cos(8.5 * times) + 0.3 * np.cos(70.0 * times) + 0.5 + 0.02 * np.random.default_rng(0).standard_normal(count)
    )


def each(function: Callable[[float], Any], samples: int) -> float:
    """Microseconds of processor time a sample, beyond the first window."""
    values = signal(3000 + samples).tolist()
    for value in values[:3000]:
        function(value)
    best = np.inf
    for _ in range(ROUNDS):
        begin = time.process_time()
        for value in values[3000:]:
            function(value)
        best = min(best, time.process_time() - begin)
    return 1e6 * best / samples


def online() -> list[dict[str, Any]]:
    """One identifier at a time, NumPy."""
    rows = []
    for name, identifier in IDENTIFIERS.items():
        rows.append(dict(method=name, microseconds=each(identifier.online().push, 3000)))
        print(f"{name:40s} {rows[-1]['microseconds']:10.1f} µs")
    return rows


def peers() -> list[dict[str, Any]]:
    """The magnitudes after every sample, otherwise: of the 26 bins, and as a sum also of the 133."""
    bins = np.asarray(LOW.frequencies[0])
    window = np.zeros(LOW.points)
    few, lots = (
        np.exp(-1j * np.outer(np.asarray(dft.frequencies[0]), TIME * np.arange(LOW.points))) for dft in (LOW, HIGH)
    )
    poles = np.exp(1j * TIME * bins)
    memory = [np.zeros(1, complex) for _ in bins]

    def slide(sample: float) -> float:
        leaving = window[0]
        window[:-1] = window[1:]
        window[-1] = sample
        return leaving

    def naive(matrix: np.ndarray, sample: float) -> np.ndarray:
        slide(sample)
        return abs(matrix @ window)

    def fft(sample: float) -> np.ndarray:
        slide(sample)
        return abs(np.fft.rfft(window))[1:27]

    def resonators(sample: float) -> list[float]:
        change = np.array([sample - slide(sample)])
        out = []
        for i, pole in enumerate(poles):
            value, memory[i] = lfilter([1.0], [1.0, -pole], change, zi=memory[i])
            out.append(abs(value[0]))
        return out

    rows = []
    for name, function, samples in (
        ("the DFT's sum, 26 bins", partial(naive, few), 300),
        ("the DFT's sum, 133 bins", partial(naive, lots), 300),
        ("numpy.fft.rfft of the window, all bins", fft, 1000),
        ("scipy.signal.lfilter, 26 resonators", resonators, 300),
    ):
        rows.append(dict(method=name, microseconds=each(function, samples)))
        print(f"{name:40s} {rows[-1]['microseconds']:10.1f} µs")
    return rows


def whole_loop() -> dict[str, Any]:
    """All that a loop with two modes needs for a sample, NumPy: two sliding DFTs and the shaper of two filters."""
    first, second = LOW.online(), HIGH.online()
    shaper = AdaptiveShaper(TIME).online()
    # Each DFT with the number of bins that one of the paper's bands needs.
    identify = each(lambda sample: (first.push(sample), second.push(sample)), 3000)
    estimate = type(first.estimate)(*(np.array(pair) for pair in zip(first.estimate, second.estimate, strict=True)))
    shape = each(lambda sample: shaper.push(sample, estimate), 3000)
    taps = np.zeros(400)
    taps[[0, 70, 140]] = 0.25, 0.5, 0.25
    memory = np.zeros(399)

    def plain(sample: float) -> None:
        nonlocal memory
        for _ in range(2):
            _, memory = lfilter(taps, [1.0], [sample], zi=memory)

    filters = each(plain, 3000)
    row = dict(identify=identify, shape=shape, together=identify + shape, two_lfilters=filters)
    print("the loop: " + ", ".join(f"{name} {value:.1f} µs" for name, value in row.items()))
    return row


def many() -> list[dict[str, Any]]:
    """A thousand loops side by side, JAX on the same thread: microseconds for one sample of all."""
    rows, samples = [], 400
    given = jnp.asarray(signal(samples)[:, None] * np.linspace(0.5, 2.0, LOOPS))
    for name, identifier in IDENTIFIERS.items():
        if isinstance(identifier, DampedSinusoids):  # under vmap it fits with every sample; see its docstring
            continue
        step = jax.vmap(identifier.step)
        run = jax.jit(lambda state, given, step=step: jax.lax.scan(lambda s, x: (step(s, x)[0], None), state, given)[0])
        state = jax.vmap(lambda _, identifier=identifier: identifier.start())(jnp.arange(LOOPS))
        jax.block_until_ready(run(state, given))
        best = np.inf
        for _ in range(ROUNDS):
            begin = time.process_time()
            jax.block_until_ready(run(state, given))
            best = min(best, time.process_time() - begin)
        rows.append(dict(method=name, microseconds=1e6 * best / samples))
        print(f"{LOOPS} x {name:33s} {rows[-1]['microseconds']:10.1f} µs")
    return rows


def drift(count: int = 3_000_000) -> dict[str, Any]:
    """Error of the spectrum after many samples, relative to its largest magnitude: ours, and pole times sum."""
    identifier = SlidingDFT(TIME, 64, (20.0, 200.0))
    samples = np.random.default_rng(1).standard_normal(count)
    last = jax.jit(
        lambda samples: jax.lax.scan(lambda s, x: (identifier.step(s, x)[0], None), identifier.start(), samples)[0]
    )(jnp.asarray(samples))
    bins, magnitudes = (np.asarray(value) for value in identifier.spectrum(last))
    exact = abs(np.exp(-1j * np.outer(bins, TIME * np.arange(64))) @ samples[-64:])
    changes = samples - np.concatenate([np.zeros(64), samples[:-64]])
    textbook = [abs(lfilter([1.0], [1.0, -np.exp(1j * TIME * omega)], changes)[-1]) for omega in bins]
    row = dict(
        samples=count,
        ours=float(np.max(abs(magnitudes - exact)) / np.max(exact)),
        textbook=float(np.max(abs(textbook - exact)) / np.max(exact)),
    )
    print(row)
    return row


def write(record: dict[str, Any]) -> None:
    names = ("jshape", "jax", "scipy", "numpy")
    about: dict[str, Any] = dict(
        machine=f"{platform.machine()}, one thread of {processor()}",
        python=platform.python_version(),
        versions={name: version(name) for name in names},
    )
    here = Path(__file__).parent
    (here / "adaptive.json").write_text(json.dumps(dict(about=about) | record, indent=2) + "\n", encoding="utf-8")
    side = {row["method"]: row["microseconds"] for row in record["many"]}
    base = record["online"][0]["microseconds"]
    lines = [
        f"| after every sample | µs | over the sliding DFT's | {LOOPS:,} in JAX, µs |",
        "| --- | --- | --- | --- |",
    ]
    for row in record["online"] + record["peers"]:
        beside = f"{side[row['method']]:.3g}" if row["method"] in side else "–"
        lines.append(f"| {row['method']} | {row['microseconds']:.3g} | {row['microseconds'] / base:.3g} | {beside} |")
    loop, far = record["loop"], record["drift"]
    lines += [
        "",
        f"A loop with two modes takes {loop['together']:.3g} µs a sample: {loop['identify']:.3g} for two sliding DFTs, "
        f"{loop['shape']:.3g} for the shaper (two calls of scipy.signal.lfilter with 400 fixed taps: "
        f"{loop['two_lfilters']:.3g}).",
        "",
        f"After {far['samples']:,} samples the spectrum's error is {far['ours']:.1e} of its peak, "
        f"that of the textbook's recursion {far['textbook']:.1e} and growing.",
        "",
        f"{about['machine']}; " + ", ".join(f"{k} {v}" for k, v in about["versions"].items()) + ".",
    ]
    (here / "adaptive.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


def processor() -> str:
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
        return next(line.split(":")[1].strip() for line in text.splitlines() if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or "an unnamed processor"


if __name__ == "__main__":
    main()
