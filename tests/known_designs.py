"""Designs that many tests go through."""

from motions import ODD

from jansen_env.robot import ROBOTS, paper_robot

DESIGNS = {**{name: make() for name, make in ROBOTS.items()}, "phases3": paper_robot(3), "odd": ODD}
"""Every built-in design, six legs on three phases, and a first leg that faces back."""
