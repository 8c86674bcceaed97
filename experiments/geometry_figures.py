"""Draw the figures of linkages and terrains, which need no experiment.

Run the script as follows. It takes a few seconds.

    python experiments/geometry_figures.py [--out FOLDER]

The script draws Jansen's leg with the names of its joints (docs/theory.md), the linkages
(docs/linkages.md and the pages of the linkages), the legs that were found by a search
(docs/design/results.md) and the terrains of all generators (docs/terrain.md).
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np
from linkages import LINKAGES, as_tall_as_the_paper
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from pages import DOCS

from jansen_env.arrays import Array
from jansen_env.files import write_whole
from jansen_env.robot import Robot, built_robot, paper_robot
from jansen_env.robot.kinematics import (
    T,
    advance_per_turn,
    joint_positions,
    toe_positions,
    world_joints,
)
from jansen_env.robot.robot_file import read_robot
from jansen_env.robot.zoo import standing_height
from jansen_env.tasks.walking import JansenWalkerEnv
from jansen_env.terrain.generators import LEVELS, NamedGenerator, at_level

WIDTH = 5.2  # in; on a phone, a font of 10 points then appears in a height of about 10 pixels
DPI = 160
TURN = np.linspace(0.0, 2.0 * np.pi, 361)  # rad
CRANK_ANGLE = 0.6  # rad, of the linkages
LEG_ANGLE = 1.8  # rad, of the leg with the names of its joints
INK = "#1f2937"
LEG = "#1f77b4"
PATH = "#d62728"
GROUND = "#bfbfbf"
FOUND = {
    "cost_0.1": "found for 0.1 m/s",
    "cost_0.3": "found for 0.3 m/s",
    "cost_0.5": "found for 0.5 m/s",
    "climb": "found for high steps",
    "rough": "found for rough ground",
}
"""Titles of the robots that were found by a search, by their folders in docs/design/found."""
SHOWN_LEVELS = (0, 4, 9)
SHOWN_GROUND = (-1.0, 4.0)  # m

LETTERS = {
    "P": (-14, -14),
    "O": (6, -16),
    "A": (8, 2),
    "B": (-4, 8),
    "C": (10, -8),
    "D": (-16, 2),
    "E": (-16, -4),
    "T": (10, -4),
}
"""Where the name of each joint stands relative to the joint, in points."""


def draw_leg(folder: Path) -> Path:
    """Draw Jansen's leg with the names of its joints and the numbers of its links."""
    robot = paper_robot()
    joints = joint_positions(robot, "fore", LEG_ANGLE)
    path = joint_positions(robot, "fore", TURN)[:, T]
    figure = Figure(figsize=(WIDTH, 5.6), layout="constrained")
    axes = figure.subplots()
    axes.plot(*path.T, color=PATH, lw=1.2, ls="--")
    members = zip(robot.linkage.bodies, robot.linkage.members, strict=True)
    for number, ((name, _), corners) in enumerate(members, start=1):
        places = joints[list(corners)]
        color = INK if name == "frame" else "#ea580c" if name == "crank" else LEG
        if len(corners) == 3:
            axes.fill(*places.T, color=color, alpha=0.15, lw=0)
            places = np.vstack([places, places[:1]])
        style = "--" if name == "frame" else "-"
        axes.plot(*places.T, style, color=color, lw=2.2, solid_capstyle="round")
        axes.annotate(
            str(number),
            joints[list(corners)].mean(axis=0),
            color=color,
            ha="center",
            va="center",
            bbox={"boxstyle": "circle,pad=0.2", "fc": "white", "ec": color, "lw": 0.8},
        )
    for letter, place in zip(robot.linkage.joints, joints, strict=True):
        fixed = letter in "OP"
        axes.plot(*place, "s" if fixed else "o", color=INK, ms=7 if fixed else 5)
        axes.annotate(
            letter,
            place,
            LETTERS[letter],
            textcoords="offset points",
            fontsize=13,
            fontweight="bold",
            color=INK,
        )
    axes.set(aspect="equal", xlabel="x (m)", ylabel="y (m)")
    axes.grid(alpha=0.3)
    axes.margins(0.08)
    return save(figure, folder / "theory" / "leg.png")


def draw_linkages(folder: Path) -> list[Path]:
    """Draw each linkage in a figure of its own, and all linkages in one figure."""
    robots = {name: as_tall_as_the_paper(name) for name in LINKAGES}
    paths = []
    for name, robot in robots.items():
        figure = Figure(figsize=(WIDTH, 3.7), layout="constrained")
        axes = figure.subplots()
        draw_robot(axes, robot)
        axes.set(xlabel="x (m)", ylabel="y (m)")
        paths.append(save(figure, folder / "linkages" / f"{name}.png"))
    figure = Figure(figsize=(WIDTH, 5.6), layout="constrained")
    grid = figure.subplots(3, 2, sharex=True, sharey=True)
    for axes, (name, robot) in zip(grid.flat, robots.items(), strict=True):
        draw_robot(axes, robot)
        advance = abs(advance_per_turn(robot))
        axes.set_title(f"{LINKAGES[name]}:\n{advance:.2f} m per turn", fontsize=10)
    figure.supxlabel("x (m)", fontsize=10)
    figure.supylabel("y (m)", fontsize=10)
    paths.append(save(figure, folder / "linkages" / "zoo.png"))
    return paths


