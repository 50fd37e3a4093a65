"""Minimum-time on-off inputs from any initial state: bang-bang filters, transitions and moves.

The minimum-time input of a machine with a limited force is at the limit throughout::

    f = js.design.switching.time_optimal_filter(9.0, 0.017, [0.001, 0.0])     # from a state that is not rest
    f.switches, f.shaper, f.status, f.message
    js.design.switching.time_optimal_filter(9.0, 0.017, None, robust=True)             # a ZVD
    js.design.switching.time_optimal_filter(9.0, 0.017, None, (8.0, 10.0, 0.05))       # 5 % over a band
    js.design.switching.digital_filter(9.0, 0.017, None, sample_time=0.005)            # fewest samples
    m = js.design.switching.rest_to_rest(3.13, 0.0, 1.0, limit=0.5)                    # with a rigid body
    js.simulate(crane, m.motion)

Each takes one mode or several, x'' + 2ζω x' + ω² x = u. A linear program finds the switches, Newton's method makes
their times exact, and the switching function of the minimum principle proves that nothing is faster. ``tuned`` moves
the switches of such a design for a nonlinear plant.

A move that begins before the last has settled is designed from the state predicted for its beginning::

    late = js.design.switching.rest_to_rest(3.13, 0.0, 2.0, m.state_at(0.8), limit=0.5)
    both = m.followed_by(late, 0.8)

- ``_design``: what users call.
- ``_arguments``: its arguments, checked.
- ``_problem``: the conditions, linear in the input's jumps.
- ``_linear_program``: the minimum-time linear program.
- ``_digital``: limits at every sample of a digital input.
- ``_optimality``: switching times made exact.
- ``_minimum_principle``: the proof that nothing is faster.
- ``_switched``: ``Switched``, the result.
- ``_tuned``: switching times for a nonlinear plant.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
