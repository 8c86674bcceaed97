"""What do play in the joints and backlash in the gear change in a walk?

Run the experiment as follows. The defaults are half a turn of the crank, which is one cycle of the
gait, and the folder docs/joint_play. With fewer turns, the episodes are shorter, too.

    python experiments/joint_play.py [TURNS] [FOLDER]

The robot ``built`` walks on the rigid-body plant with 0, 0.1, 0.3 and 0.5 mm of radial play in
every pin of its legs, and with 1 degree of backlash between the motor and the crank. It walks from
two initial states at each of two commands, under the pretrained policy and under the PID. Every
walk begins on the fast projection plant, without play, and continues on the rigid-body plant when
it is steady. Some of the walks under the policy are repeated with half the time step. The policy
also walks in short episodes, whose return is measured. The script prints a table per controller,
one of the halved time step and one of the episodes, and writes ``joint_play.json`` and
``joint_play.png``. The page docs/joint_play.md contains the tables and the figure, and
``joint_play.json`` contains the data. The run takes about 25 minutes of processor time.
"""

import math
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import matplotlib.pyplot as plt
import numpy as np
from pages import table

from jansen_env import evaluate
from jansen_env.files import write_json
from jansen_env.plants.rigid.rigid_batch import PLAY_TIME_STEP
from jansen_env.policies import pretrained
from jansen_env.scoring.benchmarks import find_benchmark

ENV = "JansenWalkerBuilt-v0"
COMMANDS = (0.2, 0.3)  # m/s
CONTROLLERS = ("policy", "pid")
CASES = ((0.0, 0.0), (0.1, 0.0), (0.3, 0.0), (0.5, 0.0), (0.0, 1.0))
"""Radial play in mm, and backlash in degrees."""
SEEDS = (0, 1)  # seeds of the initial states
TIME_STEP = 1e3 * PLAY_TIME_STEP  # usual time step of the rigid-body plant, in ms
HALVED = ((0.0, 0.0), (0.5, 0.0), (0.0, 1.0))
"""Radial play in mm, and backlash in degrees, of the walks with half the time step."""
HALVED_COMMAND = 0.3  # command of these walks, in m/s
BEFORE = 4.0  # time for which a robot walks on the projection plant first, in s
SETTLING = 0.3  # time on the rigid-body plant that the metrics leave out, in s
LONGEST = 8.0  # time after which a walk ends even if its crank got stuck, in s
EPISODE_PLAYS = (0.0, 0.3, 0.5)  # radial play in the episodes, in mm
EPISODE_TIME_STEPS = (TIME_STEP, 0.5 * TIME_STEP)  # time steps of the rigid-body plant, in ms
EPISODE_COMMAND = 0.3  # command of the episodes, in m/s
EPISODES = 2  # number of episodes per case
EPISODE_SEED = 0  # seed of their initial states
EPISODE_STEPS = 250  # control steps of an episode, if the walks have the usual number of turns
TURNS = 0.5  # usual number of turns of the crank that are measured: one cycle of the gait
METRICS = {
    "return": ("return", ".1f"),
    "speed_error": ("speed error (m/s)", ".3f"),
    "slip_per_metre": ("slip (m/m)", ".2f"),
    "cost_of_transport": ("cost of transport", ".2f"),
    "falls": ("falls", ".1f"),
}
"""Metrics of the episodes, with the headings of their columns and the formats of their values."""
COLUMNS = {
    "speed": ("speed (m/s)", ".3f"),
    "slip": ("slip (m/m)", ".2f"),
    "pin_force": ("pin force, typical (N)", ".0f"),
    "pin_force_max": ("pin force, largest (N)", ".0f"),
    "crank_torque": ("crank torque, typical (N m)", ".1f"),
    "crank_torque_max": ("crank torque, largest (N m)", ".1f"),
}
"""Metrics of the tables, with the headings of their columns and the formats of their values."""


class Case(NamedTuple):
    """A walk to simulate.

    Attributes:
        controller: Name of the controller.
        play: Radial play of every pin of the legs, in mm.
        backlash: Backlash of the gear, in degrees.
        command: Commanded speed, in m/s.
        seed: Seed of the initial state.
        turns: Turns of the crank after the first :data:`SETTLING` seconds.
        time_step: Time step of the rigid-body plant, in ms.
    """

    controller: str
    play: float
    backlash: float
    command: float
    seed: int
    turns: float
    time_step: float = TIME_STEP


