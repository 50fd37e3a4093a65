"""Tuning by gradient: shapers for any plant, any command and any objective.

- ``tune``: the function; ``pareto``: worst residual against duration.
- ``scenarios``: the moves that a design is judged by, and a design; ``bounds``: which designs are considered;
  ``objective``: nominal, mean, worst case, CVaR; ``constraints``: limits on speed, overshoot and deflection;
  ``design_problem``: all of that from the arguments.
- ``starts`` → ``search`` → ``solution``: from which points the search begins, the search, the result.
- ``zero_energy``, ``adam``, ``local_search`` (on a ``scaled_problem``, by turns: ``computing``): the optimisers;
  ``digital``: impulses at multiples of a sample time.
- ``evaluate``: energies, slacks and their Jacobians, compiled.
"""
