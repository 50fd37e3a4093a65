"""Machines that are described in MJCF or URDF, read by MuJoCo: ``from_mjcf`` and ``from_urdf``. Extra ``[mujoco]``.

    plant = js.plants.from_mjcf("crane.xml", driven={"slide": "trolley"})
    js.tune(plant, js.Trapezoid(4.0, 1.0, 0.5), impulses=3, over={"body.load.mass": [0.5, 1.0, 2.0]})

The equation is written out from the numbers that MuJoCo has read, and compared with MuJoCo's own: where accelerations
differ at any of 64 random states, or the file describes what is not simulated, there is no plant.
"""

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import numpy as np
from jax.tree_util import keystr

from jshape import _check
from jshape.plants import mujoco_model
from jshape.plants._rigid_body import Axis, Link
from jshape.plants._vectors import IDENTITY, Vector, plain, rotation
from jshape.plants.mujoco_contacts import refuse_contacts
from jshape.plants.mujoco_model import Model
from jshape.plants.multibody import Body, Joint, Multibody, Tree, first_joints

STATES = 64
"""Random states at which accelerations are compared with MuJoCo's."""


def from_mjcf(
    file: str | Path,
    driven: Mapping[str, str],
    *,
    payload: str | None = None,
    keyframe: str | None = None,
    leaves: Sequence[str] | None = None,
) -> Multibody:
    """A machine of rigid bodies from an MJCF file: driven joints follow the command, every other one moves freely.

    Free joints move under gravity and their own springs, dampers and armatures. Masses, lengths, stiffnesses and the
    like are leaves by the file's names: ``body.load.mass``, ``joint.elbow.stiffness``. Contacts within reach, limits of
    free joints, tendons, constraints and whatever else is not simulated are refused by name. Actuators on driven joints
    have no influence, and no more have the mass of what driven joints alone move and their limits.

    Args:
        file: a path, or the file's text itself.
        driven: for each joint that follows the command, the name of its axis; several joints may follow one.
        payload: a body (its centre of mass) or a site whose motion is that of the payload; the last body that both a
            driven and a free joint move unless given.
        keyframe: name of the keyframe where the machine begins, from which rest is sought; the first one unless given,
            or the pose of the file itself where it has none.
        leaves: names of numbers that are 0 in the file and are to be leaves all the same, such as
            ``body.load.position.y``; the equation is written out without those that are not named.

    Raises:
        ValueError: for a file that cannot be read, describes what is not simulated, or has no rest; for joints,
            payloads, keyframes and leaves that it does not have; and if its accelerations differ from MuJoCo's.
        ImportError: without MuJoCo.
    """
    model = mujoco_model.load(file)
    return _plant(model, driven, payload, keyframe, leaves)


def from_urdf(
    file: str | Path,
    driven: Mapping[str, str],
    *,
    stiffness: Mapping[str, float] | None = None,
    damping: Mapping[str, float] | None = None,
    payload: str | None = None,
    leaves: Sequence[str] | None = None,
) -> Multibody:
    """A machine of rigid bodies from a URDF file, as ``from_mjcf`` makes one; a URDF knows no springs.

    Args:
        file: a path, or the file's text itself.
        driven: for each joint that follows the command, the name of its axis; several joints may follow one.
        stiffness: for each free joint that has a spring, N m/rad, or N/m where it is prismatic.
        damping: for each free joint whose damping is not that of the file, N m s/rad, or N s/m.
        payload: a link (its centre of mass) whose motion is that of the payload; the last one that both a driven and a
            free joint move unless given.
        leaves: names of numbers that are 0 in the file and are to be leaves all the same, such as
            ``body.load.position.y``; the equation is written out without those that are not named.

    Raises:
        ValueError: as ``from_mjcf`` does, for joints that there are not or that are driven, and for numbers that are
            not finite, or damping that is negative.
        ImportError: without MuJoCo.
    """
    model = mujoco_model.load(file)
    axes = mujoco_model.check_driven(model, driven)
    known = mujoco_model.names(model, "joint")
    for name, given in (("stiffness", stiffness), ("damping", damping)):
        if given is not None and not isinstance(given, Mapping):
            raise ValueError(f"{name} must map joints to numbers, not {given!r}")
        for joint, value in ({} if given is None else given).items():
            if joint not in known or joint in axes:
                free = [each for each in known if each not in axes]
                raise ValueError(f"{name} names the joint {joint!r}; free joints are {', '.join(free) or 'none'}")
            _check.real(value, f"{name}[{joint!r}]")
            _check.finite(value, f"{name}[{joint!r}]")
            index = known.index(joint)
            if name == "stiffness":
                model.jnt_stiffness[index] = value
            else:
                _check.not_negative(value, f"{name}[{joint!r}]")
                model.dof_damping[model.jnt_dofadr[index]] = value
    return _plant(model, axes, payload, None, leaves)


