"""Sweeps: metrics of many uncertain plants.

- ``sweep``: ``js.sweep``: the study as a dataset; begin here.
- ``sobol``: ``js.sensitivity_indices``: which leaf the spread of a metric comes from.
- ``quantities``: metrics, shapers and leaves by name, with their units.
- ``leaves``: parameters of a plant by dotted path, uncertain sets and their grids.
- ``sampling``: random sets.
- ``evaluate``: the metrics of a set, chunk by chunk, on all local devices or a cluster.
- ``chunks``: sets cut into chunks of plants with similar frequencies.
- ``checkpoint``: finished chunks on disk: an interrupted sweep is resumed here.
- ``dask``: chunks sent to the workers of a cluster.
"""
