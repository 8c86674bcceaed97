"""Robots of a batch, their parameters and terrains, and how these are changed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jansen_env.dynamics.reduced import Tables, compile_robot
from jansen_env.engine.records import CONTACT_STATISTICS, ROBOT, UNKNOWN_DEFLECTION
from jansen_env.gravity import Gravity, gravity_vector
from jansen_env.parameters import ROBOT_PARAMETERS, nominal, take_load
from jansen_env.plants.base import check_legs
from jansen_env.plants.design_tables import DesignTables
from jansen_env.plants.robot_data import parameters, set_compliance, set_motor
from jansen_env.plants.robot_parameters import (
    HONOURED_BY_KERNELS,
    apply_to_kernels,
    check_restitution,
    check_values,
    machine_of,
)
from jansen_env.robot import Compliance, Payload, Robot
from jansen_env.robot.motor import Motor
from jansen_env.terrain import Terrain

Ints = NDArray[np.int64]

NOT_THE_ROBOT = "gravity_x", "gravity_y", "steepest", "design", "held"
"""Numbers of a row that are not the robot's own."""


class BatchRobots:
    """Robots, their parameters and those of their terrains.

    Args, attributes, errors: see :class:`jansen_env.plants.batch.Batch`.
    """

    honours = HONOURED_BY_KERNELS

    def __init__(
        self, robots: Sequence[Robot], terrains: Sequence[Terrain], gravity: Gravity, held: bool
    ) -> None:
        self.held = held
        self.robots, self.terrains = list(robots), list(terrains)
        if len(robots) != len(terrains) or not robots:
            raise ValueError(
                f"there are {len(robots)} robots and {len(terrains)} terrains, must be as many, "
                "and at least one"
            )
        different = {id(robot): robot for robot in robots}.values()
        for robot in different:
            check_legs(robot, robots[0])
        self.designs = DesignTables(robots)
        n, vector = len(robots), gravity_vector(gravity)
        rows = {id(robot): parameters(robot, vector) for robot in different}
        self.rows = np.zeros(n, ROBOT)
        self.params = self.rows["params"]
        self.nominal_params = np.concatenate([rows[id(robot)] for robot in robots])
        self.nominal_params["steepest"] = [terrain.steepest for terrain in terrains]
        self.nominal_params["design"] = self.designs.number
        self.nominal_params["held"] = held
        values = [nominal(*pair) for pair in zip(robots, terrains, strict=True)]
        self.nominal = np.array(values, ROBOT_PARAMETERS)
        self.parameters = self.nominal.copy()
        self._links_mass = np.array([robot.links_mass for robot in robots])
        self._apply(np.arange(n))
        check_restitution(self.nominal_params["compliant"], self.nominal["restitution"])
        self.pads = len(self.designs.model.layout[0])
        self.contact_statistics = np.zeros((n, self.pads), CONTACT_STATISTICS)
        self.contact_statistics["deflection"] = UNKNOWN_DEFLECTION
        self.any_gives = not all(robot.pad_compliance.rigid for robot in robots)

    def set_parameters(self, rows: Ints, values: NDArray[np.void]) -> None:
        """Put parameters (k,) of robots (k,) in force, as the protocol has it."""
        compliant = self.nominal_params["compliant"][rows]
        check_values(values, self.nominal[rows], compliant, self.honours)
        self.parameters[rows] = values
        self._apply(rows)

    def _apply(self, rows: Ints) -> None:
        """Make the kernels' rows of robots those of their :attr:`parameters`."""
        params = self.nominal_params[rows]  # a copy
        centre, pad = self.designs.farthest[self.designs.number[rows]].swapaxes(0, 1)
        apply_to_kernels(params, self.parameters[rows], self._links_mass[rows], centre, pad)
        params["prescribed_speed"] = self.params["prescribed_speed"][rows]
        self.params[rows] = params
        self.rows["status"]["pad_radius"][rows] = params["pad_radius"]

    def tables_in_force(self, row: int) -> Tables:
        """Return the tables of a robot under its parameters."""
        return compile_robot(machine_of(self.robots[row], self.parameters[row]))

    def check_robot(self, robot: Robot) -> None:
        """Raise an error for a robot that cannot come in place of another."""
        check_legs(robot, self.robots[0])
        compile_robot(robot)

    def set_robots(self, rows: Ints, robots: Sequence[Robot]) -> None:
        """Exchange robots (k,), as the protocol has it."""
        compliant = np.array([not robot.pad_compliance.rigid for robot in robots])
        check_restitution(compliant, self.nominal["restitution"][rows])
        for robot in robots:
            self.check_robot(robot)
        self.designs.set(rows, robots)
        self.nominal_params["design"][rows] = self.designs.number[rows]
        for row, robot in zip(rows.tolist(), robots, strict=True):
            self.robots[row], self._links_mass[row] = robot, robot.links_mass
            self._take_numbers(row)
            take_load(self.nominal[row], robot)
            self.any_gives = self.any_gives or not robot.pad_compliance.rigid
        self.parameters[rows] = self.nominal[rows]
        self._apply(rows)
        self.contact_statistics["deflection"][rows] = UNKNOWN_DEFLECTION

    def _take_numbers(self, row: int) -> None:
        """Let the kernels' row of a robot have its own numbers."""
        kept = self.nominal_params[row].copy()
        self.nominal_params[row] = parameters(self.robots[row], (0.0, 0.0))[0]
        for name in NOT_THE_ROBOT:
            self.nominal_params[name][row] = kept[name]

    def set_terrain(self, row: int, terrain: Terrain) -> None:
        """Note a robot's new ground, with its friction and restitution."""
        check_restitution(
            self.nominal_params["compliant"][row : row + 1], np.array([terrain.restitution])
        )
        self.terrains[row] = terrain
        self.nominal_params["steepest"][row] = self.params["steepest"][row] = terrain.steepest
        for name in ("friction", "restitution"):
            for numbers in (self.nominal, self.parameters, self.params):
                numbers[name][row] = getattr(terrain, name)

    def change(self, row: int, changes: dict[str, Any]) -> None:
        """Change a robot or its ground themselves, as the protocol has it."""
        # Restitution first where it goes, last where it comes: compliant pads exclude it.
        for name in sorted(
            changes, key=lambda one: changes[one] > 0.0 if one == "restitution" else 0.5
        ):
            value, change = changes[name], getattr(self, f"_set_{name}", None)
            if change is not None:
                change(row, value)
            else:
                if name == "restitution":
                    pads = self.nominal_params["compliant"][row : row + 1]
                    check_restitution(pads, np.array([value]))
                self._set_own(row, **{name: value})

    def _set_own(self, row: int, **numbers: float) -> None:
        """Change nominal numbers of a robot by their names in the table of parameters."""
        for name, number in numbers.items():
            self.nominal[name][row] = self.parameters[name][row] = number
        self._apply(np.array([row]))

    def _set_gravity(self, row: int, gravity: Gravity) -> None:
        x, y = gravity_vector(gravity)
        self.nominal_params["gravity_x"][row], self.nominal_params["gravity_y"][row] = x, y
        self._apply(np.array([row]))

    def _set_payload(self, row: int, payload: Payload) -> None:
        self.robots[row] = replace(self.robots[row], payload=payload)
        self._take_numbers(row)
        x, y = payload.position
        self._set_own(row, payload=payload.mass, payload_x=x, payload_y=y)

    def _set_motor(self, row: int, motor: Motor) -> None:
        robot = self.robots[row] = replace(self.robots[row], motor=motor)
        set_motor(self.nominal_params[row : row + 1], robot)
        self._apply(np.array([row]))

    def _set_pad_compliance(self, row: int, pads: Compliance) -> None:
        check_restitution(np.array([not pads.rigid]), self.params["restitution"][row : row + 1])
        self.contact_statistics["deflection"][row] = UNKNOWN_DEFLECTION
        self.any_gives = self.any_gives or not pads.rigid
        self.robots[row] = replace(self.robots[row], pad_compliance=pads)
        set_compliance(self.nominal_params[row : row + 1], pads)
        self._apply(np.array([row]))
