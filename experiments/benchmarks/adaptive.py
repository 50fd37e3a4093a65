"""Identifiers in a control loop: microseconds a sample, one at a time in NumPy and a thousand side by side in JAX.

    python -m experiments.benchmarks.adaptive      # some minutes; writes adaptive.json and adaptive.md beside this file

The signal is a vibration of 8.5 rad/s with offset and noise, the paper's 3,000 points and its two bands, sampled every
5 ms. Beside the sliding DFT: the same magnitudes by the DFT's sum and by numpy.fft after every sample, and
scipy.signal.lfilter called for every sample with a resonator a bin, which is what a filter would take. The adaptive
strategies, identifier and shaper of two modes together, run at 10 kHz: 100 µs are theirs. Times are those of one thread
of the processor, the least of several rounds. How long rounding errors live is measured over 100 million samples,
against the recursion of the textbooks.
"""

import time
import timeit
from collections.abc import Callable
from functools import partial
from typing import Any

import experiments.benchmarks.one_thread  # noqa: F401  # isort: skip

import jax
import jax.numpy as jnp
import numpy as np
from scipy.signal import lfilter

from experiments.benchmarks.record import about, keep, processor
from experiments.markdown import table
from jshape.adaptive import (
    AbstractStrategy,
    Adapting,
    DampedSinusoids,
    Decrement,
    FrequencyTracker,
    Hoisting,
    HoistingMoves,
    NoisySensor,
    Readings,
    SlidingDFT,
    TwoMassMoves,
    case,
)
from jshape.plants import Duffing, LinearDamper, TwoMass

jax.config.update("jax_enable_x64", True)

TIME = 0.005
FAST = 1e-4
"""s: 10 kHz."""
LOOPS = 1000
ROUNDS = 3
BAND = (4.0, 14.0)
LOW, HIGH = SlidingDFT(TIME, 3000, BAND, 7.0), SlidingDFT(TIME, 3000, (50.0, 105.0), 10.0)
IDENTIFIERS = {
    "sliding DFT, 26 bins": LOW,
    "sliding DFT, 26 bins, Hann": SlidingDFT(TIME, 3000, BAND, 7.0, window="hann"),
    "sliding DFT, 133 bins": HIGH,
    "damped sinusoids, one mode": DampedSinusoids(TIME, BAND, 1),
    "frequency tracker": FrequencyTracker(TIME, BAND, noise=0.02, amplitude=1.0),
    "decrement": Decrement(TIME, BAND, 0.1),
}


def main() -> None:
    write(
        dict(
            about=about(f"one thread of {processor()}", "jshape", "jax", "scipy", "numpy"),
            online=online(), peers=peers(), loops=loops(), filters=filters(), moves=moves(), many=many(), drift=drift(),
        )
    )  # fmt: skip


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

    def run() -> None:
        for value in values[3000:]:
            function(value)

    return fastest(run) / samples


def fastest(run: Callable[[], Any]) -> float:
    """The least of several rounds, microseconds of processor time."""
    return 1e6 * min(timeit.repeat(run, timer=time.process_time, repeat=ROUNDS, number=1))


def row(method: str, microseconds: float, **more: float) -> dict[str, Any]:
    """One measurement for the record; and at the prompt."""
    print(f"{method:40s} {microseconds:10.1f} µs", *(f"{name} {value:.1f}" for name, value in more.items()))
    return dict(method=method, microseconds=microseconds, **more)


def online() -> list[dict[str, Any]]:
    """One identifier at a time, NumPy."""
    return [row(name, each(identifier.online().push, 3000)) for name, identifier in IDENTIFIERS.items()]


def peers() -> list[dict[str, Any]]:
    """The magnitudes after every sample, otherwise: of the 26 bins, and as a sum also of the 133."""
    bins = np.asarray(LOW.omegas[0])
    window = np.zeros(LOW.points)
    few, lots = (np.exp(-1j * np.outer(np.asarray(dft.omegas[0]), TIME * np.arange(LOW.points))) for dft in (LOW, HIGH))
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

    return [
        row("the DFT's sum, 26 bins", each(partial(naive, few), 300)),
        row("the DFT's sum, 133 bins", each(partial(naive, lots), 300)),
        row("numpy.fft.rfft of the window, all bins", each(fft, 1000)),
        row("scipy.signal.lfilter, 26 resonators", each(resonators, 300)),
    ]


def strategies(sample_time: float) -> dict[str, AbstractStrategy]:
    """All of two modes; the paper's with a DFT of 15 s, whatever the sample time."""
    points = round(15.0 / sample_time)
    return {name: case(name, sample_time, points=points) for name in ("I", "I-D", "I-D-E", "state-aware", "replanning")}


