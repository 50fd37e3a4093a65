"""A machine that an MJCF or URDF file describes, dropped on the page: read as data, alone, and without JAX.

Such a file may name no other one, so that nothing of this machine is read through it; MuJoCo reads its text, and what a
``Multibody`` does not simulate is refused by name when the plant is made.
"""

import functools
import re
from typing import Any, NamedTuple

from jshape.problems import limits
from jshape.problems.starters import Starter, find

ELSEWHERE = re.compile(r"\bfile\w*\s*=|<\s*(include|plugin|extension|model)\b(?!\s*>)|<!(?!--)", re.IGNORECASE)
"""What names another file, or calls for other code."""


class Joint(NamedTuple):
    """A joint of a machine.

    Attributes:
        name: of the joint.
        unit: of its coordinate, ``"m"`` or ``"rad"``.
        actuated: whether an actuator moves it.
    """

    name: str
    unit: str
    actuated: bool


def checked(name: str, content: bytes) -> str:
    """The text of a machine's file.

    Args:
        name: of the file.
        content: of the file.

    Raises:
        ValueError: for one that is too long, no text, names other files, or is not what MuJoCo accepts.
    """
    if len(content) > limits.SIZE:
        raise ValueError(f"{name}: must have at most {limits.SIZE} bytes, not {len(content)}")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError(f"{name}: cannot be read as text") from None
    if found := ELSEWHERE.search(text):
        raise ValueError(f"{name}: names other files or code ({found[0].strip()[:20]}), which the studio does not open")
    if "<" not in text:
        raise ValueError(f"{name}: is neither MJCF nor URDF")
    try:
        _model(text)
    except (ImportError, ValueError) as error:
        raise ValueError(f"{name}: {str(error).removeprefix('file: ')}") from None
    return text


@functools.lru_cache(maxsize=8)
def _model(text: str) -> Any:
    from jshape.plants import mujoco_model

    return mujoco_model.load(text)


def joints(text: str) -> list[Joint]:
    """The joints that can be driven: hinges and slides.

    Args:
        text: of the machine's file.
    """
    from jshape.plants import mujoco_model

    model = _model(text)
    kinds = {mujoco_model.SLIDE: "m", mujoco_model.HINGE: "rad"}
    moved = {int(joint) for joint, _ in model.actuator_trnid} if model.nu else set()
    return [
        Joint(name, kinds[int(model.jnt_type[i])], i in moved)
        for i, name in enumerate(mujoco_model.names(model, "joint"))
        if int(model.jnt_type[i]) in kinds
    ]


def starter(name: str, text: str, driven: str | None = None) -> Starter:
    """The problem with which such a machine begins: one joint moves, everything else swings.

    Args:
        name: of the file.
        text: of the file.
        driven: the joint that follows the command; the first that an actuator moves, or the first of all, unless given.

    Raises:
        ValueError: for a joint that there is not, and for a machine that has none.
    """
    known = joints(text)
    if not known:
        raise ValueError(f"{name}: has no joint that could be driven")
    first = next((joint for joint in known if joint.actuated), known[0])
    chosen = first if driven is None else next((joint for joint in known if joint.name == driven), None)
    if chosen is None:
        raise ValueError(f"driven must be one of {', '.join(joint.name for joint in known)}, not {driven!r}")
    kind = "URDF" if re.search(r"<\s*robot\b", text) else "MJCF"
    turns = chosen.unit == "rad"
    size = ("30 deg", "30 deg/s", "60 deg/s²") if turns else ("1 m", "0.5 m/s", "0.5 m/s²")
    move = {"type": "Trapezoid"} | dict(zip(("distance", "speed", "acceleration"), size, strict=True))
    return find(kind)._replace(
        name=kind, title=f"Machine described in {name}", move=move, uncertain={}, design={"impulses": 3},
        values={"file": name, "driven": {chosen.name: "axis"}},
    )  # fmt: skip


def masses(text: str, driven: str) -> dict[str, tuple[float, str]]:
    """The numbers of a machine that may be marked as uncertain: leaf → value and unit.

    Args:
        text: of the machine's file.
        driven: the joint that follows the command.
    """
    from jshape.plants import mujoco_model

    model, found = _model(text), {}
    names = mujoco_model.names(model, "joint")
    loose = mujoco_model.moved_bodies(model, [name for name in names if name != driven])
    for i, name in enumerate(mujoco_model.names(model, "body")):
        if loose[i] and model.body_mass[i] > 0:
            found[f"body.{name}.mass"] = float(model.body_mass[i]), "kg"
    for i, name in enumerate(names):
        stiffness = float(model.jnt_stiffness[i].flat[0])
        if name != driven and stiffness > 0:
            unit = "N/m" if int(model.jnt_type[i]) == mujoco_model.SLIDE else "N m/rad"
            found[f"joint.{name}.stiffness"] = stiffness, unit
    return found
