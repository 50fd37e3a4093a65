"""Energy shapers: closed forms from the work–energy principle, for a displacement-driven mass on any spring.

The base moves so far that the payload swings from one resting point exactly to the next; each new move of the base
comes when the payload rests. The shapers differ by where it rests, and how often::

    js.design.energy.two_impulse(plant, 1.0)              # one swing: the nonlinear ZV
    js.design.energy.three_impulse(plant, 1.0)            # rests half way: the nonlinear ZVD
    js.design.energy.robust(plant, 1.0, rests=3)          # rests three times, equal steps
    js.design.energy.first_order_robust(plant, 1.0, 4)    # steps for which errors in the mass cancel
    js.design.energy.fast_three_impulse(plant, 1.0)       # a push at full speed in the place of a rest
    js.design.energy.negative(plant, 1.0)                 # 1, −1, 1

``damping`` selects how a damper is taken into account: ``"exact"`` (the default: the equations of motion are solved),
``"orbit"`` (the loss along the undamped orbit), ``"harmonic"`` (the loss of a harmonic quarter cycle, as in the paper)
or ``"ignore"``. Without a damper they are one and the same; the two approximations are for shapers made of swings,
``fast_three_impulse`` and ``negative`` have ``"exact"`` and ``"ignore"`` alone. Amplitudes are normalised; times in s.

Times without damping are known to rounding where forces are smooth between named kinks, and to 1e-8 at least. With a
damper the payload stops to 1e-6 of its way, and of its greatest speed, by the integration's own estimate: to rounding
where forces are smooth, to less beside a dry friction or a kink, for which steps grow to 4,096 a swing (64 where values
are traced). What is not known so well is refused, or NaN where it is traced.
"""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jshape import _check
from jshape._roots import bracketed_root, integral, known_or_nan
from jshape._types import Scalar
from jshape.command import Distance
from jshape.compilation_cache import kept
from jshape.design._damped_swing import accurate, newton, states_at
from jshape.design._swing import half_period, swing_integral, times_from_turns
from jshape.plants import AbstractOscillator
from jshape.shaper import Shaper

DAMPING = ("exact", "orbit", "harmonic", "ignore")

FARTHEST = 2.0
"""How many times the way of a swing the base may stand ahead of the payload."""


def two_impulse(plant: AbstractOscillator, distance: Distance, *, damping: str = "exact") -> Shaper:
    """The nonlinear ZV shaper: one swing from start to destination, the fastest without negative impulses.

    Args:
        plant: a displacement-driven mass on a spring.
        distance: of the move, m.
        damping: one of ``DAMPING``.

    Raises:
        ValueError: for another plant, a zero distance, or a spring that does not swing that far.

    Source: Chatlatanagulchai, Moonmangmee and Intarawirat (2017), Eqs. 2–5.
    """
    return _swings(plant, distance, np.ones(1), damping)


def three_impulse(plant: AbstractOscillator, distance: Distance, alpha: Any = 0.5, *, damping: str = "exact") -> Shaper:
    """The nonlinear ZVD shaper: two swings, with a rest between.

    Args:
        plant, distance, damping: as ``two_impulse``.
        alpha: where the rest is, as a fraction of the distance, in (0, 1); 0.5 cancels errors in the mass to first
            order.

    Raises:
        ValueError: as ``two_impulse``, and for an alpha outside (0, 1).

    Source: Moonmangmee and Chatlatanagulchai (2025), Eqs. 13, 20, 21.
    """
    alpha = _fraction(alpha, "alpha")
    return _swings(plant, distance, jnp.stack([alpha, 1 - alpha]), damping)


