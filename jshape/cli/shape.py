"""``jshape shape``: a sampled trajectory of joints, shaped joint by joint."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from jshape.cli._shared import check_new, explained, prepare_jax, say
from jshape.cli.export import seconds

if TYPE_CHECKING:
    from jshape.shaper import Shaper
    from jshape.trajectories.files import Trajectory
    from jshape.trajectories.shaping import Effect


@explained()
def shape(
    trajectory: Annotated[
        Path,
        typer.Argument(
            help="CSV with the time first, then a column a joint; or JSON with the fields of ROS's JointTrajectory."
        ),
    ],
    shaper: Annotated[
        Path | None, typer.Argument(help="A shaper file (JSON, CSV or npz) for all joints that --joint does not name.")
    ] = None,
    joint: Annotated[
        list[str], typer.Option(help="JOINT=FILE, a shaper of its own, or JOINT= for none; several times.")
    ] = [],  # noqa: B006
    sample_time: Annotated[
        str | None,
        typer.Option(help="Of the result, s, or with a unit as in '4 ms'; the trajectory's own unless given."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="The file to write; NAME-shaped in its folder unless given.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Write over files that exist.")] = False,
) -> None:
    """Shape a robot's sampled trajectory joint by joint, and say what it does to its duration and its path."""
    from jshape.trajectories.files import read_trajectory, write_trajectory

    given = read_trajectory(trajectory)
    path = out or trajectory.with_name(f"{trajectory.stem}-shaped{trajectory.suffix}")
    drawing = path.with_suffix(".png")
    if path.suffix.lower() in (".png", ".pdf"):
        raise ValueError(f"{path}: is the name of the drawing; give the trajectory another one with --out")
    check_new(force, path, drawing, drawing.with_suffix(".pdf"))
    prepare_jax()
    from jshape.reports import plot
    from jshape.trajectories import shaping

    shapers, files = _chosen(given, shaper, joint)
    try:
        step = shaping.sample_time(given) if sample_time is None else seconds(sample_time, "--sample-time")
        effect = shaping.shape(given, shapers, step)
    except ValueError as error:
        raise ValueError(f"{trajectory}: {error}") from None
    write_trajectory(path, effect.trajectory)
    labels = [f"{name} ({unit})" if unit else name for name, unit in zip(given.names, given.units, strict=True)]
    plot.save(plot.joints(shaping.curve(given), shaping.curve(effect.trajectory), labels), drawing)
    _show(given, effect, files, step)
    say(f"{path}: written, drawn in {drawing.name}")


def _chosen(
    trajectory: "Trajectory", shaper: Path | None, joint: list[str]
) -> tuple[dict[str, "Shaper"], dict[str, str]]:
    """The shaper of each joint that is shaped, and the name of its file.

    Raises:
        ValueError: for no shaper at all, and for what is not JOINT=FILE or names a joint that there is not.
    """
    from jshape.export import read_shaper

    files = {} if shaper is None else dict.fromkeys(trajectory.names, str(shaper))
    for text in joint:
        # The name of a joint may have a "=" in it, too.
        names = [name for name in trajectory.names if text.startswith(f"{name}=")]
        if not names:
            raise ValueError(f"--joint must be JOINT=FILE with one of {', '.join(trajectory.names)}, not {text!r}")
        name = max(names, key=len)
        files[name] = text.removeprefix(f"{name}=")
    files = {name: file for name, file in files.items() if file}
    if not files:
        raise ValueError("give a shaper file, or one for a joint by --joint JOINT=FILE")
    read = {file: read_shaper(file) for file in dict.fromkeys(files.values())}
    return {name: read[file] for name, file in files.items()}, files


def _show(before: "Trajectory", effect: "Effect", files: dict[str, str], step: float) -> None:
    """The effect of shaping on the duration and on the path, by joint."""
    import numpy as np

    from jshape.reports.tables import new_console, number, say, show_table

    console = new_console()
    rows = [
        (name, [Path(files[name]).stem if name in files else "none", unit, *map(number, numbers)])
        for name, unit, *numbers in zip(
            before.names, before.units, effect.seconds, effect.behind, effect.between, strict=True
        )
    ]
    headings = ["shaper", "unit", "longer\n(s)", "behind,\nat most", "between\nsamples"]
    show_table(console, "joint", headings, rows)
    took = before.times[-1] - before.times[0]
    say(console, f"duration: {took:.6g} s before, {took + effect.seconds.max():.6g} s shaped; a sample {step:.6g} s")
    for unit, value in effect.path.items():
        if len(effect.path) > 1 and before.units.count(unit) == 1:
            continue  # A joint alone never leaves its path; how far it is behind stands above.
        of = "" if len(effect.path) == 1 else f" of the joints in {unit or 'no unit'}"
        amount = f"{number(value)} {unit}".rstrip()
        say(console, f"path{of}: departs from the unshaped one by {amount} at most")
    say(
        console,
        "between samples: how far the written points, joined as those of the trajectory, are from exact shaping",
    )
    moving = [
        name
        for j, name in enumerate(before.names)
        if np.any(np.abs(before.states[[0, -1], j, 1:]) > 1e-6 * np.max(np.abs(before.states[:, j, 1:]), axis=0))
    ]
    if moving:
        say(
            console,
            f"note: {', '.join(moving)} move at the first or the last point; shaping takes them as at rest there",
        )
    if effect.seconds.max() > took:
        say(console, f"note: shaping takes {effect.seconds.max():.6g} s, longer than the motion: are its times in s?")
    if len(set(effect.seconds)) > 1:
        say(console, "note: joints with different shapers no longer move in step, so that the path departs more")
