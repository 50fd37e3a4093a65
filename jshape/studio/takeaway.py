"""What a page gives away: every format of ``jshape.export``, the problem file, a Python script, the curves as CSV.

What needs JAX is imported where it is called, so that the page is there before that.
"""

import json
import math
from typing import Any

import numpy as np

from jshape._files import as_csv
from jshape.studio.results import Moves, Sensitivity
from jshape.studio.state import FILE, State, check_sizes, problem

USUAL = {"sample_time": "0.01"}
"""What stands at first in the field of an option that must be given."""

SIMPLEST = "linear ZV"
"""The closed form with which a machine begins."""


def needed(format: str) -> dict[str, str]:
    """The options of a format and what stands in their fields at first: empty where it may stay empty."""
    from jshape.export import FORMATS

    return {name: USUAL.get(name, "") if must else "" for name, must in FORMATS[format].options.items()}


def exported(state: State, format: str, fields: dict[str, str]) -> tuple[str, bytes]:
    """A file with the shaper of a page.

    Args:
        state: of the page.
        format: a name in ``jshape.export.FORMATS``.
        fields: option → what its field holds; an empty one is not given.

    Returns:
        The file's name and its bytes.

    Raises:
        ValueError: for what the format cannot carry, a missing option, and a field that cannot be read.
    """
    from jshape.export import FORMATS, as_bytes, export
    from jshape.studio.curves import shaper_of

    options = {name: _read(name, text.strip()) for name, text in fields.items() if text.strip()}
    made = export(shaper_of(state), format, **options)
    return f"shaper{f'_{state.axis}' if state.own else ''}{FORMATS[format].ending}", as_bytes(made)


def _read(name: str, text: str) -> Any:
    """An option as its field holds it: modes as ``"9.0,0.01; 20,0.02"`` (rad/s, –), numbers, words."""
    if name == "modes":
        try:
            return [tuple(_number(part) for part in pair.split(",")) for pair in text.split(";")]
        except ValueError:
            raise ValueError(f"modes must be pairs omega,zeta such as 9.0,0.017; 20,0.02, not {text!r}") from None
    try:
        return int(text) if text.isdecimal() and name == "capacity" else _number(text)
    except ValueError:
        return text


def _number(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"a number must be finite, not {text!r}")
    return number


def closed_form(state: State, name: str) -> tuple[list[float], list[float]]:
    """Amplitudes and times (s) of a closed-form shaper for the machine of a page.

    Raises:
        ValueError: for one that does not apply, with the reason.
    """
    from jshape.design.closed_forms import closed_forms

    check_sizes(state)
    asked = problem(state.text, state.files)
    found, left_out = closed_forms(asked.plant, asked.distance)
    if name not in found:
        reasons = [why for words, why in left_out.items() if words == name or words.split()[0] == name.split()[0]]
        raise ValueError(f"{name}: {'; '.join(reasons) or 'there is no such closed form'}")
    chosen = found[name]
    amplitudes, times = (np.asarray(values, float).tolist() for values in (chosen.amplitudes, chosen.times))
    return amplitudes, times


def script(state: State) -> str:
    """A Python script that does what the page does, beside its problem file."""
    each = [(state.axis, state.amplitudes, state.times), *((own.name, own.amplitudes, own.times) for own in state.own)]
    made = [f"js.Shaper(amplitudes={list(a)}, times={list(t)})" for _, a, t in each]
    names = [f"{axis!r}: {shaper}" for (axis, _, _), shaper in zip(each, made, strict=True)]
    shaper = f"{{{', '.join(names)}}}" if state.own else made[0]
    return f"""\
import jax
jax.config.update("jax_enable_x64", True)
import jshape as js
from jshape.problems.problem import load

problem = load({json.dumps(FILE)})
shaper = {shaper}
print("on the page:", js.residual_energy(problem.plant, shaper, problem.distance), "J")
tuned = js.tune(problem.plant, problem.distance, **problem.tuning)
print(tuned)
"""


def moves_csv(moves: Moves | None) -> str:
    """The responses as CSV: time (s), then every curve with its unit.

    Raises:
        ValueError: where they are not computed yet.
    """
    if moves is None:
        raise ValueError("the responses are being computed")
    columns = {"time (s)": moves.times}
    columns |= {f"position, {name} ({moves.unit})": values for name, values in moves.position.items()}
    columns |= {f"deflection, {name} ({moves.bent})": values for name, values in moves.deflection.items()}
    columns |= {f"energy, {name} (J)": values for name, values in moves.energy.items()}
    return _csv(columns)


def sensitivity_csv(found: Sensitivity | None) -> str:
    """The sensitivity as CSV: the leaf's values, then every curve.

    Raises:
        ValueError: where there is none, and for a draft, whose numbers are not those of the other commands.
    """
    if found is None or found.draft:
        raise ValueError("there is no sensitivity: nothing is uncertain, or it is being computed")
    return _csv({found.leaf: found.at} | {f"{found.quantity}, {name}": at for name, at in found.values.items()})


def _csv(columns: dict[str, np.ndarray]) -> str:
    return as_csv(columns, zip(*(values.tolist() for values in columns.values()), strict=True))
