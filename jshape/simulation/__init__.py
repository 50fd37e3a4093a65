"""Simulation: a plant, a command and a shaper give a trajectory.

- ``simulate``: ``js.simulate``: responses with samples; final states by fixed steps.
- ``schedule``: command and shaper as the segments on each of which one polynomial drives the plant.
- ``steps``: how many steps each segment takes, and their verification.
- ``integrate``: the fixed-step Runge–Kutta kernel.
- ``components``: the kernel's field, written out by components.
- ``angles``: sine and cosine for it that run in vector units.
- ``batches``: the loops of ``steps`` under ``vmap``.
- ``replay``: a move with numbers of steps that are known: the run that is differentiated.
- ``residual``: the state after the last impulse and its energy, each with its accuracy.
- ``trajectory``: a quantity along a move, its extremes and crossings.
- ``peaks``: its peaks by few long steps, with their derivatives, for limits.
- ``response``: ``js.Response``, the result of a simulation.
- ``energy_profile``: kinetic and potential energy against position along a move.
- ``solver``: the kernel's step as a diffrax solver.
"""