def draw_found(folder: Path) -> Path:
    """Draw the leg of the paper, and the legs that were found by a search."""
    robots = {"link lengths of the paper": built_robot()}
    for name, title in FOUND.items():
        robots[title] = read_robot(DOCS / "design" / "found" / name / "robot.json")
    figure = Figure(figsize=(WIDTH, 5.4), layout="constrained")
    grid = figure.subplots(3, 2, sharex=True, sharey=True)
    for axes, (title, robot) in zip(grid.flat, robots.items(), strict=True):
        draw_robot(axes, robot)
        axes.set_title(title, fontsize=10)
    figure.supxlabel("x (m)", fontsize=10)
    figure.supylabel("y (m)", fontsize=10)
    return save(figure, folder / "design" / "designs.png")


def draw_robot(axes: Axes, robot: Robot) -> None:
    """Draw a robot in the chassis frame, its first leg dark, and the paths of its toes."""
    legs = world_joints(robot, np.array([0.0, 0.0, 0.0, CRANK_ANGLE]))
    for i, joints in reversed([*enumerate(legs)]):
        draw_lines(axes, robot, joints, color=LEG, alpha=0.25 if i else 1.0, lw=1.5)
    paths = toe_positions(robot, TURN)
    for k in range(paths.shape[1]):
        axes.plot(*paths[:, k].T, color=PATH, lw=1.1)
    axes.axhline(-standing_height(robot), color=INK, lw=0.6)
    axes.plot(0.0, 0.0, "o", color="black", ms=4)
    axes.set_aspect("equal")
    axes.grid(alpha=0.3)


def draw_lines(axes: Axes, robot: Robot, joints: Array, **style: Any) -> None:
    """Draw the edges of all links of a leg as one line, so that overlaps are not darker."""
    gap = np.full((1, 2), np.nan)
    lines = [np.vstack([joints[[a, b]], gap]) for a, b in robot.linkage.skeleton]
    axes.plot(*np.vstack(lines).T, solid_capstyle="round", **style)


def draw_generators(folder: Path) -> Path:
    """Draw the terrain of each generator at three levels, with the robot to scale."""
    shape = (len(LEVELS), len(SHOWN_LEVELS))
    figure = Figure(figsize=(WIDTH, 5.4), layout="constrained")
    grid = figure.subplots(*shape, sharex=True, sharey=True)
    for row, name in zip(grid, LEVELS, strict=True):
        for axes, level in zip(row, SHOWN_LEVELS, strict=True):
            draw_terrain(axes, name, level)
        row[0].set_ylabel(f"{name}\ny (m)", fontsize=9)
    for axes, level in zip(grid[0], SHOWN_LEVELS, strict=True):
        axes.set_title(f"level {level}", fontsize=10)
    for axes in grid[-1]:
        axes.set_xlabel("x (m)", fontsize=10)
    return save(figure, folder / "terrain" / "generators.png")


def draw_terrain(axes: Axes, name: str, level: int) -> None:
    """Draw a terrain of a generator, and a robot on it. Slopes and stairs lead upwards."""
    generate = NamedGenerator(name, tuple(at_level(name, level).items()))
    terrain = generate(np.random.default_rng(0), level)
    env = JansenWalkerEnv(terrain=terrain)
    env.reset(seed=1)
    x = np.linspace(*SHOWN_GROUND, 2001)
    axes.fill_between(x, terrain.height(x), -0.4, color=GROUND, lw=0)
    for joints in world_joints(env.robot, env.get_state()["record"]["state"][:4]):
        draw_lines(axes, env.robot, joints, color=LEG, lw=0.8)
    axes.set(aspect="equal", xlim=SHOWN_GROUND, ylim=(-0.4, 1.2), yticks=(0, 1))


def save(figure: Figure, path: Path) -> Path:
    """Write a figure, and return its path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    return write_whole(
        path,
        lambda name: figure.savefig(
            name, dpi=DPI, bbox_inches="tight", pad_inches=0.05, metadata={"Software": None}
        ),
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=DOCS, help="folder of the figures (docs)")
    out = parser.parse_args().out
    for file in (draw_leg(out), *draw_linkages(out), draw_found(out), draw_generators(out)):
        print(file)
