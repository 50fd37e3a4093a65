"""Tuning by gradient: shapers for any plant, any command and any objective.

What is asked for:

- ``tune``: ``js.tune``; begin here.
- ``pareto``: ``js.pareto``, the worst residual against the duration.
- ``design_problem``: the problem that both solve, made from their arguments.
- ``scenarios``: the moves that a design is judged by, their limits (``Limits``), and a design (``Point``).
- ``bounds``: which amplitudes, durations and leaves are considered.
- ``objective``: nominal, mean, worst case or CVaR: one number from the energies of many plants.
- ``constraints``: the limits as differentiable slacks.

Energies of a design:

- ``evaluate``: energies, slacks and their Jacobians, as compiled programs.
- ``scaled_problem``: the problem with variables of the order of 1; values at any tolerance, first-order conditions.
- ``computing``: computations that wait for a program, so that one thread keeps several searches going.
- ``interval``: the worst plants between those that were given, and those that exceed a limit most.

The search:

- ``starts``: starting points: closed forms first, random designs after them.
- ``search``: ranks the starting points, runs the optimisers below from the best, judges what they find.
- ``exchange``: the best designs met, judged on worse and worse plants between those that were given.
- ``linear_models``: further starting points, from linear models of the plants.
- ``linear_times``: the times that are tried on these models.
- ``zero_energy``: one plant: Levenberg–Marquardt to zero residual energy.
- ``adam``: first-order descent, all starts side by side.
- ``local_search``: the trust region; the worst case is minimised here.
- ``epigraph``: the worst case as a smooth program, and its solution by SLSQP.
- ``interior_point``: the same program for the models of ``local_search``, compiled.
- ``restarts``: local searches begun anew, to find out whether there are better optima.
- ``digital``: impulses at multiples of a sample time.

The result:

- ``judging``: a design judged on a finer set, under a tighter tolerance; its status.
- ``messages``: the parts of its message.
- ``solution``: ``js.Solution``, the result.
"""
