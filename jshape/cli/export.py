"""``jshape export``: a shaper file as a program, a filter or a line of firmware configuration."""

from pathlib import Path
from typing import Annotated, Any

import typer

from jshape.cli._shared import check_new, explained, prepare_jax, say
from jshape.problems.units import quantity


@explained()
def export(
    shaper: Annotated[
        Path | None, typer.Argument(help="A shaper file (JSON, CSV or npz), or a folder of jshape tune: its tuned one.")
    ] = None,
    format: Annotated[str | None, typer.Option(help="One of those that --list shows.")] = None,
    out: Annotated[Path | None, typer.Option(help="The file to write; the terminal unless given.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Write over a file that exists.")] = False,
    list_: Annotated[
        bool, typer.Option("--list", help="The formats, what they need and what they cannot carry.")
    ] = False,
    sample_time: Annotated[
        str | None,
        typer.Option(help="Of the controller, s, or with a unit as in '10 ms'; at most the shaper's duration."),
    ] = None,
    method: Annotated[str | None, typer.Option(help="How impulses meet samples: nearest, split or zeros.")] = None,
    mode: Annotated[
        list[str], typer.Option(help="A mode OMEGA,ZETA (rad/s, or '3 Hz,0.02') to cancel or to judge; several times.")
    ] = [],  # noqa: B006
    name: Annotated[str | None, typer.Option(help="Of the shaper, the function block, the C types.")] = None,
    arithmetic: Annotated[str | None, typer.Option(help="Of C: float, double, q15 or q31.")] = None,
    capacity: Annotated[int | None, typer.Option(help="Of the function block's ring buffer, cycles.")] = None,
    dialect: Annotated[str | None, typer.Option(help="Of Structured Text: iec, codesys, twincat or tia.")] = None,
    axis: Annotated[str | None, typer.Option(help="Of the printer: x or y.")] = None,
    firmware: Annotated[str | None, typer.Option(help="Klipper: current or 2024; RepRapFirmware: 3.6 or 3.4.")] = None,
    fmi: Annotated[str | None, typer.Option(help="Of the mock-up unit: 2.0 or 3.0.")] = None,
    tolerance: Annotated[
        float | None, typer.Option(help="How near to one of Klipper's own the shaper must be.")
    ] = None,
) -> None:
    """Write a shaper for a machine: C, Structured Text, FMU, printers, ROS, MATLAB, SciPy, NumPy, JSON, CSV."""
    prepare_jax()
    from jshape._files import whole
    from jshape.export import FORMATS, as_bytes, read_shaper, read_tuned
    from jshape.export import export as export_as
    from jshape.export.formats import axis_files

    if list_:
        show_formats(FORMATS)
        return
    if shaper is None or format is None:
        raise ValueError("give a shaper file and --format; --list shows the formats")
    given: dict[str, Any] = {
        "sample_time": None if sample_time is None else seconds(sample_time, "--sample-time"),
        "method": method,
        "modes": [pair(each) for each in mode] or None,
        "name": name,
        "arithmetic": arithmetic,
        "capacity": capacity,
        "dialect": dialect,
        "axis": axis,
        "firmware": firmware,
        "fmi": fmi,
        "tolerance": tolerance,
    }
    options = {option: value for option, value in given.items() if value is not None}
    read = read_tuned(shaper) if shaper.is_dir() else read_shaper(shaper)
    made = export_as(read, format, **options)
    axes = list(read) if isinstance(read, dict) else []
    if out is None:
        if axes:
            raise ValueError(f"--out must be given for a shaper for each axis: a file for {', '.join(axes)}")
        if not isinstance(made, str):
            raise ValueError(f"format {format!r} is no text; name a file with --out")
        typer.echo(made, nl=False)
        return
    files = {own: made[axis] for axis, own in axis_files(out, axes).items()} if axes else {out: made}
    check_new(force, *files)
    for path, content in files.items():
        with whole(path) as file:
            file.write(as_bytes(content))
    say(f"{', '.join(map(str, files))}: written ({FORMATS[format].what})")


def seconds(text: str, name: str) -> float:
    """``"10 ms"`` or ``"0.01"`` in s.

    Raises:
        ValueError: if it is no such time.
    """
    try:
        return in_unit(text, "s")
    except ValueError as error:
        raise ValueError(f"{name} {error}") from None


def in_unit(text: str, unit: str) -> float:
    """A number, in that unit unless it has one of its own."""
    try:
        return float(text)
    except ValueError:
        return float(quantity(text, unit))


def pair(text: str) -> tuple[float, float]:
    """``"9.0,0.017"`` or ``"1.43 Hz,0.017"`` as numbers, rad/s and –.

    Raises:
        ValueError: if it is no such pair.
    """
    try:
        omega, zeta = (in_unit(part, unit) for part, unit in zip(text.split(","), ("rad/s", ""), strict=True))
    except ValueError:
        raise ValueError(f"--mode must be OMEGA,ZETA such as 9.0,0.017, not {text!r}") from None
    return omega, zeta


def show_formats(formats: dict[str, Any]) -> None:
    """A line a format, and under it what it needs, takes and lacks."""
    for name, form in formats.items():
        flags = {option: "--" + option.replace("_", "-").replace("modes", "mode") for option in form.options}
        needs = ", ".join(flag for option, flag in flags.items() if form.options[option])
        takes = ", ".join(flag for option, flag in flags.items() if not form.options[option])
        say(f"{name} ({form.ending}): {form.what}")
        for words, value in (("needs", needs), ("takes", takes), ("cannot carry", form.lacks)):
            if value:
                say(f"    {words}: {value}")
