"""Springs of the legs as pymunk springs without damping."""

from __future__ import annotations

import numpy as np
import pymunk

from jansen_env.arrays import Array
from jansen_env.dynamics.spring_forces import end_position, spring_ends, torsion_deflections
from jansen_env.plants.rigid import bodies as rigid
from jansen_env.robot import Robot, Spring
from jansen_env.robot.kinematics import coordinates


class LegSprings:
    """Springs of all legs in a pymunk space.

    Args:
        robot: The robot.
        bodies: Bodies of the robot in pymunk, at their positions with the chassis and the crank at
            0, where all their angles are 0.

    Attributes:
        linear: Linear springs of all legs, leg by leg.
        torsion: Torsion springs of all legs, leg by leg.
    """

    def __init__(self, robot: Robot, bodies: list[pymunk.Body]) -> None:
        self._robot = robot
        self.linear: list[pymunk.DampedSpring] = []
        self.torsion: list[pymunk.DampedRotarySpring] = []
        ends: list[tuple[int, float, float]] = []
        pairs: list[tuple[int, int]] = []
        for i, leg in enumerate(robot.legs):
            x = coordinates(robot, leg.side, leg.phase)
            for spring in robot.springs:
                if isinstance(spring, Spring):
                    places = []
                    for end in spring_ends(robot, spring):
                        body = rigid.place_of(robot, i, end.body + 1)
                        place, _ = end_position(end, leg.side, x)
                        places.append((body, *(place - np.array(bodies[body].position)).tolist()))
                    (a, *start), (b, *finish) = places
                    made = pymunk.DampedSpring(
                        bodies[a],
                        bodies[b],
                        tuple(start),
                        tuple(finish),
                        spring.rest_length,
                        spring.stiffness,
                        0.0,
                    )
                    self.linear.append(made)
                    ends += places
                else:
                    a, b = (
                        rigid.place_of(robot, i, robot.linkage.names.index(link) + 1)
                        for link in (spring.first, spring.second)
                    )
                    pairs.append((a, b))
                    self.torsion.append(
                        pymunk.DampedRotarySpring(bodies[a], bodies[b], 0.0, spring.stiffness, 0.0)
                    )
        self._bodies = np.array([body for body, *_ in ends], int)
        self._places = np.array([place for _, *place in ends]).reshape(-1, 2)
        self._pairs = np.array(pairs, int).reshape(-1, 2)
        self._rest = np.array([each.rest_length for each in self.linear])
        self._stiffness = np.array([each.stiffness for each in self.linear])
        self._torsion_stiffness = np.array([each.stiffness for each in self.torsion])
        self._neutral = np.zeros(len(pairs))

    def start(self, crank_angle: float, angles: Array) -> None:
        """Set the deflections of the torsion springs.

        pymunk counts the turns of a body from the angle that it is given, which is known up to
        whole turns only. The deflections are known exactly.

        Args:
            crank_angle: Crank angle, in rad.
            angles: Angle of each body in pymunk, in rad, shape (bodies,).
        """
        robot = self._robot
        deflections = []
        for leg in robot.legs:
            x = coordinates(robot, leg.side, crank_angle + leg.phase)
            deflections.append(torsion_deflections(robot, leg.side, x))
        first, second = self._pairs.T
        self._neutral = angles[second] - angles[first] - np.concatenate(deflections)
        for spring, rest in zip(self.torsion, self._neutral.tolist(), strict=True):
            spring.rest_angle = -rest  # pymunk subtracts the angle of the second body

    def energy(self, motion: Array, time_step: float) -> float:
        """Return the energy of all springs, in J.

        pymunk moves the bodies before it changes their velocities. The velocities therefore belong
        to the middle of the next move, and so does this energy.

        Args:
            motion: Motion of the bodies, shape (bodies, 6); see
                :class:`jansen_env.plants.rigid.bodies.Snapshot`.
            time_step: Time step, in s.
        """
        middle = motion[:, :3] + 0.5 * time_step * motion[:, 3:]
        angle = middle[self._bodies, rigid.ANGLE]
        cos, sin = np.cos(angle), np.sin(angle)
        x, y = self._places.T
        points = middle[self._bodies, :2]
        points[:, 0] += cos * x - sin * y
        points[:, 1] += sin * x + cos * y
        stretch = np.hypot(*(points[::2] - points[1::2]).T) - self._rest
        first, second = self._pairs.T
        turned = middle[second, rigid.ANGLE] - middle[first, rigid.ANGLE] - self._neutral
        stored = self._stiffness @ stretch**2 + self._torsion_stiffness @ turned**2
        return 0.5 * float(stored)
