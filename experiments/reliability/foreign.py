"""Models of MJCF that no one here wrote, beside MuJoCo's C engine: what a shaped move leaves.

    python -m experiments.reliability.foreign      # writes foreign.md; Gymnasium must have its files of MuJoCo

The files are read where Gymnasium has them. Of some, what the refusal names is taken out, and a bare and a shaped move
are run by ``js.residual_energy`` and by MuJoCo's engine at 0.1 ms: the driven joint is accelerated by the force that
the mass matrix asks for, all others move freely.
"""

import importlib.util
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

import jshape as js
from experiments import markdown
from jshape.plants.mujoco_model import engine
from jshape.plants.multibody import Multibody

STEP = 1e-4
"""Of the engine, s."""

HEAD = ("model", "driven", "taken out, given", "bare (J)", "shaped (J)", "engine's shaped (J)", "difference, of bare")


class Model(NamedTuple):
    """A file of Gymnasium's.

    Attributes:
        file: its name.
        driven: the joint that follows the command.
        move: of it.
        changes: texts that are replaced.
        said: what that takes out of the machine, and gives it.
    """

    file: str
    driven: str
    move: js.Trapezoid
    changes: dict[str, str]
    said: str


LIMITS = {'limited="true"': 'limited="false"'}

MODELS = (
    Model("inverted_double_pendulum.xml", "slider", js.Trapezoid(0.5, 0.5, 1.0), {}, "nothing"),
    Model("inverted_pendulum.xml", "slider", js.Trapezoid(0.5, 0.5, 1.0), LIMITS, "limits"),
    Model(
        "reacher.xml",
        "joint0",
        js.Trapezoid(0.8, 1.0, 4.0),
        {
            '<motor ctrllimited="true" ctrlrange="-1.0 1.0" gear="200.0" joint="joint1"/>': "",
            'name="joint1"': 'name="joint1" stiffness="50"',
            '<body name="target" pos=".1 -.1 .01">': '<body name="target" pos=".1 -.1 .01"><!--',
            '<geom conaffinity="0" contype="0" name="target"': '--><geom conaffinity="0" contype="0" name="target"',
        }
        | LIMITS,
        "limits, an actuator, the target's joints; stiffness 50",
    ),
)


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    rows = []
    for model in MODELS:
        rows.append(measured(model))
        print(rows[-1], flush=True)
    lines = [
        "Every file as it is, its first hinge or slide driven:",
        "",
        *markdown.table(("model", "driven", "`from_mjcf`"), map(read, sorted(folder().glob("*.xml")))),
        "",
        "What a move leaves by `js.residual_energy` and by MuJoCo's C engine at 0.1 ms. Pendulums hang.",
        "",
        *markdown.table(HEAD, rows),
    ]
    markdown.write_beside(__file__, "Models that no one here wrote", "python -m experiments.reliability.foreign", lines)


def folder() -> Path:
    """Where Gymnasium keeps its models."""
    spec = importlib.util.find_spec("gymnasium")
    assert spec is not None
    assert spec.origin is not None
    return Path(spec.origin).parent / "envs" / "mujoco" / "assets"


def read(path: Path) -> list[str]:
    """A row: the file, the joint that is driven, and whether the machine can be read or what is in the way."""
    mujoco = engine()
    model = mujoco.MjModel.from_xml_path(str(path))
    hinges = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    joint = next(model.joint(i).name for i in range(model.njnt) if model.jnt_type[i] in hinges)
    try:
        plant = js.plants.from_mjcf(path, {joint: "axis"})
    except ValueError as error:
        return [path.name, joint, str(error)]
    return [path.name, joint, f"read, {len(plant.tree.free)} free joints"]


def measured(model: Model) -> list[str]:
    """A row: what is left after the bare and the shaped move, and what the engine leaves."""
    text = (folder() / model.file).read_text(encoding="utf-8")
    for old, new in model.changes.items():
        text = text.replace(old, new)
    plant = js.plants.from_mjcf(text, {model.driven: "axis"})
    omega = float(np.min(np.asarray(plant.natural_frequency())))
    zv, bare = js.design.linear.zv(omega, 0.0), js.Shaper([1.0, 0.0], [0.0, np.pi / omega])
    said = [float(js.residual_energy(plant, shaper, model.move)) for shaper in (bare, zv)]
    found = by_engine(plant, text, model.driven, zv.shape(model.move))
    numbers = [*(f"{value:.6g}" for value in (*said, found)), f"{abs(found - said[1]) / said[0]:.1e}"]
    return [model.file, model.driven, model.said, *numbers]


def by_engine(plant: Multibody, text: str, joint: str, command: Any) -> float:
    """The energy above rest that MuJoCo's engine leaves, J."""
    mujoco = engine()
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.timestep, model.opt.integrator = STEP, mujoco.mjtIntegrator.mjINT_RK4
    model.actuator_gainprm[:] = model.actuator_biasprm[:] = 0.0
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data, driven = mujoco.MjData(model), int(model.joint(joint).dofadr[0])
    free = [int(model.joint(name).dofadr[0]) for name in plant.tree.free]
    data.qpos[free] = plant.tree.near
    accelerations, push = pushes(command), [0.0]

    def control(model: Any, data: Any) -> None:
        matrix = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, matrix)
        total, others = np.zeros(model.nv), np.arange(model.nv) != driven
        total[driven] = push[0]
        right = data.qfrc_passive - data.qfrc_bias - matrix @ total
        total[others] = np.linalg.solve(matrix[np.ix_(others, others)], right[others])
        data.qfrc_applied[driven] = (matrix @ total + data.qfrc_bias - data.qfrc_passive)[driven]

    mujoco.set_mjcb_control(control)
    try:
        for push[0] in accelerations:
            mujoco.mj_step(model, data)
    finally:
        mujoco.set_mjcb_control(None)
    return energy(mujoco, model, data) - energy_at_rest(mujoco, model, data, free, plant.tree.near)


def energy(mujoco: Any, model: Any, data: Any) -> float:
    mujoco.mj_forward(model, data)
    return float(np.sum(data.energy))


def energy_at_rest(mujoco: Any, model: Any, data: Any, free: Sequence[int], rest: Sequence[float]) -> float:
    """Of the machine that stands still where it is, its free joints at rest, J."""
    data.qpos[free], data.qvel[:] = rest, 0.0
    return energy(mujoco, model, data)


def pushes(command: Any) -> np.ndarray:
    """The mean acceleration in each of the engine's steps."""
    breaks, coefficients = map(np.asarray, command.pieces())
    ends = STEP * np.arange(int(np.ceil(breaks[-1] / STEP - 1e-6)) + 1)
    at = np.clip(np.searchsorted(breaks, ends + 1e-9) - 1, 0, None)
    speeds = coefficients[at, 1] + 2 * coefficients[at, 2] * (ends - breaks[at])
    return np.diff(speeds) / STEP


if __name__ == "__main__":
    main()
