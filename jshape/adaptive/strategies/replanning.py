"""Planning anew within a move: what is still to come follows the payload that the first impulses have shown.

A move is a sum of small steps, and on a linear link each step leaves a phasor that is known from the mode's pole alone:
what has been commanded so far and the swing with which the move began make a sum whose value, for any pole, needs no
simulation. When the pole estimated from the samples of this move says that the plan would leave something, the
remaining impulses are replaced by five others that sum to what is missing of the move, cancel the phasor there will be,
and do so to first order for poles nearby (``shapers.transition``). Estimates count once the identifier's lags have seen
the move. The load is taken to be the same since the move began: of one that changes within the move, part is left.

The command does not jump: what has been commanded stays, and only increments that have not come yet are replaced. They
begin at the instant, up to half a period later, that asks for the least back and forth, and never later than a period
after the move began. A plan that goes back and forth by more than ``sway`` is not taken. Without new estimates, when a
sensor is dead, frozen or silent, the plan stays the old one.
"""

from typing import Any, NamedTuple

import numpy as np

from jshape.adaptive.formulas import Numbers
from jshape.adaptive.shapers.increments import Queue
from jshape.adaptive.shapers.transition import transition

DELAYS = 9
"""Instants at which a new plan may begin, evenly over half a period."""
TOLERANCE = 0.02
"""Vibration, over that of a bare step, that a plan may leave by the estimate before it is replaced."""


class Plan(NamedTuple):
    """All increments of the move under way, those of the past too, a row a plan."""

    amounts: Any
    """In the reference's unit, (plans, impulses)."""
    times: Any
    """s since the move began, (plans, impulses)."""
    swing: Any
    """The phasor with which the move began, in the sensor's unit; 0 where it is not known."""
    age: Any
    """Samples since the move began."""
    change: Any
    """How far the move goes, in the reference's unit."""
    made: Any
    """Number of plans so far, the first included; 0 where the move may not be planned anew."""
    wait: Any
    """s since the move began before which the plan stays."""


def no_plan(plans: int, impulses: int) -> Plan:
    """The record of a machine at rest."""
    empty = np.zeros((plans, impulses))
    return Plan(empty, empty, 0j, 0, 0.0, 0, 0.0)


def begun(
    numbers: Numbers, plan: Plan, change: Any, alone: Any, shaper: tuple[Any, Any], swing: Any, wait: Any
) -> Plan:
    """The record of a move that begins with this sample.

    Args:
        numbers: JAX or NumPy.
        plan: of the last move.
        change: of the reference.
        alone: whether nothing of the last move was still to come.
        shaper: amplitudes and times (s).
        swing: with which it begins.
        wait: s until the mode that is estimated may count.
    """
    xp, first = numbers.xp, np.arange(len(plan.amounts))[:, None] == 0
    amplitudes, times = shaper
    return Plan(
        xp.where(first, (amplitudes * change)[None], 0.0),
        xp.where(first, times[None], 0.0),
        swing,
        0 * plan.age,
        change,
        0 * plan.made + numbers.select(alone, 1, 0),
        0 * plan.wait + wait,
    )


def replanned(
    own: Any, numbers: Numbers, queue: Queue, plan: Plan, omega: Any, zeta: Any, unit: Any
) -> tuple[Queue, Plan]:
    """Queue and record with a new plan where the old one would leave something; looked at again a little later.

    Args:
        own: a ``StateAware``'s fields.
        numbers: JAX or NumPy.
        queue: after this sample.
        plan: the record of the move.
        omega: of the first mode, rad/s, as it is now known.
        zeta: its damping ratio.
        unit: the phasor that a step of 1 in the motor's reference gives the mode, in the sensor's unit.
    """
    xp = numbers.xp
    pole = omega * (-zeta + 1j * xp.sqrt(1 - zeta * zeta))
    plan = plan._replace(wait=plan.age * own.sample_time + 0.25 / own.identifier.corner)
    waves, swing = xp.exp(-pole * plan.times), plan.swing / unit
    end = xp.max(xp.where(plan.amounts == 0, 0.0, plan.times))
    leaves = abs((xp.sum(plan.amounts * waves) + swing) * xp.exp(pole * end))

    def anew(queue: Queue, plan: Plan) -> tuple[Queue, Plan]:
        return _anew(own, numbers, queue, plan, omega, zeta, swing)

    return numbers.when(leaves > TOLERANCE * abs(plan.change), anew, lambda *same: same, queue, plan)


def _anew(
    own: Any, numbers: Numbers, queue: Queue, plan: Plan, omega: Any, zeta: Any, swing: Any
) -> tuple[Queue, Plan]:
    """Queue and record with the best new plan, unless it begins too late or goes back and forth too much.

    ``swing``: with which the move began, over the phasor of a step of 1.
    """
    xp, time, others = numbers.xp, own.sample_time, own.others
    root = xp.sqrt(1 - zeta * zeta)
    pole, quarter = omega * (-zeta + 1j * root), np.pi / (2 * omega * root)
    # A group of the other modes' impulses that has begun is not torn apart.
    count = len(others.times)
    groups = xp.repeat(plan.times[:, ::count], count, axis=1)
    kept = xp.where(xp.floor(groups / time) <= plan.age, plan.amounts, 0.0)
    begin = (plan.age + 1) * time
    room = 4 * quarter - begin
    starts = begin + xp.clip(room, 0.0, 2 * quarter) * np.linspace(0.0, 1.0, DELAYS)

    # The phasor that there will be at each start, and how it depends on the pole.
    waves, turns = kept * xp.exp(-pole * plan.times), xp.exp(pole * starts)
    past = (xp.sum(waves) + swing) * turns
    turn = xp.sum(plan.times * waves) * turns - starts * past
    waves = others.amplitudes * xp.exp(-pole * others.times)
    through = xp.sum(waves)
    rest = -past / through
    slope = -(turn + rest * xp.sum(waves * others.times)) / through
    missing, size = plan.change - xp.sum(kept), abs(plan.change)
    tries, times = transition(numbers, omega, zeta, missing, rest, slope)
    sway = xp.sum(abs(tries), axis=0) - abs(missing)
    # The earliest of those that are about as good as the best.
    best = xp.argmin(xp.maximum(sway, 0.02 * size) + 1e-3 * size * np.arange(DELAYS))
    amounts = (tries[:, best][:, None] * others.amplitudes[None, :]).reshape(-1)
    times = (starts[best] + times[:, None] + others.times[None, :]).reshape(-1)

    row = np.arange(len(plan.amounts))[:, None] == plan.made
    new = plan._replace(
        amounts=xp.where(row, amounts[None], kept), times=xp.where(row, times[None], plan.times), made=plan.made + 1
    )
    # One between two samples comes in two parts.
    left = kept * (1 - xp.clip(plan.age + 1 - plan.times / time, 0.0, 1.0))
    amounts, times = (xp.concatenate([x.reshape(-1), y]) for x, y in ((left, amounts), (plan.times, times)))
    after = own.queue.replaced(numbers, queue, amounts, times - begin)
    return numbers.select((room >= 0) & (sway[best] <= own.sway * size), (after, new), (queue, plan))
