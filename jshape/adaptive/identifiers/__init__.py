"""Identifiers: frequency and damping ratio of a vibration while it is measured, sample by sample.

- ``sliding_dft``: ``SlidingDFT``, the peak of a running spectrum.
- ``damped_sinusoids``: ``DampedSinusoids``, a fit to a short window, several modes.
- ``frequency_tracker``: ``FrequencyTracker``, an extended Kalman filter, without a window.
- ``decrement``: ``Decrement``, the logarithmic decrement.
- ``least_squares``: ``FilteredLeastSquares``, a mode from its drive and response.
- ``estimate``: ``Estimate`` and ``AbstractIdentifier``, which all share.
- ``reasons``: why an estimate is valid or not.
- ``sensor``: samples checked and replaced before they are used.
"""