def _plant(
    model: Model, driven: Any, payload: str | None, keyframe: str | None, leaves: Sequence[str] | None
) -> Multibody:
    axes = mujoco_model.check_driven(model, driven)
    mujoco_model.refuse(model, axes)
    refuse_contacts(model, axes)
    joints = mujoco_model.names(model, "joint")
    free = tuple(name for name in joints if name not in axes)
    if not free:
        raise ValueError("driven names every joint: nothing is left that could vibrate")
    begin = _beginning(model, keyframe)
    links = _links(model)
    loose = mujoco_model.moved_bodies(model, free)
    bodies = mujoco_model.names(model, "body")
    carried, point = _payload(model, links, axes, payload)
    tree = Tree(
        links=links,
        free=free,
        driven=tuple(axes.items()),
        zeros=tuple(begin[joints.index(name)] for name in axes),
        near=tuple(begin[joints.index(name)] for name in free),
        payload=carried,
        point=point,
    )
    leaves = () if leaves is None else leaves
    if not isinstance(leaves, Collection) or isinstance(leaves, str) or not all(isinstance(one, str) for one in leaves):
        raise ValueError(f"leaves must be a list of names, such as body.load.position.y, not {leaves!r}")
    body = {
        name: _body(model, i, bool(loose[i]), _below(leaves, f"body.{name}"))
        for i, name in enumerate(bodies)
        if model.body_weldid[i]
    }
    joint = {name: _joint(model, i, name in axes, _below(leaves, f"joint.{name}")) for i, name in enumerate(joints)}
    still = model.opt.disableflags & mujoco_model.engine().mjtDisableBit.mjDSBL_GRAVITY
    plant = Multibody(body, joint, {} if still else _entries(plain(model.opt.gravity), _below(leaves, "gravity")), tree)
    known = [keystr(path, simple=True, separator=".") for path, _ in jax.tree_util.tree_leaves_with_path(plant)]
    for name in leaves:
        if name not in known:
            raise ValueError(f"leaves names {name!r}, which has no influence or is none of this machine's numbers")
    _check_payload(plant)
    _compare(plant, model, begin)
    return _settled(plant)


def _beginning(model: Model, keyframe: str | None) -> list[float]:
    """Coordinates of all joints at the keyframe."""
    known = mujoco_model.names(model, "key")
    if keyframe is not None and keyframe not in known:
        raise ValueError(f"keyframe must be one of {', '.join(known) or 'none: the file has none'}, not {keyframe!r}")
    if not known:
        return [float(value) for value in model.qpos0]
    return [float(value) for value in model.key_qpos[0 if keyframe is None else known.index(keyframe)]]


def _links(model: Model) -> tuple[Link, ...]:
    """The bodies that move, parents first."""
    mujoco = mujoco_model.engine()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    bodies, joints = mujoco_model.names(model, "body"), mujoco_model.names(model, "joint")
    links: list[Link] = []
    index: dict[int, int] = {}
    for body in range(1, model.nbody):
        if not model.body_weldid[body]:
            continue
        parent, first = int(model.body_parentid[body]), int(model.body_jntadr[body])
        axes = []
        for i in range(first, first + int(model.body_jntnum[body])):
            slides = model.jnt_type[i] == mujoco_model.SLIDE
            axes.append(
                Axis(joints[i], bool(slides), plain(model.jnt_axis[i]), float(model.qpos0[model.jnt_qposadr[i]]))
            )
        base = IDENTITY
        if parent not in index:
            x, y, z = (plain(row) for row in data.xmat[parent].reshape(3, 3))
            base = (x, y, z)
        index[body] = len(links)
        turn, principal = rotation(model.body_quat[body]), rotation(model.body_iquat[body])
        links.append(Link(bodies[body], index.get(parent, -1), base, turn, tuple(axes), principal))
    return tuple(links)


