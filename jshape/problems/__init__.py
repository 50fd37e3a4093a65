"""Problem files: read, checked and made a problem; ``jshape tune paper_001`` finds the shipped ones.

- ``problem``: ``load``: a file as plant, command, uncertain set and design; begin here.
- ``reading``: ``read``: a file found, checked key by key and converted to SI units, before JAX is loaded.
- ``limits``: sizes and nesting that a file may have; the TOML is parsed here.
- ``schema``: the tables of a file, as pydantic models.
- ``mistakes``: what pydantic finds wrong, in words.
- ``lines``: the line of each key, and ``ProblemError``.
- ``units``: quantities with units, such as ``"250 mm"``.
- ``catalogue``: the classes that a file may name, and the keys of each.
- ``machine_files``: the MJCF or URDF file that a problem names.
- ``echo``: a problem as it was understood, in a few lines.
- ``starters``: files to begin from, one for each plant: ``jshape new``.
- ``own_plant``: a plant of a user's own, the example of ``own_plant.toml``.
"""
