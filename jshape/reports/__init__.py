"""Reports: figures, tables and result files, written in one place for all commands.

- ``report``: every shaper of a problem compared: ``jshape tune`` and ``jshape compare``.
- ``limits_kept``: which limits on the move each of them exceeds.
- ``responses``: the responses that are drawn.
- ``report_files``: the folder of a report: numbers, shapers, the problem, figures.
- ``results``: the files of a sweep or a front.
- ``tables``: what the prompt shows.
- ``plot``: figures for papers, ``js.plot``.
- ``motion``: figures of how a machine moves.
- ``style``: colours, fonts and widths of all figures.
- ``film``: a machine without a shaper beside the same with one.
- ``drawings``: machines in motion, drawn by their kind.
- ``places``: where a machine's parts are while it moves.
- ``rendered``: pictures of a machine from MJCF or URDF.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__, ["film", "motion", "plot", "report", "results", "style", "tables"], {"tables": ["latex_table"]}
)
