"""Benchmarks beside other software, each with its table."""
