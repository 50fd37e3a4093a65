"""The five papers, reproduced and surpassed: ``python -m experiments.papers``."""
