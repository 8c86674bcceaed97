"""Define a new leg linkage, a four-bar with a long foot, and print how far and evenly it walks.

Run the example as follows:

    python examples/custom_linkage.py [STEPS]

STEPS is the number of control steps of 20 ms, 500 by default. The example prints the distance and
the heave of robots with four and six legs. It then shows the error for a linkage that does not
close.
"""

import sys

import gymnasium as gym
import numpy as np

from jansen_env import LinkageError, phased_legs, robot_from_joints

steps = int(sys.argv[1]) if len(sys.argv) > 1 else 500
bodies = {
    "frame": {"O": (0.0, 0.0), "P": (0.34, 0.31)},
    "crank": {"O": (0.0, 0.0), "A": (0.21, 0.0)},
    "rocker": {"P": (0.0, 0.0), "B": (0.38, 0.0)},
    "foot": {"A": (0.0, 0.0), "B": (0.37, 0.0), "T": (0.38, -0.52)},
}
dyads = [("B", "A", "P", -1)]  # B is to the right of the line from A to P

for phases in (2, 3):  # number of crank pins; each drives a fore and a back leg
    robot = robot_from_joints(bodies, dyads, "T", phased_legs(phases))
    env = gym.make("JansenWalker-v0", robot=robot, max_episode_steps=steps)
    (observation, info), heights = env.reset(seed=0), []
    for _ in range(steps):
        observation, *_, info = env.step([2.5 - observation[2]])  # crank at about 2 rad/s
        heights.append(observation[8])
    print(f"{2 * phases} legs: {info['x_position']:.2f} m, heave {np.ptp(heights):.3f} m")

bodies["rocker"]["B"] = (0.15, 0.0)
try:
    robot = robot_from_joints(bodies, dyads, "T", phased_legs(2))
    gym.make("JansenWalker-v0", robot=robot)
except LinkageError as error:
    print(f"a rocker too short: {error}")
