"""Simulation: a plant, a command and a shaper give a trajectory.

- ``schedule``: command and shaper as the segments on each of which one polynomial drives the plant.
- ``integrate``: the fixed-step Runge–Kutta kernel; ``components``: its field written out by components.
- ``simulate``: responses with samples, by adaptive or fixed steps; ``solver``: the kernel's step as a diffrax solver.
- ``steps``: how many steps each segment takes, and their verification; ``batches``: its loops under ``vmap``.
- ``residual``: the state after the last impulse and its energy.
- ``trajectory``: a quantity along a move, its extremes and crossings.
"""
