"""Four designs turn their cranks at the same speed; prints distance and heave.

python examples/own_linkage.py [STEPS]   (500 steps of 20 ms by default)
"""

import sys
from dataclasses import replace

import gymnasium as gym
import numpy as np

from jansen_env import Bar, LinkageError, Robot, holy_numbers_robot, paper_robot

steps = int(sys.argv[1]) if len(sys.argv) > 1 else 500


def walk(robot: Robot) -> tuple[float, float]:
    """Distance and heave, m."""
    env = gym.make("JansenWalker-v0", robot=robot, friction=0.5, max_episode_steps=steps)
    (observation, info), heights = env.reset(seed=0), []
    for _ in range(steps):
        observation, *_, info = env.step([1.6 - observation[2]])  # the crank at some 1.5 rad/s
        heights.append(observation[8])
    return info["x_position"], float(np.ptp(heights))


paper = paper_robot()
designs = {
    "the paper's": paper,
    "six legs": paper_robot(phases=3),
    "longer coupler": replace(paper, coupler=Bar(1.03 * paper.coupler.length)),
    "Jansen's own numbers": holy_numbers_robot(),  # walks the other way
}
for name, robot in designs.items():
    print("{:22}{:6.2f} m, heave {:.3f} m".format(name, *walk(robot)))

try:
    gym.make("JansenWalker-v0", robot=replace(paper, upper_rod=Bar(0.5)))
except LinkageError as error:
    print(f"a rod too long: {error}")
