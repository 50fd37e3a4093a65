"""Machines in MJCF and URDF, and MuJoCo's C engine as a judge of what is computed of them."""

import numpy as np

HEAD = '<mujoco><option timestep="1e-3" integrator="RK4"><flag contact="disable"/></option><worldbody>'

CRANE = f"""{HEAD}
<body name="trolley"><joint name="slide" type="slide" axis="1 0 0" range="-0.5 9"/><geom size="0.1" mass="30"/>
  <body name="load"><joint name="swing" axis="0 1 0" damping="3"/>
    <inertial pos="0 0 -6" mass="700" diaginertia="1e-6 1e-6 1e-6"/></body>
</body></worldbody>
<actuator><position joint="slide" kp="100"/></actuator></mujoco>"""
"""A payload on a cable of 6 m; what acts on the trolley, its motor and its limits, does not matter."""

DOUBLE = f"""{HEAD}
<body name="trolley"><joint name="slide" type="slide" axis="1 0 0"/><geom size="0.1" mass="30"/>
  <body name="hook"><joint name="upper" axis="0 1 0"/><inertial pos="0 0 -5" mass="10" diaginertia="1e-9 1e-9 1e-9"/>
    <body name="load" pos="0 0 -5"><joint name="lower" axis="0 1 0"/>
      <inertial pos="0 0 -1.5" mass="40" diaginertia="1e-9 1e-9 1e-9"/></body>
  </body>
</body></worldbody></mujoco>"""

ARM = """<mujoco><compiler angle="radian"/><option timestep="1e-3" integrator="RK4" gravity="0 0 0">
<flag contact="disable"/></option><worldbody>
<body name="base" pos="0.1 0.2 1"><joint name="motor" axis="0 0 1"/><geom size="0.1" mass="1"/>
  <body name="upper"><joint name="shoulder" axis="0 0 1" stiffness="600" damping="0.3" pos="0.02 0 0"/>
    <geom type="capsule" size="0.03" fromto="0 0 0 0.6 0 0" mass="3"/>
    <body name="fore" pos="0.6 0 0" euler="0 0 0.7">
      <joint name="elbow" axis="0 0 1" stiffness="250 0 900" damping="0.2" armature="0.02" springref="0.1"/>
      <geom type="capsule" size="0.025" fromto="0 0 0 0.5 0 0" mass="2"/>
      <body name="load" pos="0.5 0 0"><geom size="0.05" mass="1.5"/></body>
    </body>
  </body>
</body></worldbody></mujoco>"""
"""Two links with joints that bend, one of them with a hardening spring, on a motor that turns them."""

TOWER = f"""{HEAD}
<body name="jib" pos="0 0 30"><joint name="slew" axis="0 0 1"/><inertial pos="4 0 0" mass="900" diaginertia="9 9 9"/>
  <body name="cable" pos="10 0 0"><joint name="along" axis="0 1 0" damping="20"/>
    <joint name="across" axis="1 0 0" damping="20"/><inertial pos="0 0 -4" mass="20" diaginertia="2 2 0.1"/>
    <body name="load" pos="0 0 -8"><joint name="sling" type="slide" axis="0 0 1" stiffness="60000" damping="900"/>
      <inertial pos="0 0 0" mass="1000" diaginertia="50 60 70"/></body>
  </body>
</body></worldbody></mujoco>"""
"""A jib that slews; a load that swings both ways, on a cable that stretches under it."""

SAGGING = """<mujoco><option timestep="1e-3" integrator="RK4"><flag contact="disable"/></option><worldbody>
<frame euler="10 20 30"><body name="column" euler="0 90 0"><joint name="lift" axis="0.6 0 0.8"/>
  <geom type="box" size="0.1 0.2 0.3" pos="0.1 0 0" mass="5"/>
  <body name="mast" pos="0.1 0.2 0.3" euler="40 50 60">
    <joint name="bend" axis="0 0.6 0.8" stiffness="120" pos="0 0.1 0"/>
    <joint name="twist" axis="1 0 0" stiffness="90" damping="0.4"/>
    <geom type="ellipsoid" size="0.1 0.2 0.3" pos="0.3 0.2 0.1" euler="5 6 7" mass="3"/>
    <body name="box" pos="0.4 0.1 0"><joint name="stretch" type="slide" axis="0 0 1" ref="0.2" stiffness="900"/>
      <geom type="box" size="0.1 0.05 0.2" mass="2" euler="20 0 0"/>
      <site name="tip" pos="0 0 0.3"/></body>
  </body>
</body></frame></worldbody></mujoco>"""
"""Joints in all directions under gravity, which bends them at rest, more or less by how far the column has turned."""

