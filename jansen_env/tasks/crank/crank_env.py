"""``JansenCrank-v0``: the paper's fixed model; follow a turning reference with the crank."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from typing_extensions import Unpack

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

FASTEST_COMMAND = 10.0  # rad/s
CLOSE = 0.2  # rad, RMS tracking error up to which an episode is a success
TRACKING_WIDTH = 0.8  # rad, tracking error at which half of the tracking reward is left


class CrankArguments(RobotArguments, total=False):
    """Arguments of ``JansenCrank-v0``; :class:`CrankSettings` has their defaults and checks."""

    time_step: float
    speed_command: PerRobot[Range]
    tracking_weight: float
    torque_weight: float


@dataclass(frozen=True, kw_only=True)
class CrankSettings(HeldSettings):
    """Arguments of ``JansenCrank-v0``; commands in rad/s, by default the paper's."""

    speed_command: list[tuple[float, float]] = range_each(1.0, -FASTEST_COMMAND, FASTEST_COMMAND)
    tracking_weight: float = shared(1.0, non_negative)
    torque_weight: float = shared(1.0, non_negative)


def tracking(error: Array, weight: float) -> Array:
    """The weight without an error (rad), half of it at :data:`TRACKING_WIDTH`."""
    return weight / (1.0 + (error / TRACKING_WIDTH) ** 2)


def torque_cost(action: Array, weight: float) -> Array:
    """Minus the square of the torque, as a share of its limit."""
    return -weight * action**2


class CrankTask(CommandedTask):
    """Turn the crank along a reference; see :class:`JansenCrankEnv`."""

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
        """(n,) r(t) = w t + pi, rad: where the cranks should be now."""
        elapsed = self.world.elapsed.astype(float)
        return self.info["speed_command"] * elapsed * self.control_dt + START_ANGLE

    @property
    def tracking_error(self) -> Array:
        """(n,) reference less crank angle, rad."""
        return self.reference - self.world.crank_angle

    def observe(self) -> Mapping[str, Array]:
        """Show the tracking error and the command."""
        error = self.tracking_error
        self.keep(tracking_error=error)
        return {"tracking_error": error, "speed_command": self.info["speed_command"]}

    def reward(self) -> Array:
        """Pay for following the reference, at little torque."""
        close = tracking(self.tracking_error, self._weights[0])
        cost = torque_cost(self.world.action, self._weights[1])
        self.keep(tracking=close, torque=cost)
        self._keep_success()
        return close + cost

    def _keep_success(self) -> None:
        """Keep the RMS tracking error of the episode so far, and whether that is a success."""
        mean_square = np.square(self.info["rms_error"])
        mean_square += (np.square(self.tracking_error) - mean_square) / np.maximum(
            1, self.world.elapsed
        )
        rms = np.sqrt(mean_square)
        lost = (np.abs(self.tracking_error) > LOST) | self.truncated
        self.keep(rms_error=rms, is_success=(rms <= CLOSE) & ~lost)

    def terminated(self) -> Bools:
        """A lost reference ends the episode."""
        return np.abs(self.tracking_error) > LOST

    def scene(self, i: int) -> Values:
        """Return the arguments of the renderer."""
        speed_range = 2.0 * max(1e-3, *map(abs, self.speed_command[i].tolist()))
        return {**super().scene(i), "speed_range": speed_range}


