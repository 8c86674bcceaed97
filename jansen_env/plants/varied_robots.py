"""What the robots of a batch are, as far as they may differ, and how that is changed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from jansen_env.dynamics.reduced import Tables, compile_robot
from jansen_env.engine.records import CONTACT_STATISTICS, ROBOT, UNKNOWN_DEFLECTION
from jansen_env.engine.tables import (
    farthest,
    kernel_model,
    parameters,
    set_compliance,
    set_motor,
)
from jansen_env.gravity import Gravity, gravity_vector
from jansen_env.motor import Motor
from jansen_env.plants.variation import (
    VARIATION,
    check_variations,
    nominal,
    varied_tables,
    vary_params,
)
from jansen_env.robot import Compliance, Payload, Robot
from jansen_env.terrain import Terrain

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

NOT_THE_ROBOT = "gravity_x", "gravity_y", "steepest"
"""Parameters that are not the robot's own."""
OF_A_DESIGN = ("payload", "motor", "pad_compliance")
"""In what robots of a batch may differ."""


class VariedRobots:
    """Robots of one design, their parameters and those of their grounds.

    Args, attributes, errors: see :class:`jansen_env.plants.batch.Batch`.
    """

    def __init__(
        self, robots: Sequence[Robot], terrains: Sequence[Terrain], gravity: Gravity
    ) -> None:
        self.robots, self.terrains = list(robots), list(terrains)
        if len(robots) != len(terrains) or not robots:
            raise ValueError(
                f"there are {len(robots)} robots and {len(terrains)} terrains, must be as many, "
                "and at least one"
            )
        different = {id(robot): robot for robot in robots}.values()
        for robot in different:
            own = {name: getattr(robots[0], name) for name in OF_A_DESIGN}
            if replace(robot, **own) != robots[0]:
                raise ValueError(
                    f"robots are of several designs, must differ in {', '.join(OF_A_DESIGN)} only"
                )
        compiled = {id(robot): compile_robot(robot) for robot in different}
        self.tables = [compiled[id(robot)] for robot in robots]
        self.model = kernel_model(self.tables[0])
        self.toes = self.tables[0].layout.toes
        n, vector = len(robots), gravity_vector(gravity)
        rows = {key: parameters(tables, vector) for key, tables in compiled.items()}
        self.rows = np.zeros(n, ROBOT)
        self.params, self.accumulators = self.rows["params"], self.rows["accumulators"]
        self.nominal_params = np.concatenate([rows[id(robot)] for robot in robots])
        self.nominal_params["steepest"] = [terrain.steepest for terrain in terrains]
        values = [nominal(*pair) for pair in zip(robots, terrains, strict=True)]
        self.nominal = np.array(values, VARIATION)
        self.variation = self.nominal.copy()
        self._links = robots[0].links_mass, *farthest(self.tables[0])
        self._varied: dict[int, Tables] = {}
        self._put_in_force(np.arange(n))
        for robot, terrain in zip(robots, terrains, strict=True):
            check_bounce(robot.pad_compliance, terrain.restitution)
        self.contact_statistics = np.zeros((n, len(self.model.layout)), CONTACT_STATISTICS)
        self.deflection[:] = UNKNOWN_DEFLECTION
        self._any_gives = not all(robot.pad_compliance.rigid for robot in robots)

    def vary(self, rows: Ints, values: NDArray[np.void]) -> None:
        """Make robots and their grounds others than they are: from their next placing on.

        Args:
            rows: (k,) of the robots. values: (k,) of
                :data:`jansen_env.plants.variation.VARIATION`; :attr:`nominal` for as they are.

        Raises:
            ValueError: a number out of :data:`jansen_env.plants.variation.RANGES`, or restitution
                where pads give.
        """
        check_variations(values, self.nominal_params["compliant"][rows])
        self.variation[rows] = values
        self._put_in_force(rows)

    def _put_in_force(self, rows: Ints) -> None:
        """Make the parameters of robots those of their :attr:`variation`."""
        params = self.nominal_params[rows]  # a copy
        vary_params(params, self.variation[rows], *self._links)
        params["prescribed_speed"] = self.params["prescribed_speed"][rows]
        self.params[rows] = params
        self._varied.clear()

    def varied_tables(self, row: int) -> Tables:
        """The tables of a robot as it is in force."""
        if self.variation[row] == self.nominal[row]:
            return self.tables[row]
        if row not in self._varied:
            self._varied[row] = varied_tables(self.tables[row], self.variation[row])
        return self._varied[row]

    def set_own(self, row: int, **numbers: float) -> None:
        """Change numbers of a robot or its ground themselves, by their names in a variation.

        Restitution and the payload have methods of their own, which check more.
        """
        for name, number in numbers.items():
            self.nominal[name][row] = self.variation[name][row] = number
        self._put_in_force(np.array([row]))

    def set_gravity(self, row: int, gravity: Gravity) -> None:
        """Change a robot's gravity, without its tilt."""
        self.nominal_params["gravity_x"][row], self.nominal_params["gravity_y"][row] = (
            gravity_vector(gravity)
        )
        self.set_own(row)

    def set_payload(self, row: int, payload: Payload) -> None:
        """Change what a robot carries."""
        robot = self.robots[row] = replace(self.robots[row], payload=payload)
        self.tables[row] = compile_robot(robot)
        kept = self.nominal_params[row].copy()
        self.nominal_params[row] = parameters(self.tables[row], (0.0, 0.0))[0]
        for name in NOT_THE_ROBOT:
            self.nominal_params[name][row] = kept[name]
        x, y = payload.position
        self.set_own(row, payload=payload.mass, payload_x=x, payload_y=y)

    def set_motor(self, row: int, motor: Motor) -> None:
        """Change what turns a robot's crank."""
        robot = self.robots[row] = replace(self.robots[row], motor=motor)
        self.tables[row] = compile_robot(robot)
        set_motor(self.nominal_params[row : row + 1], robot)
        self.set_own(row)

    def set_pad_compliance(self, row: int, pads: Compliance) -> None:
        """Change how a robot's pads give.

        Raises:
            ValueError: they give and its ground has restitution.
        """
        check_bounce(pads, float(self.params["restitution"][row]))
        self.deflection[row] = UNKNOWN_DEFLECTION
        self._any_gives = self._any_gives or not pads.rigid
        robot = self.robots[row] = replace(self.robots[row], pad_compliance=pads)
        self.tables[row] = compile_robot(robot)
        set_compliance(self.nominal_params[row : row + 1], pads)
        self.set_own(row)

    @property
    def deflection(self) -> Array:
        """(n, pads, 2) deflection of compliant pads, m: compression and bend; part of the state."""
        bent: Array = self.contact_statistics["deflection"]
        return bent

    @property
    def friction(self) -> Array:
        """(n,) Coulomb coefficients between robots' pads and their terrains, a copy."""
        return self.params["friction"].copy()

    @property
    def restitution(self) -> Array:
        """(n,) Newton's coefficients of restitution between pads and terrains, a copy."""
        return self.params["restitution"].copy()

    def set_friction(self, row: int, friction: float) -> None:
        """Change the Coulomb coefficient between a robot's pads and its ground."""
        self.set_own(row, friction=friction)

    def set_restitution(self, row: int, restitution: float) -> None:
        """Change Newton's coefficient of restitution between a robot's pads and its ground.

        Raises:
            ValueError: it is not 0, and the pads give.
        """
        check_bounce(self.robots[row].pad_compliance, restitution)
        self.set_own(row, restitution=restitution)


def check_bounce(pads: Compliance, restitution: float) -> None:
    """Raises ValueError where pads that give are on ground with restitution."""
    if restitution > 0.0 and not pads.rigid:
        raise ValueError(
            f"restitution is {restitution}, must be 0 with compliant pads: their springs and "
            "dampers say how they bounce"
        )