def machine(sample_time: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Reference, rad, that moves every 5 s, and readings of both modes, noise and all: (count,), (count, 4)."""
    times = sample_time * np.arange(count)
    first, second = np.cos(8.5 * times), np.cos(70.0 * times)
    clean = np.stack([0.0 * times, 0.05 * first, first + 0.3 * second, 0.3 * first + second], axis=1)
    noise = 0.01 * np.random.default_rng(2).standard_normal(clean.shape)
    return np.where(times // 5.0 % 2, 0.5, -0.5), clean + noise


def loops() -> list[dict[str, Any]]:
    """One strategy at a time, NumPy, 6 s at 10 kHz: the mean and the longest."""
    reference, readings = machine(FAST, round(6.0 / FAST))
    given = [(float(r), Readings(*row)) for r, row in zip(reference, readings.tolist(), strict=True)]
    rows = []
    for name, strategy in strategies(FAST).items():
        # Of each sample the least of several rounds: what the processor does for others beside it is not ours.
        best = np.full(len(given), np.inf)
        for _ in range(ROUNDS):
            push = strategy.online(float(reference[0])).push
            for i, sample in enumerate(given):
                begin = time.thread_time_ns()
                push(*sample)
                best[i] = min(best[i], 1e-3 * (time.thread_time_ns() - begin))
        rows.append(row(name, float(best.mean()), longest=float(best.max())))
    return rows


def moves() -> list[dict[str, Any]]:
    """Machines that plan their moves anew, at 10 kHz as the clock goes: of a sample the median and what one in a
    thousand exceeds, µs; of a plan beside the loop and of a move's beginning, ms. Their sensor shows noise alone."""
    pair = TwoMass(spring=Duffing(10.0, 100.0), damper=LinearDamper(0.4))
    leaves = ("spring.k1", "spring.k3", "damper.c")
    settings = dict(spread=0.5, drift=0.5, shares=(0.6,))
    machines = {
        "pair": (Adapting(TwoMassMoves(pair, leaves, 6.0), NoisySensor(1e-3, 5e-4), **settings), 1.0),
        "hoisting crane": (
            Adapting(HoistingMoves(), NoisySensor(2e-3, 1e-3), **settings),
            Hoisting(5.0, 6.0, -3.0),
        ),
    }
    rows = []
    for name, (strategy, known) in machines.items():
        loop = strategy.online(FAST)
        loop.begin(known)
        readings = (1e-3 * np.random.default_rng(0).standard_normal(200_000)).tolist()
        taken, begun = [], time.perf_counter()
        while not loop.over:
            while time.perf_counter() < begun + FAST * len(taken):
                pass
            before = time.perf_counter()
            loop.push(readings[len(taken)])
            taken.append(1e6 * (time.perf_counter() - before))
        begun = time.perf_counter()
        loop.begin(known)
        begin = 1e3 * (time.perf_counter() - begun)
        none = np.full(len(strategy.model.times), np.nan)
        plan = fastest(partial(loop.replanned, loop.memory, 0, 1.0, none)) / 1e3
        most = dict(late=float(np.quantile(taken, 0.999)), longest=max(taken), plan=plan, begin=begin)
        rows.append(row(f"{name}, a sample", float(np.median(taken)), **most))
    return rows


def filters() -> float:
    """Microseconds a sample of two calls of scipy.signal.lfilter, fixed taps as long as a shaper's at 5 ms."""
    taps = np.zeros(400)
    taps[[0, 70, 140]] = 0.25, 0.5, 0.25
    memory = np.zeros(399)

    def plain(sample: float) -> None:
        nonlocal memory
        for _ in range(2):
            _, memory = lfilter(taps, [1.0], [sample], zi=memory)

    return each(plain, 3000)


def many() -> list[dict[str, Any]]:
    """A thousand side by side, JAX on the same thread: microseconds for one sample of all."""
    scale, samples = jnp.linspace(0.5, 2.0, LOOPS), 400
    values = jnp.asarray(signal(samples))
    reference, readings = map(jnp.asarray, machine(TIME, samples))

    def identify(own: Any, state: Any, k: Any, factor: Any) -> Any:
        return own.step(state, values[k] * factor)[0]

    def move(own: Any, state: Any, k: Any, factor: Any) -> Any:
        return own.step(state, reference[k] * factor, Readings(*(readings[k] * factor)))[0]

    def taken(start: Any, step: Callable[..., Any]) -> float:
        side = jax.vmap(step, in_axes=(0, None, 0))

        def run(state: Any) -> Any:
            return jax.lax.scan(lambda state, k: (side(state, k, scale), None), state, jnp.arange(samples))[0]

        state = jax.tree.map(lambda leaf: jnp.stack([leaf] * LOOPS), start)
        compiled = jax.jit(run).lower(state).compile()
        return fastest(lambda: jax.block_until_ready(compiled(state))) / samples

    # Under vmap the damped sinusoids are fitted with every sample; see their docstring.
    steps: dict[str, Any] = {
        name: (identifier.start(), partial(identify, identifier))
        for name, identifier in IDENTIFIERS.items()
        if not isinstance(identifier, DampedSinusoids)
    }
    steps |= {name: (own.start(reference[0]), partial(move, own)) for name, own in strategies(TIME).items()}
    return [row(name, taken(*of)) for name, of in steps.items()]


def drift() -> list[dict[str, Any]]:
    """Error of the spectrum after many samples, relative to its largest magnitude: ours, and pole times sum."""
    identifier = SlidingDFT(TIME, 64, (20.0, 200.0), 7.0)
    bins = np.asarray(identifier.omegas[0])
    dft = np.exp(-1j * np.outer(bins, TIME * np.arange(64)))

    @jax.jit
    def advance(state: Any, samples: jax.Array) -> Any:
        return jax.lax.scan(lambda state, sample: (identifier.step(state, sample)[0], None), state, samples)[0]

    random, state, last = np.random.default_rng(1), identifier.start(), np.zeros(64)
    memory, rows, block = np.zeros((len(bins), 1), complex), [], 1_000_000
    for done in range(1, 101):
        samples = random.standard_normal(block)
        state = advance(state, jnp.asarray(samples))
        changes = samples - np.concatenate([last, samples[:-64]])
        textbook, last = np.zeros(len(bins)), samples[-64:]
        for i, omega in enumerate(bins):
            found, memory[i] = lfilter([1.0], [1.0, -np.exp(1j * TIME * omega)], changes, zi=memory[i])
            textbook[i] = abs(found[-1])
        if done in (1, 10, 100):
            exact, both = abs(dft @ last), (np.asarray(identifier.spectrum(state)[1]), textbook)
            ours, theirs = (float(np.max(abs(values - exact)) / np.max(exact)) for values in both)
            rows.append(dict(samples=done * block, ours=ours, textbook=theirs))
            print(rows[-1])
    return rows


def write(record: dict[str, Any]) -> None:
    side = {row["method"]: f"{row['microseconds']:.3g}" for row in record["many"]}
    base = record["online"][0]["microseconds"]
    filters, naive = record["filters"], sum(row["microseconds"] for row in record["peers"][:2])
    one = [(row["method"], row["microseconds"]) for row in record["online"] + record["peers"]]
    whole = [(row["method"], row["microseconds"], row["longest"]) for row in record["loops"]]
    in_jax = f"{LOOPS:,} in JAX, µs"
    lines = [
        *table(
            ("after every sample", "µs", "over the sliding DFT's", in_jax),
            [(name, f"{mean:.3g}", f"{mean / base:.3g}", side.get(name, "–")) for name, mean in one],
        ),
        "",
        f"Whole strategies for two modes at 10 kHz, which leaves 100 µs. Two calls of scipy.signal.lfilter, 400 fixed "
        f"taps each, take {filters:.3g} µs; the DFT's sum for both bands, {naive:.3g} µs at 3,000 points and "
        "50 times that at the 150,000 that span 15 s at 10 kHz.",
        "",
        *table(
            ("strategy", "µs a sample", "longest", "over two lfilters", "over the sums of 3,000", in_jax),
            [
                (name, *(f"{x:.3g}" for x in (mean, late, mean / filters, mean / naive)), side[name])
                for name, mean, late in whole
            ],
        ),
        "",
        "Machines that fit their model to a move's first readings and plan its other impulses anew "
        "(`Adapting.online`), by the clock; a plan is made in a thread, and its move goes on as it was where it comes "
        "too late.",
        "",
        *table(
            ("machine", "median (µs)", "one in 1,000 above (µs)", "longest (µs)", "a plan (ms)", "a move begins (ms)"),
            [
                (row["method"], *(f"{row[name]:.3g}" for name in ("microseconds", "late", "longest", "plan", "begin")))
                for row in record["moves"]
            ],
        ),
        "",
        *table(
            ("samples", "error of the sliding DFT, of its peak", "of the textbook's recursion"),
            [(f"{row['samples']:,}", f"{row['ours']:.1e}", f"{row['textbook']:.1e}") for row in record["drift"]],
        ),
    ]
    keep(__file__, record, lines)


if __name__ == "__main__":
    main()
