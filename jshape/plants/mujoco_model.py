"""MJCF and URDF files: read by MuJoCo, and refused by name where they describe what a ``Multibody`` does not simulate.

Without JAX: a problem file is checked before that is loaded.
"""

import math
import re
import warnings
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from jshape._files import in_a_line, printable, read_text

Model = Any
"""MuJoCo's ``MjModel``, which its package has no types for."""

SIZE = 2**24
"""Bytes of a file, without what it includes."""

PART = 2**27
"""Bytes of each file that it names, such as a mesh."""

DEEPEST = 8
"""Files that include one another."""

MOST = 1000
"""Bodies, joints, geoms of a model, and copies of a part; pairs of geoms are looked at one by one."""

NUMBERS = (
    *("body_mass", "body_inertia", "body_pos", "body_ipos", "jnt_pos", "jnt_stiffness", "dof_damping", "dof_armature"),
    *("dof_frictionloss", "qpos0", "qpos_spring", "key_qpos", "gravity"),
)
"""Numbers that a machine's motion is computed from, as MuJoCo calls them."""

GREATEST = 1e18
"""Size of these numbers."""

LARGEST, FINEST = 4096, 256
"""Rows and columns of a height field or a picture, keyframes, numbers of the user's own, parts of what is made of many;
and the fineness of a mesh that is made by a formula."""

AXIS, TAKEN = re.compile(r"[^\W\d][\w-]*"), ("delay", "type")
"""What an axis may be called: a key of a command, and part of a file's name; words that a command has taken."""

HINGE, SLIDE = 3, 2
"""MuJoCo's types of joints that can be simulated."""


def engine() -> Any:
    """The package ``mujoco``.

    Raises:
        ImportError: without it; the message says how to install it.
    """
    try:
        import mujoco
    except ImportError:
        raise ImportError("MJCF and URDF files need MuJoCo: pip install 'jshape[mujoco]'") from None
    return mujoco


def load(file: str | Path) -> Model:
    """MuJoCo's model of a file.

    Args:
        file: a path, or the file's text itself (whatever has a ``<`` in it).

    Raises:
        ValueError: for a file that cannot be read, and with MuJoCo's own words for one that it does not accept.
        ImportError: without MuJoCo.
    """
    mujoco = engine()
    if not isinstance(file, str | Path):
        raise ValueError(f"file must be a path, or the text of an MJCF or URDF file, not {file!r}")
    if not str(file) or "\0" in str(file):
        raise ValueError(f"file must be a path, or the text of an MJCF or URDF file, not {str(file)!r}")
    text = isinstance(file, str) and "<" in file
    name = "file" if text else printable(str(file))
    if text and len(str(file)) > SIZE:
        raise ValueError(f"file must have at most {SIZE} characters, not {len(str(file))}")
    content = str(file) if text else read_text(Path(file), SIZE)
    for words in _beyond(content, Path() if text else Path(file).parent):
        raise ValueError(f"{name}: {words}")
    try:
        parts = [] if text else dependencies(Path(file))
    except mujoco.FatalError:
        # No XML, as is said below.
        parts = []
    for path in parts:
        # MuJoCo would wait for ever for a pipe that nobody writes to.
        if path.exists() and (not path.is_file() or path.stat().st_size > PART):
            raise ValueError(f"{name}: {printable(str(path))} must be a file of at most {PART} bytes")
    model = _read(mujoco, str(file), text, name)
    for kind, number in (("bodies", model.nbody), ("joints", model.njnt), ("geoms", model.ngeom)):
        if number > MOST:
            raise ValueError(f"{name}: has {number} {kind}, more than {MOST}")
    return model


def _read(mujoco: Any, file: str, text: bool, name: str) -> Model:
    """The model that MuJoCo makes of a file.

    Args:
        mujoco: the package.
        file: its path or its text.
        text: whether it is that.
        name: what messages call it.

    Raises:
        ValueError: for one that MuJoCo does not accept, and for numbers that are none or too large.
    """
    # MuJoCo would print its warnings, and write a file with them where the process runs.
    said: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(said.append)
    try:
        model = (mujoco.MjModel.from_xml_string if text else mujoco.MjModel.from_xml_path)(file)
    except (ValueError, RuntimeError) as error:  # What its compiler does not foresee is one of the latter.
        raise ValueError(f"{name}: MuJoCo cannot read it: {in_a_line(str(error))}") from None
    finally:
        mujoco.set_mju_user_warning(before)
    if any("NaN" in words for words in said):
        raise ValueError(f"{name}: a number in it is NaN")
    for key in NUMBERS:
        if not np.all(np.abs(getattr(model.opt if key == "gravity" else model, key)) <= GREATEST):
            raise ValueError(f"{name}: {key.partition('_')[2] or key}: a number must be at most {GREATEST:g} in size")
    for words in said:
        warnings.warn(f"{name}: MuJoCo warns: {in_a_line(words)}", stacklevel=3)
    return model


COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
TAG = re.compile(r"<(/?)(replicate|include|model)\b([^<>]*)")
SIZES = re.compile(
    r"(?:\b(nkey|nrow|ncol|nuser_\w+|dim|nsample|width|height|params)|<(?:composite|flexcomp)\b[^<>]*?\bcount)"
    r"\s*=\s*[\"']([^\"'<>]*)"
)
"""Attributes that say how much of something there is."""


def _beyond(
    text: str, folder: Path, copies: float = 1.0, attached: str = "", seen: Collection[Path] = ()
) -> Iterator[str]:
    """What a file, with those that it includes and attaches, asks for that MuJoCo, which knows no limit, would take all
    memory or time for, or would end the process.

    Args:
        text: the file's.
        folder: of its model, where MuJoCo finds what is included.
        copies: that are made of it.
        attached: the model's name, if it is attached to another.
        seen: the files that include it.
    """
    text = COMMENT.sub("", text)
    for key, value in SIZES.findall(text):
        sizes = [float(number) for number in re.findall(r"\d+\.?\d*(?:[eE][+-]?\d+)?", value)]
        # The parts of what is made of many are counted along several directions.
        size, most = max(sizes, default=0.0) if key else math.prod(sizes), FINEST if key == "params" else LARGEST
        if size > most:
            yield f"{key or 'count'} must be at most {most}, not {size:.6g}"
    around, most, models = [copies], copies, []
    for end, tag, rest in TAG.findall(text):
        file = re.search(r"\bfile\s*=\s*[\"']([^\"'<>]*)", rest)
        if tag == "replicate" and end:
            around = around[:-1] or [copies]
        elif tag == "replicate" and not rest.endswith("/"):
            count = re.search(r"\bcount\s*=\s*[\"']\s*(\d+)", rest)
            around.append(around[-1] * float(count[1] if count else 1))
            most = max(most, around[-1])
            if most > MOST:
                yield f"makes {most:.6g} copies of a part, more than {MOST}"
        elif tag == "model" and file:
            models.append(file[1])
        elif tag == "include" and file and (path := folder / file[1]) not in seen:
            if path.exists() and (not path.is_file() or len(seen) == DEEPEST):
                yield f"includes {printable(file[1])!r}, which is no file, or within {DEEPEST} others"
            elif path.exists():
                yield from _beyond(read_text(path, SIZE), folder, around[-1], attached, {*seen, path})
    for model in models:
        path = folder / model
        if attached:
            # MuJoCo ends the process where a model is attached to itself.
            yield f"attaches {printable(attached)!r}, which attaches another model: name that one here"
        elif path.is_file():
            yield from _beyond(read_text(path, SIZE), path.parent, most, model)


def dependencies(file: Path) -> list[Path]:
    """The other files that an MJCF or URDF file includes or names, such as meshes."""
    paths = map(Path, engine().mju_getXMLDependencies(str(file)))
    return sorted(path for path in paths if not path.exists() or not file.samefile(path))


def names(model: Model, kind: str) -> tuple[str, ...]:
    """The names of all bodies, joints and the like of a model; ``joint3`` for the fourth joint, if it has no name.

    Args:
        model: MuJoCo's.
        kind: as in ``mjtObj``, such as ``"body"``, ``"joint"`` or ``"key"``.

    Raises:
        ValueError: where two have the same one.
    """
    mujoco = engine()
    label = {"equality": mujoco.mjtObj.mjOBJ_EQUALITY}.get(kind, getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}"))
    size = {"body": "nbody", "joint": "njnt", "actuator": "nu", "equality": "neq"}.get(kind, f"n{kind}")
    given = [mujoco.mj_id2name(model, label, i) or f"{kind}{i}" for i in range(getattr(model, size))]
    if len(set(given)) < len(given):
        twice = next(name for name in given if given.count(name) > 1)
        raise ValueError(f"{kind} {twice!r}: two have this name; give those without a name one")
    return tuple(given)


def check_driven(model: Model, driven: Any) -> dict[str, str]:
    """``driven`` as a dictionary from joints to axes.

    Raises:
        ValueError: for what is no such mapping, is empty, or names a joint that there is not.
    """
    known = names(model, "joint")
    if not isinstance(driven, Mapping) or not driven:
        raise ValueError(f"driven must map joints to axes, such as {{'slide': 'trolley'}}, not {driven!r}")
    for joint, axis in driven.items():
        if joint not in known:
            raise ValueError(f"driven names the joint {joint!r}; there are {', '.join(known)}")
        if not isinstance(axis, str) or not AXIS.fullmatch(axis) or axis in TAKEN:
            words = f"letters, digits, _ and -, and not {' or '.join(TAKEN)}"
            raise ValueError(f"driven[{joint!r}] must be the name of an axis ({words}), not {axis!r}")
    return dict(driven)


