"""Identifiers: frequency and damping ratio of a vibration while it is measured, sample by sample."""
