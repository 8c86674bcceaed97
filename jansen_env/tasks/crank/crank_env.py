"""``JansenCrank-v0``: follow a turning reference with the crank of the paper's fixed model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from typing_extensions import Unpack, override

from jansen_env.arrays import Array, Bools
from jansen_env.checks import non_negative
from jansen_env.dynamics.joint_forces import JointForces
from jansen_env.envs.single import SingleEnv
from jansen_env.envs.vector import TaskVectorEnv, VectorArguments
from jansen_env.tasks.task import CommandedTask
from jansen_env.world.observations import EXACT, Observed
from jansen_env.world.settings import (
    HeldSettings,
    PerRobot,
    Range,
    RobotArguments,
    Values,
    range_each,
    shared,
)
from jansen_env.world.world import LOST, START_ANGLE

FASTEST_COMMAND = 10.0  # largest commanded crank speed, in rad/s
CLOSE = 0.2  # largest RMS tracking error of a successful episode, in rad
TRACKING_WIDTH = 0.8  # tracking error at which the tracking reward is halved, in rad


class CrankArguments(RobotArguments, total=False):
    """Arguments of ``JansenCrank-v0``; :class:`CrankSettings` has their defaults and checks."""

    time_step: float
    speed_command: PerRobot[Range]
    tracking_weight: float
    torque_weight: float


@dataclass(frozen=True, kw_only=True)
class CrankSettings(HeldSettings):
    """Checked arguments of ``JansenCrank-v0``.

    Commands are in rad/s. The default command is that of the paper.
    """

    speed_command: list[tuple[float, float]] = range_each(1.0, -FASTEST_COMMAND, FASTEST_COMMAND)
    tracking_weight: float = shared(1.0, non_negative)
    torque_weight: float = shared(1.0, non_negative)


def tracking(error: Array, weight: float) -> Array:
    """Return the tracking reward of tracking errors.

    It is ``weight`` for an error of 0, and half of it at :data:`TRACKING_WIDTH`.

    Args:
        error: Tracking errors, in rad, shape (n,).
        weight: Reward for an error of 0.
    """
    return weight / (1.0 + (error / TRACKING_WIDTH) ** 2)


def torque_cost(action: Array, weight: float) -> Array:
    """Return the torque term of the reward: minus the weighted square of the action.

    Args:
        action: Torques as fractions of the torque limit, shape (n,).
        weight: Cost of the torque limit.
    """
    return -weight * action**2


class CrankTask(CommandedTask):
    """Task of turning the crank along a reference; see :class:`JansenCrankEnv`."""

    SETTINGS = CrankSettings
    OBSERVED = (
        Observed("tracking_error", "rad", -np.inf, np.inf, EXACT),
        Observed("speed_command", "rad/s", -FASTEST_COMMAND, FASTEST_COMMAND, EXACT),
    )
    INFO = {
        "tracking_error": float,
        "speed_command": float,
        "rms_error": float,
        "is_success": bool,
    }
    TERMS = ("tracking", "torque")
    FASTEST = FASTEST_COMMAND

    def __init__(self, settings: CrankSettings, threads: int | None = None) -> None:
        self._weights = settings.tracking_weight, settings.torque_weight
        super().__init__(settings, threads)

    @property
    def reference(self) -> Array:
        """Reference r(t) = w t + pi of each crank angle now, in rad, shape (n,)."""
        elapsed = self.world.elapsed.astype(float)
        return self.info["speed_command"] * elapsed * self.control_dt + START_ANGLE

    @property
    def tracking_error(self) -> Array:
        """Reference minus crank angle of each robot, in rad, shape (n,)."""
        return self.reference - self.world.crank_angle

    @override
    def observe(self) -> Mapping[str, Array]:
        """Return the tracking error and the command of each robot."""
        error = self.tracking_error
        self.keep(tracking_error=error)
        return {"tracking_error": error, "speed_command": self.info["speed_command"]}

    @override
    def reward(self) -> Array:
        """Return the reward for following the reference with a small torque."""
        close = tracking(self.tracking_error, self._weights[0])
        cost = torque_cost(self.world.action, self._weights[1])
        self.keep(tracking=close, torque=cost)
        self._keep_success()
        return close + cost

    def _keep_success(self) -> None:
        """Store the RMS tracking error of the episode so far, and whether it is a success."""
        mean_square = np.square(self.info["rms_error"])
        mean_square += (np.square(self.tracking_error) - mean_square) / np.maximum(
            1, self.world.elapsed
        )
        rms = np.sqrt(mean_square)
        lost = (np.abs(self.tracking_error) > LOST) | self.truncated
        self.keep(rms_error=rms, is_success=(rms <= CLOSE) & ~lost)

    @override
    def terminated(self) -> Bools:
        """Return whether each robot has lost its reference, which ends the episode."""
        return np.abs(self.tracking_error) > LOST

    @override
    def scene(self, i: int) -> Values:
        """Return the arguments of the renderer for a robot.

        Args:
            i: Index of the robot.
        """
        speed_range = 2.0 * max(1e-3, *map(abs, self.speed_command[i].tolist()))
        return {**super().scene(i), "speed_range": speed_range}


class JansenCrankEnv(SingleEnv[CrankTask]):
    """Turn the crank of a Jansen linkage along a reference; the chassis is fixed in the air.

    ## Description
    This is the experiment of *Dynamic Analysis and Modeling of Jansen Mechanism*, section 3. Four
    legs share one crank shaft and the frame is pinned, which leaves one degree of freedom
    (16 - 15), equation (12). The crank must follow r(t) = w t + pi. The torque that this requires
    oscillates between 1 and 2 N m twice per turn. The PID controller of the paper (13) lags behind
    the reference; a controller that knows the dynamics of the robot can avoid this lag.

    ## Action Space
    | Num | Action | Min | Max | Unit |
    |-----|--------|-----|-----|------|
    | 0 | crank torque, as a fraction of ``torque_limit`` (5 N m) | -1 | 1 | 1 |

    A positive torque turns the crank counter-clockwise. Actions beyond the limits are clipped.

    ## Observation Space
    | Num | Observation | Min | Max | Unit |
    |-----|-------------|-----|-----|------|
    | 0 | cosine of the crank angle | -1 | 1 | 1 |
    | 1 | sine of the crank angle | -1 | 1 | 1 |
    | 2 | crank speed | -Inf | Inf | rad/s |
    | 3 | tracking error: reference minus crank angle | -Inf | Inf | rad |
    | 4 | commanded crank speed w | -10 | 10 | rad/s |
    | last | with ``observe_lengths``: as in ``JansenWalker-v0`` | -Inf | Inf | 1 |

    ## Rewards
    The reward is the sum of two terms, which ``info`` contains:

    | Term | Value |
    |------|-------|
    | ``reward/tracking`` | ``tracking_weight`` / (1 + (e / 0.8 rad)^2), where e is the tracking error after the step |
    | ``reward/torque`` | -``torque_weight`` * (torque / ``torque_limit``)^2 |

    The default weights require a compromise. The best controller follows the reference with an RMS
    error of about 0.04 rad and needs a slightly smaller RMS torque than the PID controller of the
    paper, whose RMS error is 0.12 rad.

    ## Starting State
    The crank starts at the angle pi with the speed 0, each with an error that is uniform in
    +- ``reset_noise_scale``. The command is uniform in ``speed_command``. The options
    ``reset(options={"speed_command": 2.0, "crank_angle": 3.0, "crank_speed": 0.0})`` set any of
    these values. The reference always starts at pi. Link lengths are specified or sampled as in
    ``JansenWalker-v0``.

    ## Episode End
    An episode is terminated when the tracking error exceeds pi. It is truncated after 1,000 steps
    (10 s) if the environment was made with ``gym.make``.

    ## Information
    ``info`` contains ``crank_angle`` in rad (not wrapped), ``crank_speed`` in rad/s,
    ``crank_torque`` in N m, ``tracking_error`` in rad, ``rms_error`` in rad (over the episode so
    far), ``is_success`` (whether ``rms_error`` is at most 0.2 rad and the reference is not lost),
    and ``speed_command`` in rad/s.

    ``energy`` contains the energies of this step, in J: ``motor_work``, ``joint_loss``,
    ``mechanical_energy_change`` and ``residual``, of which the first is the sum of the others, and
    ``electrical_work``, which the motor consumed. At a reset, the energies and the terms of the
    reward are 0.

    With ``track_joint_forces``, ``info`` also contains ``joint_force_max`` in N, the largest force
    that a link exerts on any of its joints at the end of the step. ``joint_forces()`` returns all
    joint forces.

    ## Arguments
    | Argument | Default | Meaning |
    |----------|---------|---------|
    | ``robot`` | ``"paper"`` | a :class:`jansen_env.Robot`, or the name of a built-in design; a robot that cannot stand on its toes is accepted with a warning, because the chassis is fixed |
    | ``speed_command`` | 1 | commanded crank speed in rad/s, a number or a range |
    | ``motor`` | robot's (ideal) | a :class:`jansen_env.Motor`, or the name of a motor |
    | ``torque_limit`` | motor's (ideal: 5) | torque limit in N m, which replaces that of the motor |
    | ``delay`` | 0 | time in s by which torques are delayed, at most 1; or a range, sampled at each reset |
    | ``control_dt`` | 0.01 | time in s for which an action is held (the default is that of the paper); a multiple of ``time_step``, at most 10,000 times as long |
    | ``time_step`` | 0.001 | time step of the integration in s, 1e-9 to 1 |
    | ``tracking_weight``, ``torque_weight`` | 1, 1 | see Rewards |
    | ``reset_noise_scale`` | 0.1 | largest error of the initial state, in rad and rad/s |
    | ``randomize`` | None | ``{"lengths": 0.1}``, as in ``JansenWalker-v0`` |
    | ``observe_lengths`` | False | whether observations end with the link lengths of the episode |
    | ``track_joint_forces`` | False | whether ``info`` contains the largest joint force; a step then takes 1 ms longer |
    | ``render_mode`` | None | ``"human"`` or ``"rgb_array"`` |

    ## Version History
    * v0: first release.
    """

    TASK = CrankTask
    BENCHMARK = "jansen_env.tasks.crank.crank_benchmark:CRANK"

    def __init__(self, **arguments: Unpack[CrankArguments]) -> None:
        super().__init__(**arguments)

    @property
    def reference(self) -> float:
        """Reference r(t) = w t + pi of the crank angle now, in rad."""
        return float(self.task.reference[0])

    def joint_forces(self) -> JointForces:
        """Return the present forces in all joints, under the torque of the last action."""
        return self.task.world.joint_forces()


class CrankVectorArguments(VectorArguments, CrankArguments, total=False):
    """Arguments of :class:`JansenCrankVectorEnv`."""


class JansenCrankVectorEnv(TaskVectorEnv[CrankTask]):
    """Vector environment of many :class:`JansenCrankEnv` robots, made by ``gym.make_vec``."""

    SINGLE = JansenCrankEnv

    def __init__(self, num_envs: int = 1, **arguments: Unpack[CrankVectorArguments]) -> None:
        super().__init__(num_envs, **arguments)