def walk(case: Case) -> dict[str, Any]:
    """Return the metrics of a walk.

    A force on a pin is the mean over a time step. From the largest force in each control step of
    20 ms, "typical" selects the median and "largest" the maximum, and likewise for the torque of
    the gear on the crank.
    """
    before: Any = gym.make(ENV).unwrapped
    env: Any = gym.make(
        ENV,
        plant="rigid_body",
        time_step=1e-3 * case.time_step,
        joint_play=1e-3 * case.play,
        backlash=math.radians(case.backlash),
    ).unwrapped
    if case.controller == "pid":
        controller: Any = find_benchmark(ENV).baselines["pid"](before)
    else:
        controller = pretrained.load(ENV)
    options = {"speed_command": case.command}
    observation, _ = before.reset(seed=case.seed, options=options)
    memory = None
    for step in range(round(BEFORE / before.control_dt)):
        action, memory = controller.predict(observation[None], memory, np.array([step == 0]), True)
        observation, *_ = before.step(action[0])
    env.reset(seed=case.seed, options=options)
    env.set_state(before.get_state())
    world = env.task.world
    world.plant.tracing = True
    settled = round(SETTLING / world.control_dt)
    places, angles, slips, forces, torques = [], [], [], [], []
    fallen = False
    for step in range(round(LONGEST / world.control_dt)):
        action, memory = controller.predict(observation[None], memory, np.array([False]), True)
        observation, _, fallen, _, info = env.step(action[0])
        if step < settled and not fallen:
            continue
        places.append(float(world.x_position[0]))
        angles.append(float(world.crank_angle[0]))
        slips.append(float(info["slip"].sum()))
        forces.append(float(world.plant.pin_impulses.max()) / world.time_step)
        torques.append(world.plant.crank_torque)
        if fallen or abs(angles[-1] - angles[0]) >= 2.0 * math.pi * case.turns:
            break
    distance = places[-1] - places[0]
    time = max(len(places) - 1, 1) * world.control_dt
    return {
        "speed": distance / time,
        "slip": sum(slips[1:]) / max(abs(distance), 1e-6),
        "pin_force": float(np.median(forces)),
        "pin_force_max": max(forces),
        "crank_torque": float(np.median(torques)),
        "crank_torque_max": max(torques),
        "seconds": time,
        "fallen": bool(fallen),
    }


def measure(turns: float) -> list[dict[str, Any]]:
    """Return the metrics of every walk, together with its case."""
    cases = [
        Case(controller, play, backlash, command, seed, turns)
        for controller in CONTROLLERS
        for command in COMMANDS
        for play, backlash in CASES
        for seed in SEEDS
    ]
    cases += [
        Case("policy", play, backlash, HALVED_COMMAND, seed, turns, 0.5 * TIME_STEP)
        for play, backlash in HALVED
        for seed in SEEDS
    ]
    with ProcessPoolExecutor(2) as pool:
        walks = pool.map(walk, cases)
        return [
            {**case._asdict(), **{k: round(v, 4) for k, v in metrics.items()}}
            for case, metrics in zip(cases, walks, strict=True)
        ]


def walk_episodes(steps: int) -> list[dict[str, Any]]:
    """Return the metrics of the policy in short episodes from the same initial states.

    The projection plant has the time step of the environment.

    Args:
        steps: Number of control steps of an episode.
    """
    env: Any = gym.make(ENV).unwrapped
    cases = [("projection", 1e3 * env.task.world.time_step, 0.0)]
    cases += [
        ("rigid bodies", time_step, play)
        for time_step in EPISODE_TIME_STEPS
        for play in EPISODE_PLAYS
    ]
    rows = []
    for plant, time_step, play in cases:
        arguments: dict[str, Any] = {}
        if plant == "rigid bodies":
            arguments = {
                "plant": "rigid_body",
                "time_step": 1e-3 * time_step,
                "joint_play": 1e-3 * play,
            }
        scores = evaluate(
            {"policy": pretrained.load(ENV)},
            ENV,
            {**arguments, "max_episode_steps": steps},
            commands=[EPISODE_COMMAND],
            episodes=EPISODES,
            seed=EPISODE_SEED,
        )
        overall = scores["policy"]["overall"]
        values = {name: overall[name][0] for name in METRICS}
        rows.append(
            {"plant": plant, "time_step": time_step, "play": play, "steps": steps, **values}
        )
        print(rows[-1], file=sys.stderr, flush=True)
    return rows


