"""Robots: links, legs, motor, feet, built-in designs; where the joints are."""

from jansen_env.robot.designs import (
    BEARING_LOADS,
    ROBOTS,
    built_robot,
    holy_numbers_robot,
    paper_robot,
)
from jansen_env.robot.links import (
    BEARINGS,
    BODIES,
    BODIES_PER_LEG,
    JOINT_PAIRS,
    RIGID,
    Bar,
    Compliance,
    Leg,
    Payload,
    Side,
    Triangle,
    phased_legs,
)
from jansen_env.robot.robot import Robot

__all__ = [
    "BEARINGS", "BEARING_LOADS", "BODIES", "BODIES_PER_LEG", "JOINT_PAIRS", "RIGID", "ROBOTS",
    "Bar", "Compliance", "Leg", "Payload", "Robot", "Side", "Triangle", "built_robot",
    "holy_numbers_robot", "paper_robot", "phased_legs",
]  # fmt: skip
