"""A plant as a functional mock-up unit: its equations in C, for the simulator of a controller or of a whole machine."""

import functools
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jshape import _check
from jshape._files import whole
from jshape.export.equations import number, written_out
from jshape.export.fmu import Variable, unit
from jshape.export.text import fill, identifier
from jshape.plants.base import AbstractPlant

FORMATS = ("fmu",)


def export_plant(
    plant: AbstractPlant, format: str = "fmu", path: str | Path | None = None, *, name: str = "plant", fmi: str = "2.0"
) -> bytes:
    """A plant's equations of motion as a unit that a simulator runs without Python.

    Its inputs are what drives the plant, its outputs the states, which begin at rest at input 0, and the energy above
    rest. Parameters are written in as numbers. In co-simulation inputs hold over a step and the states are integrated
    by Dormand and Prince's method to a relative tolerance of 1e-11; in model exchange the simulator integrates.

    Args:
        plant: whose equations are made of elementary operations.
        format: ``"fmu"``.
        path: a file, overwritten if it exists.
        name: of the unit.
        fmi: ``"2.0"`` or ``"3.0"``.

    Returns:
        The bytes of the file.

    Raises:
        ValueError: for an unknown format, a plant that is being traced, depends on time or has an operation that cannot
            be written out, which is named, and where there is no C compiler.
    """
    _check.one_of(format, "format", FORMATS)
    _check.instance(plant, "plant", AbstractPlant, "one of jshape's plants")
    if not _check.is_concrete(plant):
        raise ValueError("a plant that is being traced cannot be exported")
    name, kind = identifier(name, "c99"), type(plant).__name__
    inputs, structure = _inputs(plant), jax.tree.structure(plant.zero_inputs())
    rest = np.asarray(plant.rest_state(plant.zero_inputs()), float)
    if rest.ndim != 1:
        raise ValueError(f"plant: {kind} is no single plant; such plants are not written out")
    states = [f"x[{i}]" for i in range(len(rest))]
    names = [np.array(states, object), *(np.array(f"m->real[{i}]", object) for i in range(len(inputs)))]
    as_inputs = functools.partial(jax.tree.unflatten, structure)
    example: list[Any] = [jnp.asarray(rest), *(jnp.zeros((), rest.dtype) for _ in inputs)]
    time = np.array("TIME", object)

    def slopes(t: Any, x: Any, *u: Any) -> Any:
        return plant.vector_field(t, x, as_inputs(u))

    def stored(x: Any, *u: Any) -> Any:
        return jnp.reshape(plant.residual_energy(x, as_inputs(u)), (1,))

    try:
        field, derivatives = written_out(slopes, [time, *names], [jnp.zeros(()), *example])
        energy, (total,) = written_out(stored, names, example)
    except ValueError as error:
        raise ValueError(f"plant: {kind} cannot be written out in C: it has the operation {error}") from None
    if any("TIME" in line for line in [*field, *derivatives]):
        raise ValueError(f"plant: {kind} depends on time; such plants are not written out")
    equations = fill(
        "fmu/plant_equations.h",
        kind=kind,
        rest=[f"m->real[{len(inputs) + i}] = {number(value)};" for i, value in enumerate(rest)],
        field=[*field, *(f"dx[{i}] = {each};" for i, each in enumerate(derivatives))],
        energy=[*energy, f"m->real[N_REAL - 1] = {total};"],
    )
    settable = len(inputs) + len(rest)
    variables = _variables(inputs, rest.tolist(), plant.energy_unit)
    made = unit(name, variables, settable, len(rest), "typedef int Own;\n", {"equations.h": equations}, fmi)
    if path is not None:
        with whole(_check.path(path)) as file:
            file.write(made)
    return made


def _variables(inputs: list[str], rest: list[float], unit: str) -> list[Variable]:
    """The unit's variables in its order: inputs, states, their derivatives, the energy."""
    variables = [Variable(drive, "input", "continuous", f"{drive} that drives the plant", 0.0) for drive in inputs]
    variables += [
        Variable(f"state[{i}]", "output", "continuous", "state of the plant", value) for i, value in enumerate(rest, 1)
    ]
    variables += [
        Variable(f"der(state[{i + 1}])", "local", "continuous", "its derivative", derivative_of=len(inputs) + i)
        for i in range(len(rest))
    ]
    return [*variables, Variable("energy", "output", "continuous", f"energy above that of rest, {unit}")]


def _inputs(plant: AbstractPlant) -> list[str]:
    """Names of what drives a plant; of several axes, each with that of its axis."""
    if plant.axes:
        return [f"{axis}_{drive}" for i, axis in enumerate(plant.axes) for drive in plant.drives(i)]
    drives = plant.drives()
    return [drive if drives.count(drive) == 1 else f"{drive}_{i}" for i, drive in enumerate(drives, 1)]