SLEWING = f"""{HEAD}
<body name="jib" pos="0 0 6"><joint name="turn" axis="0 0 1"/><inertial pos="1 0 0" mass="9" diaginertia="1 1 1"/>
  <body name="trolley" pos="3 0 0"><joint name="drive" type="slide" axis="1 0 0"/><geom size="0.1" mass="3"/>
    <body name="cable"><joint name="outwards" axis="0 1 0"/><joint name="sideways" axis="1 0 0"/>
      <inertial pos="0 0 0" mass="1e-9" diaginertia="1e-9 1e-9 1e-9"/>
      <body name="load" pos="0 0 -2"><joint name="winch" type="slide" axis="0 0 -1"/>
        <inertial pos="0 0 0" mass="5" diaginertia="1e-9 1e-9 1e-9"/></body>
    </body>
  </body>
</body></worldbody></mujoco>"""
"""A tower crane: a jib that slews, a trolley that drives along it, a winch below the joints of the cable."""

BRIDGE = f"""{HEAD}
<body name="bridge"><joint name="along" type="slide" axis="0 1 0"/><geom size="0.1" mass="9"/>
  <body name="trolley"><joint name="over" type="slide" axis="1 0 0"/><geom size="0.1" mass="3"/>
    <body name="load"><joint name="first" axis="0 1 0"/><joint name="second" axis="1 0 0"/>
      <inertial pos="0 0 -1.3" mass="0.7" diaginertia="1e-9 1e-9 1e-9"/></body>
  </body>
</body></worldbody></mujoco>"""
"""A bridge crane, whose trolley drives over a bridge that moves, too."""

MACHINES = {
    "crane": (CRANE, "slide"),
    "double pendulum": (DOUBLE, "slide"),
    "arm": (ARM, "motor"),
    "tower crane": (TOWER, "slew"),
    "sagging": (SAGGING, "lift"),
}


def address(model, joint):
    """Where a joint stands among the coordinates, which for hinges and slides is also its place among velocities."""
    return int(model.joint(joint).qposadr[0])


def free_accelerations(mujoco, model, data, driven, push):
    """Accelerations of all joints by MuJoCo's mass matrix and forces at ``data``'s state, ``driven`` at ``push``.

    One joint and its acceleration, or several of both.
    """
    matrix = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, matrix)
    free = np.setdiff1d(np.arange(model.nv), driven)
    found = np.zeros(model.nv)
    found[driven] = push
    right = data.qfrc_passive - data.qfrc_bias - matrix @ found
    found[free] = np.linalg.solve(matrix[np.ix_(free, free)], right[free])
    applied = matrix @ found + data.qfrc_bias - data.qfrc_passive
    return found, applied[driven]


def pushes(command, step=1e-3):
    """The mean acceleration in each step of a command whose pieces are parabolas, shape (steps,) or (steps, axes)."""
    breaks, coefficients = map(np.asarray, command.pieces())
    assert not np.any(coefficients[..., 3:])
    ends = step * np.arange(int(np.ceil(breaks[-1] / step - 1e-6)) + 1)
    at = np.clip(np.searchsorted(breaks, ends + 1e-9) - 1, 0, None)
    since = (ends - breaks[at]).reshape(-1, *[1] * (coefficients.ndim - 2))
    return np.diff(coefficients[at, ..., 1] + 2 * coefficients[at, ..., 2] * since, axis=0) / step


def stepped(mujoco, text, joints, pushes, rest, last):
    """The energy (J) above that at ``last`` after steps of MuJoCo's engine, and how far the driven joints have come.

    From ``rest``, the joints accelerated by ``pushes``, shape (steps, joints), a row a step.
    The forces that give the joints their accelerations are applied at every stage of a step.
    """
    model = mujoco.MjModel.from_xml_string(text)
    model.actuator_gainprm[:] = model.actuator_biasprm[:] = 0.0
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data, driven = mujoco.MjData(model), [address(model, joint) for joint in joints]
    push = [np.zeros(len(driven))]

    def control(model, data):
        data.qfrc_applied[driven] = free_accelerations(mujoco, model, data, driven, push[0])[1]

    free = np.setdiff1d(np.arange(model.nv), driven)
    data.qpos[free] = rest
    mujoco.set_mjcb_control(control)
    try:
        for push[0] in pushes:
            mujoco.mj_step(model, data)
    finally:
        mujoco.set_mjcb_control(None)
    mujoco.mj_forward(model, data)
    moving = float(np.sum(data.energy))
    np.testing.assert_allclose(data.qvel[driven], 0.0, atol=1e-9)
    data.qpos[free], data.qvel[:] = last, 0.0
    mujoco.mj_forward(model, data)
    return moving - float(np.sum(data.energy)), data.qpos[driven].tolist()
