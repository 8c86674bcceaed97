"""Logs of machines that are simulated otherwise than the copies that identify them.

``python workshop/tests/machine_logs.py`` writes those of ``workshop/measurements/`` that are
synthetic.
"""

from dataclasses import astuple, replace
from pathlib import Path

import numpy as np

from jansen_env import ROBOTS, Terrain
from jansen_env.plants.plant import RigidBodyPlant
from jansen_env.policies.policy import PAPER_PID
from jansen_env.robot.lengths import lengths
from jansen_env.tasks.walking.tuned import gains_of
from jansen_workshop import walking_copies

CONTROL_DT = 0.02  # s
COUNT = 2.0 * np.pi / 4096.0  # rad, of the encoder
TRUTH = {"friction": 0.7, "bearings": 1.4, "damping": 0.05, "payload": 0.4, "feet": 1.2}
"""Numbers of the synthetic machine, an economy."""
MEASUREMENTS = Path(__file__).parents[1] / "measurements"


def rigid_body(robot, friction, time_step=5e-4):
    return RigidBodyPlant(robot, replace(Terrain.flat(), friction=friction), time_step)


def mujoco(robot, friction):
    """MuJoCo, with feet that hardly creep where they stick."""
    from mujoco_backend import MujocoPlant

    return MujocoPlant(robot, replace(Terrain.flat(), friction=friction), 2e-4, impratio=1e3)


def write_log(path, plant, speed, rng, start=0.0, comments=(), pid=PAPER_PID, torque_noise=0.03):
    """Let a plant walk under a PID from rest, and write what its sensors say.

    An encoder of 4096 counts; white noise of ``torque_noise``, N m, 3 mrad of pitch, 1 ms of time.
    """
    plant.reset(crank_angle=start)
    motor, reference, integral = plant.robot.motor, start, np.zeros(())
    gains = f"# gains: {[*astuple(pid)]}"
    lines = [
        *comments,
        gains,
        f"# crank_speed: {speed:g}",
        "time_s,crank_rad,torque_Nm,pitch_rad,x_m",
    ]
    for k in range(1, round((walking_copies.measured_time(speed) + 2.1) / CONTROL_DT)):
        angle, rate = plant.state[[3, 7]].tolist()
        limit = motor.torque_limit
        commanded, integral = pid.torque(
            reference - angle, speed - rate, integral, CONTROL_DT, limit
        )
        torque = float(motor.torque(min(limit, max(-limit, float(commanded))), rate))
        reference += speed * CONTROL_DT
        plant.step(torque, CONTROL_DT)
        x, pitch, crank = plant.state[[0, 2, 3]].tolist()
        row = (
            CONTROL_DT * k + rng.uniform(-1e-3, 1e-3),
            COUNT * round(crank / COUNT),
            torque + rng.normal(0.0, torque_noise),
            pitch + rng.normal(0.0, 3e-3),
            x,
        )
        lines.append(",".join(f"{value:.4f}" for value in row))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def drawn_machine(robot, within, rng):
    """A machine whose numbers and lengths are drawn within limits: it and its numbers."""
    numbers = {k: rng.uniform(*ends) for k, ends in within.items() if k != "lengths"}
    sizes = [name for name in lengths(robot) if name != "frame_angle"]
    errors = dict(zip(sizes, rng.uniform(*within["lengths"], len(sizes)).tolist(), strict=True))
    return walking_copies.copy_of(robot, numbers, errors), numbers


if __name__ == "__main__":
    exact = {"mass": 1.0, "battery": 1.0}
    economy = ROBOTS["economy"]()
    machine = walking_copies.copy_of(economy, {**exact, **TRUTH}, {})
    numbers = ", ".join(f"{name} {value:g}" for name, value in TRUTH.items())
    note = f"# synthetic: no machine, the rigid-body plant with noise and {numbers}"
    for speed in (1.0, 2.0):
        plant = rigid_body(machine, TRUTH["friction"])
        path = MEASUREMENTS / f"synthetic_economy_{speed:g}.csv"
        comments = ("# robot: economy", note, f"# mass: {machine.mass:.2f}")
        write_log(
            path, plant, speed, np.random.default_rng(0), 1.0, comments, gains_of(economy, "steady")
        )
