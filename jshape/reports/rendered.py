"""Pictures of a machine that an MJCF or URDF file describes: by MuJoCo's renderer, or as lines where it has no display.

The extra ``[mujoco]``; the coordinates are those of jshape's responses, MuJoCo only puts the bodies where they are.
"""

import importlib
import itertools
import os
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from jshape.reports.places import sampled

if TYPE_CHECKING:
    from jshape.plants import AbstractPlant
    from jshape.simulation.response import Response

AZIMUTH, ELEVATION = 110.0, -15.0
"""Of the camera, degrees: from the side, a little from above, with x to the right."""

LEAST_LIGHT = 0.3
"""Of the light that comes from everywhere; MuJoCo's own 0.1 leaves a machine without lamps in the dark."""

SIZES = (240, 800)
"""Pixels of a picture's sides, at least and at most."""


class Scene:
    """The machine of a file as the camera sees it, from a place that shows all of every move.

    Attributes:
        model: MuJoCo's model of the file.
        coordinates: name → of all joints in every frame, shape (frames, joints).
    """

    def __init__(
        self, plant: "AbstractPlant", file: str | Path, runs: "Mapping[str, Response]", times: np.ndarray
    ) -> None:
        """Read the file.

        Args:
            plant: of the responses, made from the file.
            file: MJCF or URDF.
            runs: name → response.
            times: s, of the frames.

        Raises:
            ValueError: for a file that cannot be read, and a plant that was not made from it.
        """
        from jshape.plants import mujoco_model
        from jshape.plants.multibody import Multibody

        self.model = mujoco_model.load(file)
        joints = mujoco_model.names(self.model, "joint")
        if not isinstance(plant, Multibody) or {*plant.tree.free, *dict(plant.tree.driven)} != {*joints}:
            raise ValueError(f"model must be the file that the plant was made from, not one of {', '.join(joints)}")
        tree, leading = plant.tree, [*plant.leading()]
        free = [joints.index(name) for name in tree.free]
        self._data = mujoco_model.engine().MjData(self.model)
        self.coordinates = {}
        for name, run in runs.items():
            found = np.zeros((len(times), len(joints)))
            found[:, free] = sampled(run, run.states, times)[:, : len(free)]
            ways = sampled(run, run.payload, times) - sampled(run, run.deflection, times)
            for (joint, axis), zero in zip(tree.driven, tree.zeros, strict=True):
                found[:, joints.index(joint)] = zero + ways[:, leading.index(axis)]
            self.coordinates[name] = found
        azimuth, elevation = np.radians([AZIMUTH, ELEVATION])
        # To the right, upwards and away, as the camera of MuJoCo is turned.
        right = np.array([np.sin(azimuth), -np.cos(azimuth), 0.0])
        away = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
        self._turned = np.stack([right, np.cross(right, away), away])
        seen = np.concatenate([self._extent(rows) for rows in self.coordinates.values()]) @ self._turned.T
        self._low, self._high = seen.min(axis=0), seen.max(axis=0)

    def _put(self, row: np.ndarray) -> None:
        from jshape.plants.mujoco_model import engine

        self._data.qpos[:] = row
        engine().mj_kinematics(self.model, self._data)

    def _extent(self, rows: np.ndarray) -> np.ndarray:
        """The corners of what is seen at some of these coordinates, shape (points, 3)."""
        found = []
        for row in rows[:: max(len(rows) // 50, 1)]:
            self._put(row)
            found += [self._data.xpos[1:].copy(), self._data.xipos[1:].copy()]
            planes = self.model.geom_rbound == 0
            for sign in (-1, 1):
                reach = sign * self.model.geom_rbound[~planes, None, None] * np.eye(3)
                found.append((self._data.geom_xpos[~planes, None] + reach).reshape(-1, 3))
        return np.concatenate(found)

    @property
    def view(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """The camera's view to the right and upwards, m."""
        edge = 0.05 * float(np.max(self._high - self._low)) + 1e-9
        (left, low, _), (right, top, _) = (self._low - edge).tolist(), (self._high + edge).tolist()
        return (left, right), (low, top)

    def lines(self, name: str, frame: int) -> np.ndarray:
        """Every body's place after that of the body that carries it, as the camera sees them, (bodies, 2, 2)."""
        self._put(self.coordinates[name][frame])
        places = self._data.xpos @ self._turned[:2].T
        centres = self._data.xipos @ self._turned[:2].T
        parents = self.model.body_parentid
        joined = [(places[parents[i]], places[i]) for i in range(1, self.model.nbody) if parents[i]]
        joined += [(places[i], centres[i]) for i in range(1, self.model.nbody)]
        return np.array(joined)

    def renderer(self, shape: tuple[int, int]) -> Any:
        """MuJoCo's renderer: a function of name and frame that returns the picture, (height, width, 3).

        Args:
            shape: of the picture, width and height in pixels.

        Returns:
            ``None`` where MuJoCo finds no display, real or without a screen.
        """
        from jshape.plants.mujoco_model import engine

        mujoco, (width, height) = engine(), shape
        self.model.vis.global_.offwidth, self.model.vis.global_.offheight = width, height
        # As fine as a film shows; MuJoCo's 4096 pixels of shadows take twice as long without a graphics card.
        self.model.vis.quality.shadowsize, self.model.vis.quality.offsamples = 1024, 2
        if (opened := next(_contexts(width, height), None)) is None:
            return None
        context = mujoco.MjrContext(self.model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, context)
        scene, option = mujoco.MjvScene(self.model, maxgeom=10_000), mujoco.MjvOption()
        camera, area = self._camera(mujoco, width / height), mujoco.MjrRect(0, 0, width, height)
        picture, depth = np.zeros((height, width, 3), np.uint8), np.zeros((height, width), np.float32)
        sky = np.any(self.model.tex_type == mujoco.mjtTexture.mjTEXTURE_SKYBOX.value)
        light = self.model.vis.headlight.ambient
        light[:] = np.maximum(light, LEAST_LIGHT)

        def render(name: str, frame: int) -> np.ndarray:
            opened.make_current()
            self._data.qpos[:] = self.coordinates[name][frame]
            mujoco.mj_forward(self.model, self._data)
            every = mujoco.mjtCatBit.mjCAT_ALL.value
            mujoco.mjv_updateScene(self.model, self._data, option, None, camera, every, scene)
            self._add_bare_bodies(mujoco, scene)
            mujoco.mjr_render(area, scene, context)
            mujoco.mjr_readPixels(picture, depth, area, context)
            # Where nothing is, paper instead of night.
            return picture[::-1] if sky else np.where(depth[::-1, :, None] < 1, picture[::-1], np.uint8(255))

        return render

    def _add_bare_bodies(self, mujoco: Any, scene: Any) -> None:
        """Balls, and rods that carry them, for bodies that have masses alone and nothing to look at."""
        size, data = 0.008 * float(np.linalg.norm(self._high - self._low)), self._data
        shapes = mujoco.mjtGeom
        for i in range(1, self.model.nbody):
            if self.model.body_geomnum[i] or not self.model.body_mass[i]:
                continue
            parent = self.model.body_parentid[i]
            begins = [data.xpos[parent]] if parent else []
            for begin, end in itertools.pairwise([*begins, data.xpos[i], data.xipos[i]]):
                if np.linalg.norm(end - begin) > size:
                    rod = _added(mujoco, scene, shapes.mjGEOM_CAPSULE, [size / 3, 0, 0], (0.2, 0.2, 0.2, 1))
                    mujoco.mjv_connector(rod, shapes.mjGEOM_CAPSULE, size / 3, begin, end)
            ball = _added(mujoco, scene, shapes.mjGEOM_SPHERE, [2 * size, 0, 0], (0.8, 0.35, 0.1, 1))
            ball.pos[:] = data.xipos[i]

    def _camera(self, mujoco: Any, ratio: float) -> Any:
        """One that stands so far away that nothing leaves the picture."""
        middle, half = (self._low + self._high) / 2, (self._high - self._low) / 2
        camera = mujoco.MjvCamera()
        camera.type = mujoco.mjtCamera.mjCAMERA_FREE.value
        camera.azimuth, camera.elevation = AZIMUTH, ELEVATION
        camera.lookat[:] = self._turned.T @ middle
        slope = np.tan(np.radians(self.model.vis.global_.fovy) / 2)
        camera.distance = 1.05 * (max(half[0] / ratio, half[1]) / slope + half[2])
        # Nothing nearer or farther is drawn; both are in units of the extent.
        self.model.stat.extent = float(camera.distance)
        self.model.vis.map.znear, self.model.vis.map.zfar = 0.01, 10.0
        return camera


def _added(mujoco: Any, scene: Any, kind: Any, size: list[float], colour: tuple[float, ...]) -> Any:
    """Another shape in the scene."""
    geom = scene.geoms[scene.ngeom]
    scene.ngeom += 1
    mujoco.mjv_initGeom(geom, kind, np.array(size, float), np.zeros(3), np.eye(3).ravel(), np.array(colour, np.float32))
    return geom


def _contexts(width: int, height: int) -> Iterator[Any]:
    """Those of OpenGL that this machine has: the user's choice (``MUJOCO_GL``), without a screen, with one."""
    chosen = os.environ.get("MUJOCO_GL", "").lower()
    if chosen in ("disable", "disabled", "off", "false", "0"):
        return
    without = {"linux": ["egl", "osmesa"], "darwin": ["cgl"]}.get(sys.platform, [])
    for kind in [chosen] if chosen in (*without, "glfw") else [*without, "glfw"]:
        if kind == "glfw" and sys.platform == "linux" and not os.environ.get("DISPLAY"):
            continue
        try:
            context = importlib.import_module(f"mujoco.{kind}").GLContext(width, height)
            context.make_current()
        except Exception:
            # Whatever a missing or broken driver raises: the next one may do.
            continue
        yield context