class JansenCrankEnv(SingleEnv[CrankTask]):
    """Turn the crank of a Jansen linkage along a reference; the chassis is held in the air.

    ## Description
    The experiment of *Dynamic Analysis and Modeling of Jansen Mechanism*, section 3: four legs on one
    crank shaft, the frame pinned, one degree of freedom (16 - 15), equation (12). The crank is to
    follow r(t) = w t + pi. The torque needed for it swings between 1 and 2 N m twice a turn. The
    paper's PID (13) lags behind; a controller that knows the machine need not.

    ## Action Space
    | Num | Action | Min | Max | Unit |
    |-----|--------|-----|-----|------|
    | 0 | crank torque, as a share of ``torque_limit`` (5 N m) | -1 | 1 | 1 |

    Positive torque turns the crank counter-clockwise. Actions beyond the limits are clipped.

    ## Observation Space
    | Num | Observation | Min | Max | Unit |
    |-----|-------------|-----|-----|------|
    | 0 | cosine of the crank angle | -1 | 1 | 1 |
    | 1 | sine of the crank angle | -1 | 1 | 1 |
    | 2 | crank speed | -Inf | Inf | rad/s |
    | 3 | tracking error, reference less crank angle | -Inf | Inf | rad |
    | 4 | commanded crank speed w | -10 | 10 | rad/s |
    | last | with ``observe_lengths``: as of ``JansenWalker-v0`` | -Inf | Inf | 1 |

    ## Rewards
    The sum of two terms, each in ``info``:

    | Term | Value |
    |------|-------|
    | ``reward/tracking`` | ``tracking_weight`` / (1 + (e / 0.8 rad)^2), e the tracking error after the step |
    | ``reward/torque`` | -``torque_weight`` * (torque / ``torque_limit``)^2 |

    The default weights ask for a compromise: the best control follows at some 0.04 rad RMS and takes
    slightly less RMS torque than the paper's PID, which lags 0.12 rad RMS.

    ## Starting State
    Crank angle pi and crank speed 0, each with an error uniform in +- ``reset_noise_scale``; command
    uniform in ``speed_command``. ``reset(options={"speed_command": 2.0, "crank_angle": 3.0,
    "crank_speed": 0.0})`` fixes any of them; the reference starts at pi in any case. Lengths are given or
    drawn as of ``JansenWalker-v0``.

    ## Episode End
    Terminated when the tracking error exceeds pi. Truncated after 1,000 steps (10 s) when made with
    ``gym.make``.

    ## Information
    ``crank_angle`` rad (not wrapped), ``crank_speed`` rad/s, ``crank_torque`` N m,
    ``tracking_error`` rad, ``rms_error`` rad (of the episode so far), ``is_success`` (whether that
    is at most 0.2 rad), ``speed_command`` rad/s, and ``energy``, J in this step: ``motor_work``,
    ``joint_loss``, ``mechanical_energy_change``, ``residual``; the first is the sum of the others;
    ``electrical_work`` is what the motor drew. At a reset these and the terms of the reward are 0.
    With ``track_joint_forces``: ``joint_force_max`` N, the largest force with which a link bears
    on any of its joints at the end of the step. ``joint_forces()`` has all of them.

    ## Arguments
    | Argument | Default | Meaning |
    |----------|---------|---------|
    | ``robot`` | ``"paper"`` | a :class:`jansen_env.Robot`, or the name of a built-in design; one that cannot stand on its toes is accepted with a warning, as the chassis is held |
    | ``speed_command`` | 1 | rad/s, a number or a range |
    | ``motor`` | robot's (ideal) | a :class:`jansen_env.Motor`, or the name of one |
    | ``torque_limit`` | motor's (ideal: 5) | N m, in place of the motor's own |
    | ``delay`` | 0 | s by which torques come late, at most 1; or a range, drawn at each reset |
    | ``control_dt`` | 0.01 | s for which an action is held (the paper's); a multiple of ``time_step``, at most 10,000 times as long |
    | ``time_step`` | 0.001 | s, of the integration, 1e-9 to 1 |
    | ``tracking_weight``, ``torque_weight`` | 1, 1 | see Rewards |
    | ``reset_noise_scale`` | 0.1 | rad and rad/s, of the start |
    | ``randomize`` | None | ``{"lengths": 0.1}``, as of ``JansenWalker-v0`` |
    | ``observe_lengths`` | False | whether observations end with the lengths of the episode |
    | ``track_joint_forces`` | False | adds the largest one to ``info``; a step then takes 1 ms more |
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
        """r(t) = w t + pi, rad: where the crank should be now."""
        return float(self.task.reference[0])

    def joint_forces(self) -> JointForces:
        """Return the forces in every joint now, under the last action's torque."""
        return self.task.world.joint_forces()


class CrankVectorArguments(VectorArguments, CrankArguments, total=False):
    """Arguments of :class:`JansenCrankVectorEnv`."""


class JansenCrankVectorEnv(TaskVectorEnv[CrankTask]):
    """:class:`JansenCrankEnv` for many robots at once: what ``gym.make_vec`` makes."""

    SINGLE = JansenCrankEnv

    def __init__(self, num_envs: int = 1, **arguments: Unpack[CrankVectorArguments]) -> None:
        super().__init__(num_envs, **arguments)