def _below(names: Sequence[str], part: str) -> list[str]:
    """What follows the part in those of the dotted names that begin with it."""
    return [name.removeprefix(f"{part}.") for name in names if name.startswith(f"{part}.")]


def _entries(vector: Vector, zeros: Sequence[str]) -> dict[str, float]:
    """The entries that are not 0, and those that are and are named."""
    return {axis: value for axis, value in zip("xyz", vector, strict=True) if value != 0.0 or axis in zeros}


def _body(model: Model, index: int, loose: bool, zeros: Sequence[str]) -> Body:
    """The numbers of a body that have an influence: where it is, and for those that a free joint moves its inertia."""
    rooted = not model.body_weldid[model.body_parentid[index]]
    position = {} if rooted else _entries(plain(model.body_pos[index]), _below(zeros, "position"))
    center = _entries(plain(model.body_ipos[index]), _below(zeros, "center_of_mass"))
    if not loose or not (model.body_mass[index] or "mass" in zeros):
        return Body(None, position, center if loose else {}, {})
    inertia = _entries(plain(model.body_inertia[index]), _below(zeros, "inertia"))
    return Body(float(model.body_mass[index]), position, center, inertia)


def _joint(model: Model, index: int, driven: bool, zeros: Sequence[str]) -> Joint:
    slides = model.jnt_type[index] == mujoco_model.SLIDE
    anchor = {} if slides else _entries(plain(model.jnt_pos[index]), _below(zeros, "anchor"))
    if driven:
        return Joint(anchor=anchor)
    dof = model.jnt_dofadr[index]
    cubic = float(model.jnt_stiffnesspoly[index, 1])
    return Joint(
        stiffness=float(model.jnt_stiffness[index]),
        springref=float(model.qpos_spring[model.jnt_qposadr[index]]),
        damping=float(model.dof_damping[dof]),
        armature=float(model.dof_armature[dof]),
        cubic_stiffness=cubic if cubic or "cubic_stiffness" in zeros else None,
        anchor=anchor,
    )


def _payload(
    model: Model, links: tuple[Link, ...], axes: Mapping[str, str], payload: str | None
) -> tuple[int, Vector | None]:
    """The link that carries the payload, and the point on it; ``None`` for its centre of mass."""
    joints = set(mujoco_model.names(model, "joint"))
    loose = mujoco_model.moved_bodies(model, joints - set(axes))
    firsts = first_joints(axes.items()).values()
    led = np.all([mujoco_model.moved_bodies(model, {joint}) for joint in firsts], axis=0)
    bodies, sites = mujoco_model.names(model, "body"), mujoco_model.names(model, "site")
    if payload is None:
        body, point = int(np.flatnonzero(loose & led if np.any(loose & led) else loose)[-1]), None
    elif payload in bodies:
        body, point = bodies.index(payload), None
    elif payload in sites:
        body, point = int(model.site_bodyid[sites.index(payload)]), plain(model.site_pos[sites.index(payload)])
    else:
        raise ValueError(f"payload must be one of {', '.join([*bodies[1:], *sites])}, not {payload!r}")
    if not loose[body]:
        raise ValueError(f"payload {payload!r} is not moved by any free joint")
    return next(i for i, link in enumerate(links) if link.body == bodies[body]), point


def _check_payload(plant: Multibody) -> None:
    """Check that of every axis a driven joint moves the payload, and that about a hinge it has an angle."""
    tree = plant.tree
    index, above = tree.payload, []
    while index >= 0:
        above += [axis.name for axis in tree.links[index].axes]
        index = tree.links[index].parent
    body = tree.links[tree.payload].body
    for joint in plant.leading().values():
        if joint.name not in above:
            raise ValueError(f"payload {body!r} is not moved by the driven joint {joint.name!r}")
        if not joint.slides and plant.distance_from_axis(joint) < 1e-9:
            raise ValueError(f"payload {body!r} lies on the axis of {joint.name!r}: name a body or a site beside it")


