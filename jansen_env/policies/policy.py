"""The policy protocol, and policies made of controllers of the crank torque.

One of these policies is the PID controller of the paper, equation (13).
"""

from collections.abc import Callable
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jansen_env.arrays import Array, Bools
from jansen_env.checks import one_of
from jansen_env.engine.layers import put_commands
from jansen_env.policies.pid import PID
from jansen_env.robot import Robot
from jansen_env.world.observations import Observed

Memory: TypeAlias = Any
"""State of a policy or controller, passed from one step to the next."""

Controller: TypeAlias = Callable[[Array, Memory, Bools], tuple[Array, Memory]]
"""Function that computes the torques of n environments that run side by side.

Its arguments are the observations, shape (n, d), the memory that it returned at the previous step
(None at first), and whether an episode starts, shape (n,). It returns the torques in N m, shape
(n,), and the memory to pass at the next step.
"""

Reference: TypeAlias = Callable[[Array, Memory, Bools], tuple[Array, Array, Memory]]
"""Function that compares the cranks of n environments with a reference motion.

It takes the same arguments as a controller. It returns the error of the crank angle in rad, shape
(n,), the error of the crank speed in rad/s, shape (n,), and the memory to pass at the next step.
"""

PAPER_PID = PID()


class Controlled(Protocol):
    """Attributes of an unwrapped environment, of one robot or many, that controllers read."""

    @property
    def observed(self) -> tuple[Observed, ...]:
        """Name, unit, limits and noise of each number of the observation."""
        ...

    @property
    def torque_limit(self) -> float:
        """Torque of the action 1, in N m."""
        ...

    @property
    def control_dt(self) -> float:
        """Control period, in s."""
        ...

    @property
    def robot(self) -> Robot:
        """The robot; in an environment of many robots, the first robot."""
        ...


class Policy(Protocol):
    """Policy that can be scored.

    It has the method ``predict`` of Stable-Baselines3, with the same default arguments.
    """

    def predict(
        self,
        observation: Any,
        state: Memory = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[Any, Memory]:
        """Return the actions for a batch of observations, and the state to pass back.

        Scoring calls ``predict(observations, state, starts, True)``, so keep the order of the
        arguments.

        Args:
            observation: Observations of n robots, shape (n, d).
            state: State that the previous call returned. None at first.
            episode_start: Whether an episode starts, shape (n,).
            deterministic: Whether to return actions without exploration noise.
        """
        ...


class TorquePolicy:
    """Policy that converts the torques of a controller to actions.

    Args:
        controller: Function that computes the torques.
        torque_limit: Torque of the action 1, in N m. Larger torques are clipped to it.
    """

    def __init__(self, controller: Controller, torque_limit: float) -> None:
        self.controller = controller
        self.torque_limit = torque_limit

    def predict(
        self,
        observation: ArrayLike,
        state: Memory = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = False,
    ) -> tuple[NDArray[np.float32], Memory]:
        """Return the actions for observations, and the state to pass back.

        Args:
            observation: Observations of n robots, shape (n, d), or of one robot, shape (d,).
            state: State that the previous call returned. None at first.
            episode_start: Whether an episode starts, shape (n,), or one value for all robots. If
                ``state`` is None, all episodes start.
            deterministic: Has no effect: the actions are always deterministic.

        Returns:
            The actions, shape (n, 1) or (1,), and the state.
        """
        batch = np.atleast_2d(np.asarray(observation, dtype=float))
        starts = np.asarray(True if state is None else episode_start, dtype=bool)
        torque, state = self.controller(batch, state, np.broadcast_to(starts, len(batch)))
        torque = np.ascontiguousarray(torque, float)
        if torque.shape != (len(batch),):
            allowed = f"one number for each of the {len(batch)} observations"
            raise ValueError(f"a controller's torques must be {allowed}, got shape {torque.shape}")
        actions = np.empty((len(batch), 1), np.float32)
        put_commands(torque, self.torque_limit, actions[:, 0])
        return (actions if np.ndim(observation) > 1 else actions[0]), state


def still(env: Controlled) -> TorquePolicy:
    """Return the policy whose torque is always 0."""
    return TorquePolicy(lambda seen, *_: (np.zeros(len(seen)), None), env.torque_limit)


def pid_policy(
    reference: Reference, torque_limit: float, control_dt: float, pid: PID = PAPER_PID
) -> TorquePolicy:
    """Return a policy that follows a reference of the crank with the PID controller (13).

    The integral keeps its value while the torque is at its limit.

    Args:
        reference: Function that returns the errors of the crank angle and the crank speed.
        torque_limit: Torque of the action 1, in N m.
        control_dt: Control period, in s.
        pid: Gains of the controller.
    """

    def controller(observations: Array, memory: Memory, starts: Bools) -> tuple[Array, Memory]:
        before, integral = memory or (None, 0.0)  # memory of the reference, integral in rad s
        error, error_rate, after = reference(observations, before, starts)
        integral = np.where(starts, 0.0, integral)
        torque, integral = pid.torque(error, error_rate, integral, control_dt, torque_limit)
        return torque, (after, integral)

    return TorquePolicy(controller, torque_limit)


def columns(env: Controlled, *names: str) -> list[int]:
    """Return the indices of named numbers in the observation of an environment.

    Args:
        env: Environment of one robot or many, which may be wrapped.
        names: Names of the numbers.

    Raises:
        ValueError: If the observation does not contain one of the names.
    """
    inner: Controlled = getattr(env, "unwrapped", env)
    shown = [entry.name for entry in inner.observed]
    return [shown.index(one_of("name", name, shown)) for name in names]
