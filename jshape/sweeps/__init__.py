"""Sweeps: metrics of many uncertain plants.

- ``leaves``: parameters of a plant by dotted path, uncertain sets and their grids; ``sampling``: random sets.
- ``chunks``: sets cut into chunks, in buckets of similar frequencies; ``evaluate``: the metrics of a chunk.
- ``quantities``: metrics, shapers and leaves by name, with their units.
- ``sweep``: the study as a dataset; ``sobol``: which leaf matters.
- ``checkpoint``: a sweep that resumes after an interruption; ``dask``: the workers of a cluster.
"""
