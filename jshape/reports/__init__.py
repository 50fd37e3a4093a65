"""Reports: figures, tables and result files, written in one place for all commands.

- ``report``: every shaper of a problem compared; ``results``: sweeps and fronts as files.
- ``plot``: figures; ``tables``: what the command line prints.
"""
