"""Contacts, which are not simulated: refused by name where geoms can touch, however the joints of a model move.

Hinges may turn, and slides go, as far as they like. What hinges carry stays within a ball about the first of them, as
large as what follows is long; what slides carry stays on the lines along which they go. This bound calls some geoms
near that never meet, and none far that do.
"""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from jshape.plants.mujoco_model import SLIDE, Model, engine, moved_bodies, names

PARALLEL = 1e-9
"""How far from a unit vector, or from a right angle to it, a direction may be that counts as it."""


class Region(NamedTuple):
    """Where the centre of a geom can be: within ``radius`` (m) of ``center`` and what ``ways`` lead to from there."""

    center: np.ndarray
    ways: list[np.ndarray]
    radius: float


def refuse_contacts(model: Model, driven: Mapping[str, str]) -> None:
    """Check that no geom that a free joint moves can touch another one.

    Raises:
        ValueError: that names the first pair that can, and says what to remove.
    """
    bits = engine().mjtDisableBit
    if not model.opt.disableflags & (bits.mjDSBL_CONTACT | bits.mjDSBL_CONSTRAINT):
        for found in _contacts(model, moved_bodies(model, set(names(model, "joint")) - set(driven))):
            raise ValueError(found)


def _contacts(model: Model, loose: np.ndarray) -> Iterator[str]:
    """Pairs of geoms that MuJoCo would let collide and that can meet, one of which at least a free joint moves."""
    mujoco, geoms, weld, parent = engine(), names(model, "geom"), model.body_weldid, model.body_parentid
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    advice = 'write <flag contact="disable"/> into <option>, or contype="0" conaffinity="0"'
    for i in range(model.npair):
        if _apart(model, data, int(model.pair_geom1[i]), int(model.pair_geom2[i])):
            continue
        yield f"contact pair {i} is not simulated: remove it, or {advice}"
    excluded = {int(signature) for signature in model.exclude_signature}
    filtered = not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_FILTERPARENT
    for second in range(model.ngeom):
        for first in range(second):
            one, two = sorted((int(model.geom_bodyid[first]), int(model.geom_bodyid[second])))
            a, b = int(weld[one]), int(weld[two])
            meet = model.geom_contype[first] & model.geom_conaffinity[second]
            meet = meet or model.geom_contype[second] & model.geom_conaffinity[first]
            family = filtered and 0 not in (a, b) and (weld[parent[a]] == b or weld[parent[b]] == a)
            if not meet or a == b or family or (one << 16) + two in excluded or not (loose[one] or loose[two]):
                continue
            if _apart(model, data, first, second):
                continue
            words = f"contacts between the geoms {geoms[first]!r} and {geoms[second]!r} are not simulated"
            yield f"{words}: {advice} to either"


def _apart(model: Model, data: Any, first: int, second: int) -> bool:
    """Whether two geoms, by their indices, can never touch; ``data``: all joints where the file has them."""
    margin = float(np.sum(model.geom_margin[[first, second]]))
    plane = int(engine().mjtGeom.mjGEOM_PLANE)
    for one, other in ((first, second), (second, first)):
        if model.geom_type[one] == plane:
            normal = data.geom_xmat[one].reshape(3, 3)[:, 2]
            above = _region(model, data, other, normal)
            if above is None or any(abs(way @ normal) > PARALLEL for way in above.ways):
                return False
            height = (above.center - data.geom_xpos[one]) @ normal
            return bool(height - above.radius - model.geom_rbound[other] > margin)
    regions = [_region(model, data, geom) for geom in (first, second)]
    if regions[0] is None or regions[1] is None:
        return False
    between = regions[0].center - regions[1].center
    ways = np.array([*regions[0].ways, *regions[1].ways]).reshape(-1, 3)
    # What is across all ways; their span may have fewer dimensions than there are ways.
    across = between - ways.T @ np.linalg.lstsq(ways.T, between, rcond=1e-12)[0]
    near = regions[0].radius + regions[1].radius + float(np.sum(model.geom_rbound[[first, second]]))
    return bool(np.linalg.norm(across) - near > margin)


def _region(model: Model, data: Any, geom: int, normal: np.ndarray | None = None) -> Region | None:
    """Where the centre of a geom can be; ``None`` for anywhere.

    Args:
        model: MuJoCo's.
        data: with all joints where the file has them.
        geom: its index.
        normal: of a plane, of whose heights alone the region is; hinges about it change none.
    """
    chain, body = [], int(model.geom_bodyid[geom])
    while body:
        chain.insert(0, body)
        body = int(model.body_parentid[body])
    ways: list[np.ndarray] = []
    turned: list[np.ndarray] = []
    for body in chain:
        first = int(model.body_jntadr[body])
        for joint in range(first, first + int(model.body_jntnum[body])):
            axis = data.xaxis[joint]
            if model.jnt_type[joint] == SLIDE:
                if turned:
                    return None
                ways.append(axis)
            elif turned or normal is None or abs(abs(axis @ normal) - 1) > PARALLEL:
                turned.append(data.xanchor[joint])
    points = [*turned, data.geom_xpos[geom]]
    return Region(points[0], ways, float(np.sum(np.linalg.norm(np.diff(points, axis=0), axis=1))))
