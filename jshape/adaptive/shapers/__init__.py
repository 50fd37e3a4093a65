"""Shapers that change while they run, without a jump in the command.

- ``adaptive_shaper``: ``AdaptiveShaper``, a cascade of digital filters, one a mode.
- ``cascade``: the cascade as it runs, sample by sample.
- ``taps``: the taps of its filters.
- ``increments``: ``IncrementShaper``: each change of the reference by the shaper of its moment.
- ``transition``: a robust shaper that also cancels the vibration at the beginning of a move.
- ``repeated``: what steps leave that follow each other quickly.
"""
