"""The oracles of the environments' presets, designed in double precision: the tables that the package carries.

    python -m experiments.learning.oracles        # some minutes; writes envs/jshape_envs/tables

An oracle's shaper is the cheapest one that leaves next to nothing; ``jshape.moves.design`` says how it is found. Names
of environments as arguments: only theirs.
"""

import sys
import time
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)

from jshape_envs import ENVIRONMENTS, parameters  # noqa: E402
from jshape_envs.parameters import TABLE_FORMAT, TABLES, table_file  # noqa: E402

from jshape._files import write_arrays  # noqa: E402
from jshape.moves import design_table  # noqa: E402


def main(names: list[str]) -> None:
    TABLES.mkdir(exist_ok=True)
    for name in names or list(ENVIRONMENTS):
        for preset in ENVIRONMENTS[name].presets:
            begin = time.perf_counter()
            p = parameters(name, preset, dtype=jnp.float64)
            weights = p.energy_weight, p.time_weight
            grid = ENVIRONMENTS[name].grid
            table = design_table(p.machine, p.payload, p.distance, weights, p.period, p.steps, grid)
            # Single precision keeps the file small and loses nothing: the costs are flat about the shapers.
            arrays: Any = {key: np.asarray(getattr(table, key), np.float32) for key in table.__dataclass_fields__}
            path = table_file(name, preset)
            write_arrays(path, TABLE_FORMAT, {"environment": name, "preset": preset}, arrays)
            took, size = time.perf_counter() - begin, path.stat().st_size / 1024
            print(f"{name}, {preset}: {took:.1f} s, {size:.0f} kB", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