def robust(plant: AbstractOscillator, distance: Distance, rests: Any = 1, *, damping: str = "exact") -> Shaper:
    """Swings from rest to rest: k rests on the way make k + 2 impulses.

    Args:
        plant, distance, damping: as ``two_impulse``.
        rests: how many, in equal steps; or their positions, m, between 0 and the distance. Equal steps cancel errors in
            the mass to first order for odd numbers of impulses only (see ``first_order_robust``).

    Raises:
        ValueError: as ``two_impulse``, and for positions that are not in order between 0 and the distance.

    Source: Chatlatanagulchai, Moonmangmee and Intarawirat (2017), Eqs. 6 (its lower limit corrected) to 9;
    Moonmangmee and Chatlatanagulchai (2025), Eqs. 31 and 36 (Eq. 37 swaps the amplitudes).
    """
    if isinstance(rests, int | np.integer) or np.ndim(rests) == 0:
        count = _check.count(rests, "rests", least=0)
        return _swings(plant, distance, np.full(count + 1, 1 / (count + 1)), damping)
    positions = _check.as_array(rests, "rests")
    if positions.ndim != 1:
        raise ValueError(f"rests must be a whole number or a list of positions, not of shape {positions.shape}")
    size = _check_arguments(plant, distance, damping)
    ends = jnp.concatenate([jnp.zeros(1), positions / size, jnp.ones(1)])
    if _check.is_concrete(ends) and np.any(np.diff(np.asarray(ends)) <= 0):
        given = _check.show(positions)
        raise ValueError(f"rests must lie in order between 0 and the distance, {_check.show(size)}, not {given}")
    return _swings(plant, distance, jnp.diff(ends), damping)


def first_order_robust(
    plant: AbstractOscillator, distance: Distance, impulses: int = 4, *, damping: str = "exact"
) -> Shaper:
    """The swings for which the residual of an error in the mass (in all frequencies alike) vanishes to first order.

    With an even number of impulses the steps are s, m, …, m, s, with an odd one s, m, …, m.

    By an error the payload reaches the end of each swing late, and the next swing reverses that: with swing forces F
    (at the end of a swing, before the base moves; F' after it) and half periods h, the lag
    r_i = F_i h_i − r_{i−1} F_i/F'_i must end at 0. For odd springs and odd numbers of impulses the steps are equal.

    Args:
        plant, distance, damping: as ``two_impulse``.
        impulses: at least 3.

    Raises:
        ValueError: as ``two_impulse``, and for fewer than three impulses.

    Source: derived here; it generalises Moonmangmee and Chatlatanagulchai (2025), Eq. 28, whose equal steps for even
    numbers of impulses do not have this property.
    """
    impulses = _check.count(impulses, "impulses", least=3)
    size = _check_arguments(plant, distance, damping)
    return _swings(plant, distance, _first_order_shares(plant, size, impulses - 1), damping)


def fast_three_impulse(
    plant: AbstractOscillator, distance: Distance, first: Any = None, *, damping: str = "exact"
) -> Shaper:
    """A second push when the payload is fastest, a last one when it rests at the destination.

    Args:
        plant, distance: as ``two_impulse``.
        first: the first amplitude A1, a fraction of the distance, from the whole A1–A2 family (0 < A1 < ½ for an odd
            spring); equal first and second amplitudes, the paper's optimum, unless given.
        damping: ``"exact"`` or ``"ignore"``.

    Raises:
        ValueError: as ``two_impulse``, and for an A1 that leaves no second amplitude.

    Source: Moonmangmee and Chatlatanagulchai (2025), Eqs. 43 (with its bracket corrected), 45, 46, 50.
    """
    size = _check_arguments(plant, distance, damping, ("exact", "ignore"))
    first = None if first is None else _fraction(first, "first")
    amplitudes, times = accurate(functools.partial(_fast, plant, size, first, _effective(plant, damping)))
    if first is not None and _check.is_concrete(amplitudes) and not np.all(np.asarray(amplitudes)[:2] > 0):
        raise ValueError(f"first must leave room for a second push, which {float(first)} does not")
    return _checked(amplitudes, times, size)


