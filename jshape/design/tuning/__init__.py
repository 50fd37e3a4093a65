"""Tuning by gradient: shapers for any plant, any command and any objective.

- ``tune``: the function; ``pareto``: worst residual against duration.
- ``task``, ``prepare``: the problem as arrays; ``bounds``: amplitudes and times from free variables;
  ``constraints``: limits on speed, overshoot and deflection; ``objective``: nominal, mean, worst case, CVaR.
- ``starts``, ``search``: from which points the search begins, and the search.
- ``levenberg_marquardt``, ``adam``, ``slsqp``: the optimisers; ``digital``: impulses on a controller's ticks.
- ``solution``: what comes back.
"""
