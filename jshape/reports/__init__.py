"""Reports: figures, tables and result files, written in one place for all commands.

- ``report``: every shaper of a problem compared; ``results``: sweeps and fronts as files.
- ``plot``: figures; ``tables``: what the command line prints.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, ["plot", "report", "results", "tables"])