def negative(plant: AbstractOscillator, distance: Distance, *, damping: str = "exact") -> Shaper:
    """The unity-magnitude shaper 1, −1, 1: the base goes all the way, comes back to brake the payload, and meets it.

    Args:
        plant, distance: as ``two_impulse``.
        damping: ``"exact"`` or ``"ignore"``.

    Raises:
        ValueError: as ``two_impulse``.

    Source: Chatlatanagulchai, Moonmangmee and Intarawirat (2017), Eq. 10 and after; here also for springs that are
    not odd, where the payload is not half way when the base comes back.
    """
    size = _check_arguments(plant, distance, damping, ("exact", "ignore"))
    return _checked(*accurate(functools.partial(_negative, plant, size, _effective(plant, damping))), size)


def _swings(plant: AbstractOscillator, distance: Any, shares: Array | np.ndarray, damping: str) -> Shaper:
    """The shaper whose swings cover these shares of the distance."""
    size = _check_arguments(plant, distance, damping)
    damping = _effective(plant, damping)
    ways, bases, times = _approximate_swings(plant, size, shares, damping)
    if damping == "exact":
        # One program, compiled once, serves every swing of every shaper.
        swings = zip(bases, ways, times, strict=True)
        exact = [accurate(functools.partial(_exact_swing, plant, *swing)) for swing in swings]
        bases, times = (jnp.stack(part) for part in zip(*exact, strict=True))
    return _checked(*_assemble(bases, ways, times, size), size)


@kept
def _approximate_swings(plant: AbstractOscillator, size: Scalar, shares: Any, damping: str) -> tuple[Array, ...]:
    """Ways (m), base positions (m) and durations (s) of swings, without damping or nearly with it."""
    ways = size * shares
    bases = _bases(plant, ways)
    times = _half_periods(plant, bases, ways)
    if damping != "ignore":
        loss = _loss_harmonic if damping == "harmonic" else _loss_orbit
        bases = _bases(plant, ways, jax.vmap(lambda *swing: loss(plant, *swing))(bases, ways, times))
    if damping == "exact":
        # Only the beginning of a search then.
        bases = jnp.where(jnp.isnan(bases), FARTHEST * ways, bases)
    return ways, bases, times


def _half_periods(plant: AbstractOscillator, bases: Array, ways: Array) -> Array:
    return jax.vmap(lambda base, way: half_period(plant, -base, way - base))(bases, ways)


def _assemble(bases: Array, ways: Array, times: Array, size: Scalar) -> tuple[Array | np.ndarray, Array | np.ndarray]:
    """Amplitudes and times from each swing's base position ahead of it (m), way (m) and duration (s)."""
    xp = _check.numerics(bases, ways, times, size)
    bases, ways, times, size = (xp.asarray(x) for x in (bases, ways, times, size))
    rests = xp.concatenate([xp.zeros_like(ways[:1]), xp.cumsum(ways)])
    levels = xp.concatenate([rests[:1], rests[:-1] + bases, size[None]])
    return xp.diff(levels) / size, xp.concatenate([xp.zeros_like(times[:1]), xp.cumsum(times)])


@kept
def _first_order_shares(plant: AbstractOscillator, size: Scalar, swings: int) -> Array:
    """The shares of the distance for which the lag ends at 0."""

    def shares(s: Scalar) -> Array:
        ends = 2 if swings % 2 else 1
        inner = jnp.full(swings - ends, 1.0) * (1 - ends * s) / (swings - ends)
        return jnp.concatenate([s[None], inner, s[None]][: ends + 1])

    def lag(s: Scalar) -> Scalar:
        ways = size * shares(s)
        bases = _bases(plant, ways)
        times = _half_periods(plant, bases, ways)
        before, after = jax.vmap(plant.spring.force)(ways - bases), jax.vmap(plant.spring.force)(-bases)
        total = jnp.zeros_like(s)
        for i in range(swings):
            total = before[i] * times[i] + total * before[i] / after[i]
        return total / plant.spring.force(size)

    # For an odd number of swings a long first one adds to the last one's lag; for an even number it opposes it.
    lower, upper = (0.02 / swings, 0.49) if swings % 2 else (0.2 / swings, 1 - 0.2 / swings)
    return shares(bracketed_root(lag, lower, upper, rising=bool(swings % 2)))