def command_units(model: Model, driven: Mapping[str, str]) -> dict[str, str]:
    """Unit of each axis's command: m where the first joint that follows it is a slide, rad where it is a hinge."""
    known, found = names(model, "joint"), {}
    for joint, axis in driven.items():
        found.setdefault(axis, "m" if model.jnt_type[known.index(joint)] == SLIDE else "rad")
    return found


def moved_bodies(model: Model, by: Collection[str]) -> np.ndarray:
    """Which bodies these joints move, shape (bodies,)."""
    found = np.zeros(model.nbody, bool)
    moving = np.array([name in by for name in names(model, "joint")], bool)
    for body in range(1, model.nbody):
        found[body] = found[model.body_parentid[body]] or bool(moving[model.jnt_bodyid == body].any())
    return found


def refuse(model: Model, driven: Mapping[str, str]) -> None:
    """Check that a model has nothing that a ``Multibody`` does not simulate and that could move its free joints.

    Raises:
        ValueError: that names what is in the way, and says what to remove.
    """
    for found in _obstacles(model, driven):
        raise ValueError(found)


def _obstacles(model: Model, driven: Mapping[str, str]) -> Iterator[str]:
    disabled, bits = model.opt.disableflags, engine().mjtDisableBit

    def on(flag):
        return not disabled & (flag | bits.mjDSBL_CONSTRAINT)

    for name in names(model, "tendon"):
        yield f"tendon {name!r} is not simulated: remove it, and what acts on it"
    if on(bits.mjDSBL_EQUALITY):
        for name in names(model, "equality"):
            yield f"equality constraint {name!r} is not simulated: remove it (in a URDF, the mimic)"
    for name in names(model, "flex"):
        yield f"flex {name!r} is not simulated: remove it"
    if model.nplugin:
        yield "plugins are not simulated: remove the <plugin> elements"
    if model.nmocap:
        yield 'mocap bodies are not simulated: remove mocap="true", or the body'
    if model.opt.density or model.opt.viscosity:
        yield "fluid forces are not simulated: remove density and viscosity from <option>"
    for flag in ("SPRING", "DAMPER"):
        if disabled & getattr(bits, f"mjDSBL_{flag}"):
            yield f'<flag {flag.lower()}="disable"/> is not read: remove it, and what it disables'
    loose = moved_bodies(model, set(names(model, "joint")) - set(driven))
    yield from _joints(model, driven, on)
    for body, name in enumerate(names(model, "body")):
        if loose[body] and model.body_gravcomp[body]:
            yield f"body {name!r}: gravcomp is not simulated: remove it"
    if not disabled & bits.mjDSBL_ACTUATION:
        yield from _actuators(model, driven)


def _joints(model: Model, driven: Mapping[str, str], on: Any) -> Iterator[str]:
    """Of joints: other types than hinge and slide, limits, dry friction, springs that yield, odd powers."""
    bits = engine().mjtDisableBit
    for i, name in enumerate(names(model, "joint")):
        kind, dof = model.jnt_type[i], model.jnt_dofadr[i]
        if kind not in (HINGE, SLIDE):
            words = "moves its body freely" if kind == 0 else "is a ball joint"
            yield f"joint {name!r} {words}, which is not simulated: put hinges and slides in its place, or remove it"
        if name in driven:
            continue
        if model.jnt_limited[i] and on(bits.mjDSBL_LIMIT):
            urdf = 'type="continuous"' if kind == HINGE else "remove lower and upper"
            yield f'joint {name!r} has limits, which are not simulated: write limited="false" (in a URDF, {urdf})'
        if model.dof_frictionloss[dof] and on(bits.mjDSBL_FRICTIONLOSS):
            yield f"joint {name!r} has dry friction, which is not simulated: remove frictionloss (in a URDF, friction)"
        if model.jnt_plasticadr[i] >= 0 or model.jnt_springyield[i] > 0:
            yield f"joint {name!r} has a spring that yields, which is not simulated: remove springyield"
        if model.jnt_stiffnesspoly[i, 0]:
            yield f"joint {name!r} has quadratic stiffness, which is not simulated: write 0 for its second number"
        if np.any(model.dof_dampingpoly[dof]):
            yield f"joint {name!r} has nonlinear damping, which is not simulated: keep its first number alone"


def _actuators(model: Model, driven: Mapping[str, str]) -> Iterator[str]:
    """Actuators on anything but a driven joint; on one they have no influence, as it follows the command."""
    kinds, joints = engine().mjtTrn, names(model, "joint")
    on_a_joint = (int(kinds.mjTRN_JOINT), int(kinds.mjTRN_JOINTINPARENT))
    for i, name in enumerate(names(model, "actuator")):
        if model.actuator_trntype[i] not in on_a_joint or joints[model.actuator_trnid[i, 0]] not in driven:
            yield f"actuator {name!r} acts on what is not driven: remove it, or drive its joint"
