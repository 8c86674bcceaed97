"""One robot of a batched environment: what can be asked of it, told to it, and drawn."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import non_negative, within
from jansen_env.engine.tables import FRICTION, RESTITUTION
from jansen_env.envs import arguments
from jansen_env.envs.walking import FASTEST_COMMAND
from jansen_env.robot import Payload, Robot
from jansen_env.terrain import Terrain

if TYPE_CHECKING:
    from jansen_env.envs.walker_vector import JansenWalkerVectorEnv

Array = NDArray[np.float64]

SHARED = (
    "action_space", "control_dt", "metadata", "observation_space", "render_mode", "spec",
    "terminate_when_fallen", "torque_limit", "weights",
)  # fmt: skip
"""What all robots of a batch have in common, to be read from any of them."""
OWN = ("friction", "payload", "restitution", "speed_command")
"""What can be set for each robot."""


class Member:
    """Robot ``index`` of a batched environment.

    Attributes:
        friction, restitution: in force under its toes. payload: its :class:`Payload` (kg can be
            set).
        speed_command: m/s, (low, high) that the next episodes draw from (a number can be set).
        robot, terrain, state, weight, np_random: to be read, as what all have in arguments.
    """

    def __init__(self, batched: JansenWalkerVectorEnv, index: int) -> None:
        self._batched, self._index = batched, index
        self._renderer: Any = None

    def __getattr__(self, name: str) -> Any:
        if name in SHARED:
            one = f"single_{name}" if name.endswith("_space") else name
            return getattr(self._batched, one)
        raise AttributeError(f"a robot of a batch has no attribute {name!r}")

    def __setattr__(self, name: str, value: Any) -> None:
        if name not in OWN and not name.startswith("_"):
            raise AttributeError(f"{name!r} of a robot of a batch cannot be set, only {OWN} can")
        super().__setattr__(name, value)

    def get_wrapper_attr(self, name: str) -> Any:
        """An attribute, as of a wrapped environment."""
        return getattr(self, name)

    def has_wrapper_attr(self, name: str) -> bool:
        """Whether there is such an attribute."""
        return hasattr(self, name)

    @property
    def unwrapped(self) -> Member:
        """Itself."""
        return self

    @property
    def robot(self) -> Robot:
        """What walks."""
        return self._batched.robots[self._index]

    @property
    def terrain(self) -> Terrain:
        """Where it walks; the friction in force is :attr:`friction`."""
        return self._batched.terrains[self._index]

    @property
    def state(self) -> Array:
        """(8,) x, y, theta, psi and their rates, a copy; x, y the crank axis, m, rad, s."""
        state: Array = self._batched.batch.states[self._index].copy()
        return state

    @property
    def weight(self) -> float:
        """N."""
        return float(self._batched.weight[self._index])

    @property
    def np_random(self) -> np.random.Generator:
        """Its random numbers."""
        return self._batched.generator(self._index)

    @property
    def friction(self) -> float:
        """Coulomb coefficient between its toes and its ground."""
        return float(self._batched.batch.parameters[self._index, FRICTION])

    @friction.setter
    def friction(self, value: float) -> None:
        parameters = self._batched.batch.parameters
        parameters[self._index, FRICTION] = non_negative("friction", value)

    @property
    def restitution(self) -> float:
        """Newton's coefficient, 0 to 1."""
        return float(self._batched.batch.parameters[self._index, RESTITUTION])

    @restitution.setter
    def restitution(self, value: float) -> None:
        parameters = self._batched.batch.parameters
        parameters[self._index, RESTITUTION] = within("restitution", value, 0.0, 1.0)

    @property
    def payload(self) -> Payload:
        """What it carries."""
        return self.robot.payload

    @payload.setter
    def payload(self, value: Payload | float) -> None:
        if value is None:
            raise ValueError("payload is None, must be a Payload or kg at the crank axis")
        self._batched.carry(self._index, arguments.load_robot(self.robot, value))
        self.close()  # its pictures show the old one

    @property
    def speed_command(self) -> tuple[float, float]:
        """m/s, the range that the next episodes draw from."""
        low, high = self._batched.commands[self._index].tolist()
        return low, high

    @speed_command.setter
    def speed_command(self, value: float | tuple[float, float]) -> None:
        self._batched.commands[self._index] = arguments.command_range(value, FASTEST_COMMAND)

    def render(self) -> NDArray[np.uint8] | None:
        """Draw it as it stands, (H, W, 3); None without a ``render_mode``."""
        batched, i = self._batched, self._index
        if batched.render_mode is None:
            return None
        from jansen_env.envs.walker_picture import walking_frame
        from jansen_env.rendering import Renderer

        if self._renderer is None:
            self._renderer = Renderer(
                self.robot, self.terrain.polyline, "rgb_array", batched.metadata["render_fps"]
            )
        plant = batched.alone(i)
        plant.state = batched.batch.states[i]
        slip, force = batched.last_contacts(i)
        torque = float(batched.task.share[i]) * batched.torque_limit
        frame = walking_frame(
            plant, slip, force, float(batched.task.command[i]), torque, batched.torque_limit,
            float(batched.elapsed[i]) * batched.control_dt, batched.control_dt,
        )  # fmt: skip
        picture: NDArray[np.uint8] | None = self._renderer.draw(frame)
        return picture

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_renderer": None}

    def close(self) -> None:
        """Let go of its pictures."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None
