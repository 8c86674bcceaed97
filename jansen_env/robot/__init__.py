"""Robots: links, legs, motors, feet, built-in designs, and the positions of the joints."""

from jansen_env.robot.designs import (
    BEARING_LOADS,
    ROBOTS,
    built_robot,
    holy_numbers_robot,
    named_robot,
    paper_robot,
)
from jansen_env.robot.linkage import JANSEN, Dyad, Linkage, Pin
from jansen_env.robot.links import (
    RIGID,
    Bar,
    Compliance,
    Leg,
    Link,
    Payload,
    Plate,
    Side,
    Triangle,
    phased_legs,
)
from jansen_env.robot.robot import Robot
from jansen_env.robot.spring import Spring, TorsionSpring
from jansen_env.robot.zoo import robot_from_joints

__all__ = [
    "BEARING_LOADS",
    "JANSEN",
    "RIGID",
    "ROBOTS",
    "Bar",
    "Compliance",
    "Dyad",
    "Leg",
    "Link",
    "Linkage",
    "Payload",
    "Pin",
    "Plate",
    "Robot",
    "Side",
    "Spring",
    "TorsionSpring",
    "Triangle",
    "built_robot",
    "holy_numbers_robot",
    "named_robot",
    "paper_robot",
    "phased_legs",
    "robot_from_joints",
]
