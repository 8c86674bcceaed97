"""Plot the loads on the joints of a walking robot.

Run the example as follows. It writes joint_loads.png.

    python examples/joint_loads.py [STEPS]

STEPS is the number of control steps of 20 ms, 250 by default.
"""

import sys

import gymnasium as gym
import matplotlib.pyplot as plt
import numpy as np

from jansen_env.dynamics.joint_forces import corner_name
from jansen_env.robot import JANSEN

steps = int(sys.argv[1]) if len(sys.argv) > 1 else 250

env = gym.make("JansenWalker-v0", track_joint_forces=True, friction=0.3)
observation, info = env.reset(seed=0, options={"crank_angle": 0.0})
bearing, largest = [], []
for _ in range(steps):
    torque = 20.0 * (1.0 - observation[2]) + 2.0
    observation, *_, info = env.step([torque / 20.0])
    # The forces at the end of the step, in N, shape (legs, 17), and the largest force within it.
    bearing.append(env.unwrapped.joint_forces().bearing)
    largest.append(info["joint_force_max"])
time = 0.02 * np.arange(1, steps + 1)
loads = np.array(bearing)
worst = np.argsort(loads.max(axis=(0, 1)))[::-1][:3]

figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
for corner in worst:
    left.plot(time, loads[:, 0, corner], label=corner_name(JANSEN, corner))
left.plot(time, largest, "k:", label="largest of all legs, links and time steps")
left.set(xlabel="time (s)", ylabel="force (N)", title=env.unwrapped.robot.leg_names[0])
left.legend()
names = [corner_name(JANSEN, i) for i in range(len(JANSEN.holes))]
right.barh(names, np.percentile(loads, 95, (0, 1)))
right.set(xlabel="95th percentile of the force (N)", title="all legs")
figure.savefig("joint_loads.png", dpi=120)
print(f"largest: {max(largest):.0f} N; the robot weighs {9.81 * env.unwrapped.robot.mass:.0f} N")
