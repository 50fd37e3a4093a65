"""Reports: figures, tables and result files, written in one place for all commands.

- ``report``: every shaper of a problem compared; ``results``: sweeps and fronts as files.
- ``plot``: figures, with ``style``, their look, and ``motion`` and ``film``, those of moves.
- ``drawings``: machines in motion.
- ``tables``: what the prompt shows.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__, ["film", "motion", "plot", "report", "results", "style", "tables"], {"tables": ["latex_table"]}
)
