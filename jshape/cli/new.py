"""``jshape new``: a problem file to begin from."""

from pathlib import Path
from typing import Annotated

import typer

from jshape.cli._shared import explained


@explained()
def new(
    path: Annotated[Path, typer.Argument(help="Where to write the problem file.")] = Path("problem.toml"),
    like: Annotated[str, typer.Option(help="The shipped problem to begin from.")] = "paper_001",
) -> None:
    """Write a commented problem file to begin from."""
    from jshape._files import write_text

    folder = Path(__file__).parents[1] / "problems"
    names = sorted(file.stem for file in folder.glob("*.toml"))
    if like not in names:
        raise ValueError(f"--like: there is no shipped problem {like!r}, only {', '.join(names)}")
    if path.exists():
        raise ValueError(f"{path}: exists already, and is left as it is")
    if not path.parent.is_dir():
        raise ValueError(f"{path.parent}: no such folder")
    files = {path: folder / f"{like}.toml"}
    code = folder / f"{like}.py"
    if code.exists():
        files[path.parent / code.name] = code
    for target, source in files.items():
        if not target.exists():
            write_text(target, source.read_text(encoding="utf-8"))
    typer.echo(f"{path}: written. Next: jshape tune {path}")
