"""Strategies: what is identified, when, and how the shaper follows.

- ``strategy``: ``AbstractStrategy``: readings in, command out, every sample.
- ``direct_adaptive``: ``DirectAdaptive``, ZVD filters retuned by a sliding DFT.
- ``extremum_seeking``: ``ExtremumSeeking``, parameters of least cost without a model.
- ``gradient_seeking``: ``GradientSeeking``, a model's parameters fitted to the vibration, move by move.
- ``state_aware``: ``StateAware``, which also cancels the vibration at the beginning of a move.
- ``replanning``: a move planned anew while it runs.
- ``paper_cases``: the strategies of a paper, with its parameters.
"""
