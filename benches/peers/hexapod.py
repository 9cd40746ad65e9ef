"""The hexapod's bodies, joints, springs and contacts in MuJoCo: hexapod.py FOLDER STEPS.

FOLDER/robot.json holds the dimensions, FOLDER/controls.f64 what the linkage asks of the six legs before every step: steps x 24, for each leg lift
and swing, then for each leg their rates; FOLDER/start.f64 the trunk's position and crank-determined lift and swing of the legs at the start. The
cranks and motors themselves are not simulated: MuJoCo has less to do.

MuJoCo's own loop in C++ steps the model (mujoco.rollout, one thread): no Python between steps. Prints one JSON line: version, seconds (best of five),
steps, the distance walked in m, the mean height of the trunk in m, peak MiB.
"""

import json
import pathlib
import resource
import sys
import time

import mujoco
import mujoco.rollout
import numpy as np

REPEATS = 5


def model_xml(robot):
    trunk, leg = robot["trunk"], robot["leg"]
    half = [trunk[key] / 2 for key in ("length", "width", "height")]
    # A contact's stiffest setting that MuJoCo lets through at this step: a time constant of two steps, critically damped.
    contact = f'friction="{robot["friction"]} 0 0" condim="3" solref="{2 * robot["step"]} 1"'
    bodies, actuators = [], []
    for i, hip in enumerate(robot["hips"]):
        bodies.append(f"""
      <body name="leg{i}" pos="{hip[0]} {hip[1]} {hip[2]}">
        <joint name="lift{i}" type="slide" axis="0 0 1"/>
        <joint name="swing{i}" type="hinge" axis="0 -1 0"/>
        <inertial pos="0 0 {-leg["length"] / 2}" mass="{leg["mass"]}" diaginertia="{leg["across"]} {leg["across"]} {leg["along"]}"/>
        <geom type="sphere" size="{leg["foot_radius"]}" pos="0 0 {leg["foot_radius"] - leg["length"]}" contype="2" conaffinity="1" {contact}/>
      </body>""")
    for kind, gain in (("position", "stiffness"), ("velocity", "damping")):
        for i in range(len(robot["hips"])):
            for joint in ("lift", "swing"):
                name = "kp" if kind == "position" else "kv"
                actuators.append(f'<{kind} joint="{joint}{i}" {name}="{leg[joint + "_" + gain]}"/>')
    inertia = " ".join(str(value) for value in trunk["inertia"])
    return f"""
<mujoco>
  <compiler inertiafromgeom="false" boundmass="0" boundinertia="0"/>
  <option timestep="{robot["step"]}" gravity="0 0 {-robot["gravity"]}" integrator="Euler" cone="elliptic"/>
  <worldbody>
    <geom type="plane" size="0 0 1" contype="1" conaffinity="2" {contact}/>
    <body name="trunk">
      <freejoint/>
      <inertial pos="0 0 0" mass="{trunk["mass"]}" diaginertia="{inertia}"/>
      <geom type="box" size="{half[0]} {half[1]} {half[2]}" contype="2" conaffinity="1" {contact}/>{"".join(bodies)}
    </body>
  </worldbody>
  <actuator>{"".join(actuators)}</actuator>
</mujoco>"""


def main():
    folder, steps = pathlib.Path(sys.argv[1]), int(sys.argv[2])
    robot = json.loads((folder / "robot.json").read_text())
    model = mujoco.MjModel.from_xml_string(model_xml(robot))
    data = mujoco.MjData(model)
    start = np.fromfile(folder / "start.f64")
    # Free joint: position and quaternion; then lift and swing of every leg.
    data.qpos[:] = np.concatenate([start[:3], [1, 0, 0, 0], start[3:]])
    mujoco.mj_forward(model, data)
    size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    initial = np.empty(size)
    mujoco.mj_getState(model, data, initial, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    controls = np.fromfile(folder / "controls.f64").reshape(1, steps, model.nu)
    best, states = np.inf, None
    for _ in range(REPEATS):
        begin = time.perf_counter()
        states, _ = mujoco.rollout.rollout(model, data, initial[None, :], controls)
        best = min(best, time.perf_counter() - begin)
    # The state is time, then positions, then velocities.
    positions, velocities = states[0, :, 1 : 1 + model.nq], states[0, :, 1 + model.nq : 1 + model.nq + model.nv]
    w, x, y, z = positions[:, 3:7].T
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    forward = np.cos(yaw) * velocities[:, 0] + np.sin(yaw) * velocities[:, 1]
    print(
        json.dumps(
            {
                "version": mujoco.__version__,
                "seconds": best,
                "steps": steps,
                "distance": float(forward.sum() * robot["step"]),
                "height": float(positions[steps // 2 :, 2].mean()),
                "peak_mib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
            }
        )
    )


main()