def _compare(plant: Multibody, model: Model, begin: list[float]) -> None:
    """Check accelerations at random states against MuJoCo's C engine.

    The forces that its inverse dynamics has for our accelerations are applied to the driven joints alone; its forward
    dynamics, with all that the file has, must then accelerate every joint as ours does.

    Raises:
        ValueError: where they differ.
    """
    mujoco = mujoco_model.engine()
    joints = mujoco_model.names(model, "joint")
    driven = [joints.index(name) for name, _ in plant.tree.driven]
    # What acts on a driven joint has no influence on the others, whose actuators have been refused.
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
    model.dof_frictionloss[driven] = 0.0
    states = _random_states(model, begin, plant.tree.driven)
    single = any(leaf.dtype == np.float32 for leaf in jax.tree.leaves(plant))
    ours = _accelerated(plant, begin, joints, *states)
    data, worst = mujoco.MjData(model), 0.0
    for q, v, a in zip(*states[:2], ours, strict=True):
        data.qpos[:], data.qvel[:], data.qacc[:], data.qfrc_applied[:] = q, v, a, 0.0
        mujoco.mj_inverse(model, data)
        data.qfrc_applied[driven] = data.qfrc_inverse[driven]
        mujoco.mj_forward(model, data)
        worst = max(worst, float(np.max(np.abs(data.qacc - a)) / np.max(np.abs(a))))
    if not worst <= (1e-3 if single else 1e-9):
        raise ValueError(
            "file describes what is not simulated: accelerations differ from MuJoCo's by "
            f"{worst:.1e} of the greatest at {STATES} random states"
        )


def _random_states(
    model: Model, begin: list[float], driven: Sequence[tuple[str, str]]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coordinates, velocities, accelerations of all joints, each (states, joints); those of an axis move together."""
    random, shape = np.random.default_rng(0), (STATES, len(begin))
    joints, firsts = mujoco_model.names(model, "joint"), first_joints(driven)
    low, high = np.array(begin) - 1.0, np.array(begin) + 1.0
    for i in [joints.index(name) for name, _ in driven]:
        if model.jnt_limited[i]:
            # Its limits are for who plans the command.
            low[i], high[i] = np.clip([low[i], high[i]], *model.jnt_range[i])
    coordinates = low + (high - low) * random.uniform(size=shape)
    velocities, accelerations = random.uniform(-2.0, 2.0, (2, *shape))
    for name, axis in driven:
        i, first = joints.index(name), joints.index(firsts[axis])
        coordinates[:, i] = coordinates[:, first] - begin[first] + begin[i]
        velocities[:, i], accelerations[:, i] = velocities[:, first], accelerations[:, first]
    return coordinates, velocities, accelerations


def _accelerated(plant: Multibody, begin: list[float], joints: tuple[str, ...], q: Any, v: Any, a: Any) -> np.ndarray:
    """The accelerations with our own for the free joints in their places."""
    commanded = {}
    for axis, joint in plant.leading().items():
        i = joints.index(joint.name)
        commanded[axis] = (a[:, i], v[:, i], q[:, i] - begin[i])
    free = [joints.index(name) for name in plant.tree.free]
    numbers = jax.tree.map(np.asarray, plant)
    found = numbers.accelerations([q[:, i] for i in free], [v[:, i] for i in free], commanded)
    accelerations = np.array(a)
    accelerations[:, free] = np.stack([np.broadcast_to(value, STATES) for value in found], axis=1)
    return accelerations


def _settled(plant: Multibody) -> Multibody:
    """The plant whose search for rest begins where the file's machine rests.

    Raises:
        ValueError: where it has no rest, with the joints that nothing returns to it.
    """
    rest = np.asarray(plant.rest_state(plant.zero_inputs()), float)[: len(plant.tree.free)]
    if not np.all(np.isfinite(rest)):
        curvatures = np.diagonal(plant.stiffness_matrix(np.array(plant.tree.near)))
        greatest = max(float(np.max(np.abs(curvatures))), 1e-300)
        loose = [name for name, value in zip(plant.tree.free, curvatures, strict=True) if value < 1e-9 * greatest]
        raise ValueError(
            f"file: there is no stable rest near where the machine begins: {', '.join(loose or plant.tree.free)} move "
            "away from it; give them a stiffness, or name a keyframe near rest"
        )
    tree = plant.tree._replace(near=tuple(map(float, rest)))
    return Multibody(plant.body, plant.joint, plant.gravity, tree)