@kept
def _fast(
    plant: AbstractOscillator, size: Scalar, first: Scalar | None, damping: str, steps: int
) -> tuple[Array, Array, Scalar]:
    """Amplitudes, times and error of ``fast_three_impulse``; a negative second amplitude where there is none."""

    def potential(share: Any) -> Scalar:
        return plant.spring.potential(share * size)

    if first is None:
        a1 = a2 = bracketed_root(lambda a: 2 * potential(-a) - potential(1 - 2 * a), 0.0, 0.5)
    else:
        a1 = first
        a2 = bracketed_root(lambda a: potential(-a1) + potential(-a) - potential(1 - a1 - a), 0.0, 1 - a1)
        a2 = jnp.where(potential(-a1) < potential(1 - a1), a2, -1.0)
    turns = -a1 * size, (1 - a1 - a2) * size
    t2, t3 = jnp.cumsum(times_from_turns(plant, turns, (jnp.zeros_like(size), -a2 * size)))

    def conditions(x: Array) -> tuple[Array, Array]:
        second, t2, t3 = x
        one = second if first is None else first
        (passed, end), error = states_at(plant, size, jnp.stack([one, second]), jnp.stack([t2, t3]), steps)
        unit = jnp.stack([size, size / t2])
        return jnp.append(passed[0] / size - one, end / unit - jnp.array([1.0, 0.0])), error / unit

    error = jnp.zeros_like(size)
    if damping == "exact":
        (a2, t2, t3), error = newton(conditions, jnp.stack([a2, t2, t3]))
        a1 = a2 if first is None else first
    return jnp.stack([a1, a2, 1 - a1 - a2]), jnp.stack([jnp.zeros_like(t2), t2, t3]), error


@kept
def _negative(plant: AbstractOscillator, size: Scalar, damping: str, steps: int) -> tuple[Array, Array, Scalar]:
    """Amplitudes and times of ``negative``, and their error."""

    def excess(share: Scalar) -> Scalar:
        u = plant.spring.potential
        return u(-size) - u((share - 1) * size) + u(share * size) - u(size)

    share = bracketed_root(excess, 0.0, 1.0)
    t2, t3 = jnp.cumsum(times_from_turns(plant, (-size, size), ((share - 1) * size, share * size)))
    pushes = jnp.asarray([1.0, -1.0])

    def conditions(times: Array) -> tuple[Array, Array]:
        (_, end), error = states_at(plant, size, pushes, times, steps)
        unit = jnp.stack([size, size / t2])
        return end / unit - jnp.array([1.0, 0.0]), error / unit

    error = jnp.zeros_like(size)
    if damping == "exact":
        (t2, t3), error = newton(conditions, jnp.stack([t2, t3]))
    return jnp.append(pushes, 1.0), jnp.stack([jnp.zeros_like(t2), t2, t3]), error


def _bases(plant: AbstractOscillator, ways: Array, losses: Array | None = None) -> Array:
    """How far ahead of the payload the base must stand for each swing of the given way (m): U(−b) − U(w − b) = loss.

    NaN where that is farther than ``FARTHEST``.
    """
    if losses is None:
        if plant.spring.odd:
            return ways / 2
        losses = jnp.zeros_like(ways)
    potential = plant.spring.potential

    def base(way: Scalar, loss: Scalar) -> Scalar:
        def excess(share: Scalar) -> Scalar:
            return potential(-share * way) - potential((1 - share) * way) - loss

        # A damper takes energy, so the base may have to stand beyond the destination of the swing.
        share = bracketed_root(excess, 0.0, FARTHEST)
        return way * known_or_nan(share, excess(jnp.asarray(FARTHEST)) >= 0)

    return jax.vmap(base)(ways, losses)


