"""Map linkages that walk: link lengths by cost of transport, step-over height and body height.

Run the example as follows:

    python examples/linkage_map.py [MINUTES] [FILE]

MINUTES is the duration of the run, 1 by default. If FILE exists, the run continues the map in it;
the default is linkage_map.npz.

The map is made with MAP-Elites (Mouret & Clune 2015) with variation along lines (Vassiliades &
Mouret 2018), starting from four known designs. Each linkage consists of the parts of the built
robot and walks at 0.3 m/s for 6 s from a single crank angle. All linkages have the same soft speed
controller, so that the cost is a function of the link lengths. See ../docs/data.md.
"""

import sys
import time
from pathlib import Path

import numpy as np

from agents.design.measures import Walker, geometry_measures
from agents.design.variables import Candidate
from jansen_env.robot.kinematics import toe_positions
from jansen_env.robot.lengths import lengths, with_lengths
from jansen_env.world.settings import load_robot

DATA = Path(__file__).with_suffix(".npz")
# All values are whole multiples of this unit (m, rad, or 1), so that a walk can be reproduced.
UNIT = 1e-4
# Robot with the base lengths; commanded speed, in m/s; largest relative change of a length.
BASE, SPEED, REACH = load_robot("robot", "built"), 0.3, 0.4
WORLD = {"robot": "built", "max_episode_steps": 300}
NAMES, MIDDLE = [*lengths(BASE)], np.array([*lengths(BASE).values()])
CELLS = {  # edges of the cells; height and opening in m
    "cost": np.geomspace(0.08, 0.8, 51),
    "opening": np.linspace(0.0, 0.3, 51),
    "height": np.linspace(0.45, 0.75, 51),
}
# Linkages that walk at once; standard deviations of the variation: around a known design and around
# a parent, as fractions of the lengths, and along the line to another parent.
COUNT, START, SPREAD, ALONG = 128, 0.05, 0.01, 0.2


def load(path=DATA):
    """Load a map.

    Args:
        path: File of the map.

    Returns:
        Arrays by name, shape (n,) each: link lengths in m and one angle in rad, dimensionless cost
        and slip, and opening and height in m.
    """
    with np.load(path) as file:
        return dict(zip(file["names"].tolist(), UNIT * file["rows"], strict=True))


def cells(data):
    """Return the cell indices of cost, opening and height, shape (n, 3).

    The indices begin at 0. An index of -1 or 50 is outside the map.
    """
    return np.stack([np.digitize(data[name], edges) - 1 for name, edges in CELLS.items()], axis=1)


def is_test(data):
    """Return whether each linkage belongs to the test split, shape (n,).

    The test split consists of all linkages in a tenth of the cells.
    """
    return cells(data) @ [1, 3, 7] % 10 == 0


def elites(data):
    """Return the index of the linkage with the smallest slip in each cell."""
    order = np.argsort(data["slip"], kind="stable")
    return order[np.unique(cells(data)[order], axis=0, return_index=True)[1]]


def robot_of(data, k):
    """Return the robot with index k, for `gym.make("JansenWalkerBuilt-v0", robot=...)`."""
    return with_lengths(BASE, {name: float(data[name][k]) for name in NAMES})


def toe_path(data, k, points=64):
    """Return the path of the first toe of robot k relative to the crank axis.

    Args:
        data: Map that :func:`load` returned.
        k: Index of the robot.
        points: Number of points on the path.

    Returns:
        The path in m, shape (points, 2).
    """
    return toe_positions(robot_of(data, k), np.linspace(0.0, 2.0 * np.pi, points, False))[:, 0]


def varied(parents, rng):
    """Return new link lengths, shape (13,).

    They are those of a parent, moved along the line to another parent, with noise. In 1 % of the
    cases, and if there are no parents, they are those of a known design with noise.

    Args:
        parents: Link lengths of the parents, shape (n, 13).
        rng: Random number generator.
    """
    if not len(parents) or rng.random() < 0.01:
        name = ("built", "holy", "economy", "climber")[rng.integers(4)]
        new = np.array([*lengths(load_robot("robot", name)).values()])
        new *= 1.0 + START * rng.standard_normal(len(new))
    else:
        first, second = parents[rng.integers(len(parents), size=2)]
        new = first + ALONG * rng.standard_normal() * (second - first)
        new += SPREAD * MIDDLE * rng.standard_normal(len(new))
    return UNIT * np.round(np.clip(new, (1.0 - REACH) * MIDDLE, (1.0 + REACH) * MIDDLE) / UNIT)


def controlled(robot, advance, gain=1.0, bias=0.0):
    """Return a robot with its speed controller.

    Args:
        robot: The robot.
        advance: Distance that the robot walks per turn of its crank, in m.
        gain: Gain of the controller, in N m s/rad.
        bias: Constant torque, in N m.
    """
    return Candidate(robot, np.array([2.0 * np.pi * SPEED / advance, gain, bias, 2.0]))


def turning(new):
    """Return the candidate with the given lengths and its geometry, or None if it fits no cell."""
    try:
        robot = with_lengths(BASE, dict(zip(NAMES, new.tolist(), strict=True)))
    except ValueError:
        return None
    shape = geometry_measures(robot)
    # The comparisons are False for NaN.
    inside = all(CELLS[name][0] <= shape[name] < CELLS[name][-1] for name in ("opening", "height"))
    if not inside or shape["closure"] < 0.2 or shape["advance"] < 0.2:
        return None
    return controlled(robot, shape["advance"]), shape


def main():
    """Extend the map for some minutes and write it."""
    seconds = 60.0 * float(sys.argv[1]) if len(sys.argv) > 1 else 60.0
    path = Path(sys.argv[2] if len(sys.argv) > 2 else DATA.name)
    columns = [*NAMES, "cost", "slip", "opening", "height"]
    rows = np.load(path)["rows"] if path.exists() else np.empty((len(columns), 0), np.uint16)
    walker = Walker("JansenWalkerBuilt-v0", WORLD, SPEED, 1, COUNT)
    rng, tried, begin, saved = np.random.default_rng(rows.shape[1]), 0, time.monotonic(), 0.0
    while saved < begin + seconds:
        parents = UNIT * rows[: len(NAMES), elites(dict(zip(columns, UNIT * rows, strict=True)))].T
        batch = []
        while len(batch) < COUNT:
            if (able := turning(new := varied(parents, rng))) is not None:
                batch.append((new, *able))
        tried += COUNT
        walks, fresh = walker.walk([candidate for _, candidate, _ in batch]), []
        for (new, _, shape), walk in zip(batch, walks, strict=True):
            cost, slip = walk["steady_cost_of_transport"], walk["steady_slip_per_metre"]
            walked = walk["falls"] == 0 and walk["steady_speed_error"] < 0.02 and slip < 1.0
            if walked and CELLS["cost"][0] <= cost < CELLS["cost"][-1]:
                fresh.append([*new, cost, slip, shape["opening"], shape["height"]])
        fresh = np.reshape(np.round(np.array(fresh) / UNIT), (-1, len(columns)))
        rows = np.append(rows, fresh.T.astype(np.uint16), axis=1)
        if time.monotonic() > min(saved + 30.0, begin + seconds):
            saved = time.monotonic()
            np.savez_compressed(path, names=columns, rows=rows)
            print(
                f"{saved - begin:.0f} s: {tried} walked, {rows.shape[1]} kept, "
                f"{len(elites(load(path)))} cells, {path.stat().st_size / 1e6:.2f} MB",
                flush=True,
            )


if __name__ == "__main__":
    main()
