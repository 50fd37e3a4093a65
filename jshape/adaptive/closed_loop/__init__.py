"""The closed loop: strategies on a sampled flexible link whose load changes, and their metrics.

- ``report``: an experiment from beginning to end: ``jshape adapt``.
- ``schedules``: moves, and loads that change unannounced.
- ``sampled_link``: the link between two samples, exactly.
- ``loop``: link, sensors and strategies, sample by sample.
- ``faults``: faults of sensors.
- ``metrics``: residual vibration and settling time, move by move.
- ``monte_carlo``: recovery in hundreds of random schedules.
- ``loop_figures``: the figures of a run.
"""