def _loss_harmonic(plant: AbstractOscillator, _: Scalar, way: Scalar, time: Scalar) -> Scalar:
    """The energy dissipated in a quarter cycle of a harmonic motion with the swing's whole way as amplitude, J.

    Source: Chatlatanagulchai, Moonmangmee and Intarawirat (2017), after Eq. 5: for the cubic damper c w⁴ ω³ 3π/16
    (the printed terms are dimensionally wrong). It over-estimates the loss of the papers' plant tenfold.
    """
    omega = jnp.pi / time

    def power_by_phase(phase: Scalar) -> Scalar:
        speed = jnp.abs(way) * omega * jnp.sin(phase)
        return plant.damper.force(speed) * speed / omega

    return integral(power_by_phase, 0.0, jnp.pi / 2)


def _loss_orbit(plant: AbstractOscillator, base: Scalar, way: Scalar, _: Scalar) -> Scalar:
    """The energy dissipated along the undamped orbit of the swing, J: the damper's force over its way."""
    return swing_integral(plant, -base, way - base, plant.damper.force)


@kept
def _exact_swing(
    plant: AbstractOscillator, base: Scalar, way: Scalar, time: Scalar, steps: int
) -> tuple[Scalar, Scalar, Scalar]:
    """The base position and time for which the damped payload comes to rest exactly at the end of its way, and the
    error."""
    unit = jnp.stack([way, way / time])

    def conditions(x: Array) -> tuple[Array, Array]:
        (end,), error = states_at(plant, way, x[:1], x[1:], steps)
        return end / unit - jnp.array([1.0, 0.0]), error / unit

    solution, error = newton(conditions, jnp.stack([base / way, time]))
    return solution[0] * way, solution[1], error


def _effective(plant: AbstractOscillator, damping: str) -> str:
    """The treatment of damping: ``"ignore"`` where the damper's force vanishes."""
    if damping == "ignore":
        return damping
    forces = jnp.stack([jnp.asarray(plant.damper.force(jnp.asarray(v))) for v in (1e-3, 0.1, 10.0)])
    return "ignore" if _check.is_concrete(forces) and not np.any(np.asarray(forces)) else damping


def _fraction(value: Any, name: str) -> Scalar:
    """A number between 0 and 1."""
    value = _check.scalar(value, name)
    if _check.is_concrete(value) and not 0 < float(value) < 1:
        raise ValueError(f"{name} must lie between 0 and 1, not {float(value)}")
    return value


def _check_arguments(plant: Any, distance: Any, damping: str, allowed: tuple[str, ...] = DAMPING) -> Scalar:
    """The distance, checked together with the other arguments."""
    if not isinstance(plant, AbstractOscillator) or plant.drives()[0] != "displacement":
        raise ValueError(
            f"plant must be a displacement-driven mass on a spring, such as TwoMass, not {type(plant).__name__}"
        )
    _check.one_of(damping, "damping", allowed)
    size = _check.scalar(distance, "distance")
    _check.not_zero(size, "distance")
    _check.warn_if_single()
    return size


def _checked(amplitudes: Array | np.ndarray, times: Array | np.ndarray, size: Scalar) -> Shaper:
    """The shaper, unless a number of it is not finite."""
    if _check.is_concrete(amplitudes, times) and not np.all(np.isfinite(np.concatenate([amplitudes, times]))):
        raise ValueError(
            f"distance: this spring does not carry the payload over {_check.show(size)} m that way: the swing "
            "diverges, or the damper takes more than the base can give; or a force bends where no kink is named, or is "
            "too steep for its times to be known"
        )
    return Shaper(amplitudes, times)
