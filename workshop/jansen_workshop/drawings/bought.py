"""What is bought for a machine: components, materials and prices, from the file ``parts.yml``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from jansen_env.files.plain_yaml import read_yaml


class Component(NamedTuple):
    """Component that is bought, such as the motor or the battery.

    Attributes:
        stage: Name of the page of the instructions on which the component is assembled.
        name: Name of the component.
        material: Material or type of the component.
        size: Size of the component.
        number: Number of such components.
        grams: Mass of one component, in g.
        price: Price of one component, in EUR.
        place: Place of the component in the machine, as explained in ``parts.yml``.
        room: Length along the frame's bar, width across it, depth along the shaft, and displacement
            along the bar, in mm; empty without a place.
    """

    stage: str
    name: str
    material: str
    size: str
    number: int
    grams: float
    price: float
    place: str
    room: Sequence[float]


class Catalogue(NamedTuple):
    """Bought components of one build, and materials and prices of the other parts.

    Attributes:
        components: Components of the build.
        materials: Materials of joining parts by name; all others are of steel.
        prices: Prices of joining parts by name, in EUR, and under ``"flat"`` those of flat parts,
            in EUR/kg. A price that depends on the build is a dictionary by the robot's material.
    """

    components: list[Component]
    materials: dict[str, str]
    prices: dict[str, Any]


def read_catalogue(material: str) -> Catalogue:
    """Return what is bought for a machine.

    Args:
        material: Material of the robot, ``"aluminium"`` or ``"plywood"``.
    """
    content = read_yaml(Path(__file__).with_name("parts.yml"))
    components = [Component(*row) for row in content[material]]
    return Catalogue(components, content["materials"], content["prices"])