def episode_table(rows: list[dict[str, Any]]) -> str:
    """Return the table of the episodes.

    A metric is "none" if it is undefined in all episodes.
    """
    headings = ["simulation", "time step (ms)", "play (mm)"]
    headings += [heading for heading, _ in METRICS.values()]
    lines = []
    for row in rows:
        cells = [row["plant"], f"{row['time_step']:g}", f"{row['play']:g}"]
        cells += [
            "none" if row[name] is None else f"{row[name]:{form}}"
            for name, (_, form) in METRICS.items()
        ]
        lines.append(cells)
    return table(headings, lines)


def walk_table(walks: list[dict[str, Any]], controller: str) -> str:
    """Return the table of a controller, as docs/joint_play.md contains it."""
    headings = ["command (m/s)", "play (mm)", "backlash (degrees)", "seed"]
    headings += [*(heading for heading, _ in COLUMNS.values()), "fall"]
    lines = []
    for row in walks:
        if row["controller"] == controller and row["time_step"] == TIME_STEP:
            cells = [f"{row[name]:g}" for name in ("command", "play", "backlash", "seed")]
            cells += [f"{row[name]:{form}}" for name, (_, form) in COLUMNS.items()]
            cells.append("yes" if row["fallen"] else "no")
            lines.append(cells)
    return table(headings, lines, texts=0)


def step_table(walks: list[dict[str, Any]]) -> str:
    """Return the table of the walks with half the time step, beside those with the usual one.

    Args:
        walks: All walks, as returned by :func:`measure`.
    """
    headings = ["play (mm)", "backlash (degrees)", "seed", "time step (ms)"]
    headings += [heading for heading, _ in COLUMNS.values()]
    lines = []
    repeated = [
        row
        for row in walks
        if row["controller"] == "policy"
        and row["command"] == HALVED_COMMAND
        and (row["play"], row["backlash"]) in HALVED
    ]
    for row in sorted(repeated, key=lambda row: HALVED.index((row["play"], row["backlash"]))):
        cells = [f"{row[name]:g}" for name in ("play", "backlash", "seed", "time_step")]
        cells += [f"{row[name]:{form}}" for name, (_, form) in COLUMNS.items()]
        lines.append(cells)
    return table(headings, lines, texts=0)


def draw(walks: list[dict[str, Any]], path: Path) -> None:
    """Draw the metrics of the walks without backlash, and their means, against the play."""
    names = "speed", "slip", "pin_force_max", "crank_torque_max"
    figure, axes = plt.subplots(2, 2, figsize=(6.0, 5.4), sharex=True, layout="constrained")
    for axis, name in zip(axes.flat, names, strict=True):
        for controller in CONTROLLERS:
            for command in COMMANDS:
                line = [
                    row
                    for row in walks
                    if row["controller"] == controller
                    and row["command"] == command
                    and row["backlash"] == 0.0
                    and row["time_step"] == TIME_STEP
                ]
                plays = sorted({row["play"] for row in line})
                means = [np.mean([r[name] for r in line if r["play"] == play]) for play in plays]
                (drawn,) = axis.plot(plays, means, label=f"{controller}, {command} m/s")
                values = [row[name] for row in line]
                axis.plot([row["play"] for row in line], values, "o", color=drawn.get_color())
        axis.set_ylabel(COLUMNS[name][0])
        if name == "slip":
            axis.set_yscale("log")  # a walk that hardly advances slips far more per metre
        else:
            axis.set_ylim(bottom=min(0.0, 1.3 * min(row[name] for row in walks)))
        axis.grid(alpha=0.3)
    for axis in axes[1]:
        axis.set_xlabel("radial play of every pin (mm)")
    lines, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(lines, labels, loc="outside upper center", ncols=2)
    figure.savefig(path, dpi=140)


def main() -> None:
    """Measure, print the tables, and write the data and the figure."""
    turns = float(sys.argv[1]) if len(sys.argv) > 1 else TURNS
    folder = Path(sys.argv[2] if len(sys.argv) > 2 else "docs/joint_play")
    folder.mkdir(parents=True, exist_ok=True)
    walks = measure(turns)
    for controller in CONTROLLERS:
        print(f"\n{controller}\n\n{walk_table(walks, controller)}")
    print(f"\nhalf the time step\n\n{step_table(walks)}")
    episodes = walk_episodes(max(1, round(EPISODE_STEPS * turns / TURNS)))
    print(f"\nepisodes\n\n{episode_table(episodes)}")
    data = {"turns": turns, "seeds": [*SEEDS], "walks": walks, "episodes": episodes}
    write_json(folder / "joint_play.json", data)
    draw(walks, folder / "joint_play.png")


if __name__ == "__main__":
    main()
