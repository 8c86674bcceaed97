"""Do the parts of a robot withstand the loads of its pretrained policy?

Run the experiment as follows. It takes about two minutes on one core.

    python experiments/policy_loads.py [--walks 40] [--quick]

Each policy walks from rest several times at each command. The script writes the worst values of
each walk to ``docs/judging/policy_loads.json``, and the worst values of all walks to a table of
docs/judging.md.
"""

import sys
from typing import Any, cast

import gymnasium as gym
import numpy as np
from pages import options, publish, table

from agents.design.measures import rod_safety
from jansen_env.dynamics.reduced import compile_robot
from jansen_env.plants.batch import Batch
from jansen_env.plants.trace import trace_forces
from jansen_env.policies import pretrained
from jansen_env.policies.policy import Policy
from jansen_env.tasks.walking.walker_env import JansenWalkerEnv

DATA, PAGE = "judging/policy_loads.json", "judging.md"
ENV = "JansenWalkerBuilt-v0"
COMMANDS = {
    "stroller": (0.1, 0.2, 0.3, 0.4, 0.5),
    "economy": (0.1, 0.3, 0.5),
    "onboard": (0.1, 0.2, 0.3),
    pretrained.DEFAULT: (0.1, 0.3),
}
"""Commands of each policy, in m/s."""
TIME_STEP = 2.5e-4  # s, which resolves touchdowns
SECONDS = 6.0  # duration of a walk
HARDEST = 2  # number of time steps per control step, those with the largest impulses, for the rods
WORST = {"load": max, "shear": max, "rod_safety": min, "rms_torque": max}
"""Values of a walk, and the function that selects the worst one."""


def walk(env: JansenWalkerEnv, policy: Policy, command: float, seed: int) -> dict[str, float]:
    """Return the worst values of one walk from rest.

    Args:
        env: Environment of one walker.
        policy: The policy.
        command: Commanded speed, in m/s.
        seed: Seed of the reset.

    Returns:
        Largest load and shear of a foot (N), smallest safety factor of a rod against buckling, and
        RMS torque (N m).

    Raises:
        RuntimeError: If the robot falls.
    """
    plant = cast(Batch, env.plant.batch)
    plant.tracing = True
    seen, _ = env.reset(seed=seed, options={"speed_command": command})
    impulses = np.zeros(2)
    hardest = []
    torques = []
    for _ in range(round(SECONDS / env.control_dt)):
        seen, _, fell, _, info = env.step(policy.predict(seen)[0])
        pushes = np.abs(plant.trace["impulses"])
        impulses = np.maximum(impulses, pushes[:, : plant.toes].max(axis=(0, 1))[:2])
        order = np.argsort(pushes.max(axis=(1, 2)))
        hardest.append(plant.trace[order[-HARDEST:]].copy())
        torques.append(info["crank_torque"])
        if fell:
            raise RuntimeError(f"the robot fell in the walk with seed {seed} at {command} m/s")
    forces = trace_forces(compile_robot(env.robot), np.concatenate(hardest), TIME_STEP)
    return {
        "load": float(impulses[1]) / TIME_STEP,
        "shear": float(impulses[0]) / TIME_STEP,
        "rod_safety": rod_safety(env.robot, forces),
        "rms_torque": float(np.sqrt(np.mean(np.square(torques)))),
    }


def measure(name: str, command: float, walks: int) -> dict[str, list[float]]:
    """Return the values of all walks of a policy at one command, by name.

    Args:
        name: Name of the pretrained policy.
        command: Commanded speed, in m/s.
        walks: Number of walks, each with its own seed.
    """
    policy = pretrained.load(ENV, name)
    env = gym.make(ENV, **policy.env_kwargs, time_step=TIME_STEP)
    found = [
        walk(cast(JansenWalkerEnv, env.unwrapped), policy, command, seed) for seed in range(walks)
    ]
    print(name, command, file=sys.stderr, flush=True)
    return {key: [values[key] for values in found] for key in found[0]}


def tables(results: dict[str, Any]) -> dict[str, list[str]]:
    """Return the table of the page: the worst values by policy and command.

    Args:
        results: Values of all walks by policy and command.
    """
    head = [
        "policy",
        "command (m/s)",
        "peak load of a foot (N)",
        "peak shear of a foot (N)",
        "safety factor of the rods",
        "RMS torque (N m)",
    ]
    rows = []
    for name, by_command in results.items():
        label = "`pretrained`" if name == pretrained.DEFAULT else f"`pretrained:{name}`"
        for command, values in by_command.items():
            worst = {key: pick(values[key]) for key, pick in WORST.items()}
            cells = "{load:.0f} {shear:.0f} {rod_safety:.1f} {rms_torque:.1f}".format(**worst)
            rows.append([label, command, *cells.split()])
    return {PAGE: [table(head, rows)]}


def main() -> None:
    """Measure, and write the data and the table."""
    args = options(__doc__, walks=40)
    if args.quick:
        results: dict[str, Any] = {"stroller": {"0.1": measure("stroller", 0.1, 1)}}
    else:
        results = {
            name: {str(command): measure(name, command, args.walks) for command in commands}
            for name, commands in COMMANDS.items()
        }
    publish(args.out, DATA, results, tables(results))


if __name__ == "__main__":
    main()
