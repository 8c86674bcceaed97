"""Walk over a box and a ball, below a roof and up to a wall, on terrain defined as a pymunk space.

Run the example as follows:

    python examples/obstacle_course.py [STEPS]

STEPS is the number of control steps of 20 ms, 350 by default. The example draws the space with
pymunk's debug options, adds the robot every 1.5 s, and saves course.png.
"""

import sys

import gymnasium as gym
import pygame
import pymunk
import pymunk.pygame_util

import jansen_env  # noqa: F401  registers the environments
from jansen_env.robot.kinematics import world_joints

SCALE = 200.0  # pixels per m
LEFT, TOP = -1.0, 1.5  # position of the picture's upper left corner, in m

steps = int(sys.argv[1]) if len(sys.argv) > 1 else 350
space = pymunk.Space()
ground = space.static_body


def box(left: float, bottom: float, right: float, top: float) -> pymunk.Poly:
    """Return a rectangle of the ground."""
    return pymunk.Poly(ground, [(left, bottom), (right, bottom), (right, top), (left, top)])


space.add(
    box(-2.0, -0.3, 5.0, 0.0),  # the floor
    box(0.8, -0.1, 1.2, 0.03),  # a step up and down
    pymunk.Circle(ground, 0.3, (1.9, -0.26)),  # the top of a ball
    box(2.3, 1.15, 3.0, 1.25),  # a roof
    box(3.9, -0.1, 4.1, 1.2),  # a wall
)
picture = pygame.Surface((1100, 360))
picture.fill("white")
options = pymunk.pygame_util.DrawOptions(picture)
options.transform = pymunk.Transform(SCALE, 0.0, 0.0, -SCALE, -SCALE * LEFT, SCALE * TOP)
space.debug_draw(options)

env = gym.make("JansenWalker-v0", terrain=space, terminate_when_fallen=False).unwrapped
env.reset(seed=0)
for step in range(steps):
    *_, info = env.step([0.5])
    if step % 75 == 0:
        for joints in world_joints(env.robot, env.get_state()["record"]["state"][:4]):
            places = (joints - (LEFT, TOP)) * (SCALE, -SCALE)
            for body in env.robot.linkage.edges:
                for start, end in body:
                    pygame.draw.aaline(picture, "black", places[start], places[end])
pygame.image.save(picture, "course.png")
print(f"{info['x_position']:.2f} m; course.png shows the way")
