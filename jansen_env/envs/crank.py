"""``JansenCrank-v0``: the paper's fixed model; follow a turning reference with the crank."""

from __future__ import annotations

import math
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from jansen_env.checks import finite, non_negative, positive, within
from jansen_env.dynamics.joint_forces import JointForces
from jansen_env.envs import arguments
from jansen_env.plants.fixed_base import PinnedPlant, PinnedResult
from jansen_env.robot import Robot

Observation = NDArray[np.float32]

START_ANGLE = math.pi  # rad, of the reference at time 0, as in the paper
SPEED_COMMAND = 1.0  # rad/s, the paper's
FASTEST_COMMAND = 10.0  # rad/s
LOST = math.pi  # rad, tracking error at which an episode ends
TRACKING_WIDTH = 0.8  # rad, tracking error at which half of the tracking reward is left


class JansenCrankEnv(gym.Env[Observation, NDArray[np.float32]]):
    """Turn the crank of a Jansen linkage along a reference; the chassis is held in the air.

    ## Description
    The experiment of *Dynamic Analysis and Modeling of Jansen Mechanism*, section 3: four legs on one
    crank shaft, the frame pinned, one degree of freedom (16 - 15), equation (12). The crank is to
    follow r(t) = w t + pi. The torque needed for it swings between 1 and 2 N m twice a turn: weight
    and inertia of 32 bodies as the linkage moves them. The paper's PID (13) lags behind; a
    controller that knows the machine need not.

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
    "crank_speed": 0.0})`` fixes any of them; the reference starts at pi in any case.

    ## Episode End
    Terminated when the tracking error exceeds pi. Truncated after 1,000 steps (10 s) when made with
    ``gym.make``.

    ## Information
    ``crank_angle`` rad (not wrapped), ``crank_speed`` rad/s, ``crank_torque`` N m,
    ``tracking_error`` rad, ``speed_command`` rad/s, and ``energy``, J in this step: ``motor_work``,
    ``joint_loss``, ``mechanical_energy_change``, ``residual``; the first is the sum of the others.
    With ``track_joint_forces``: ``joint_force_max`` N, the largest force with which a link bears
    on any of its joints at the end of the step. ``joint_forces()`` has all of them.

    ## Arguments
    | Argument | Default | Meaning |
    |----------|---------|---------|
    | ``robot`` | ``"paper"`` | a :class:`jansen_env.Robot`, or the name of a built-in design |
    | ``speed_command`` | 1 | rad/s, a number or a range |
    | ``torque_limit`` | 5 | N m |
    | ``control_dt`` | 0.01 | s for which an action is held (the paper's); a multiple of ``time_step``, at most 10,000 times as long |
    | ``time_step`` | 0.001 | s, of the integration, 1e-6 to 1 |
    | ``tracking_weight``, ``torque_weight`` | 1, 1 | see Rewards |
    | ``reset_noise_scale`` | 0.1 | rad and rad/s, of the start |
    | ``track_joint_forces`` | False | adds the largest one to ``info``; a step then takes 1 ms more |
    | ``render_mode`` | None | ``"human"`` or ``"rgb_array"`` |

    ## Version History
    * v0: first release.
    """

    metadata: dict[str, Any] = {"render_modes": arguments.RENDER_MODES, "render_fps": 100}

    def __init__(
        self,
        robot: Robot | str = "paper",
        speed_command: float | tuple[float, float] = SPEED_COMMAND,
        torque_limit: float = 5.0,
        control_dt: float = 0.01,
        time_step: float = 0.001,
        tracking_weight: float = 1.0,
        torque_weight: float = 1.0,
        reset_noise_scale: float = 0.1,
        track_joint_forces: bool = False,
        render_mode: str | None = None,
    ) -> None:
        self.render_mode = arguments.render_mode(render_mode)
        self.robot = arguments.load_robot(robot)
        self.speed_command_range = arguments.command_range(speed_command, FASTEST_COMMAND)
        self.torque_limit = positive("torque_limit", torque_limit)
        self.control_dt, time_step = arguments.control_period(control_dt, time_step)
        self.tracking_weight = non_negative("tracking_weight", tracking_weight)
        self.torque_weight = non_negative("torque_weight", torque_weight)
        self.reset_noise_scale = non_negative("reset_noise_scale", reset_noise_scale)
        self.track_joint_forces = arguments.flag("track_joint_forces", track_joint_forces)
        self.metadata = {**self.metadata, "render_fps": max(1, round(1.0 / self.control_dt))}
        self.plant = PinnedPlant(self.robot, time_step=time_step)
        high = np.array([1.0, 1.0, np.inf, np.inf, FASTEST_COMMAND], np.float32)
        self.observation_space = spaces.Box(-high, high, dtype=np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (1,), np.float32)
        self._begun = False
        self._command = SPEED_COMMAND
        self._torque = 0.0
        self._steps = 0
        self._renderer: Any = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode; ``options`` may fix ``speed_command``, ``crank_angle``, ``crank_speed``.

        Raises:
            ValueError: an unknown option, or a value out of range.
        """
        super().reset(seed=seed)
        options = arguments.reset_options(options)
        # Drawn in any case, so that fixing one leaves the others as they were.
        command = self.np_random.uniform(*self.speed_command_range)
        angle = START_ANGLE + self.reset_noise_scale * self.np_random.uniform(-1.0, 1.0)
        speed = self.reset_noise_scale * self.np_random.uniform(-1.0, 1.0)
        if "speed_command" in options:
            command = within(
                "options['speed_command']",
                options.pop("speed_command"),
                -FASTEST_COMMAND,
                FASTEST_COMMAND,
            )
        if "crank_angle" in options:
            angle = within(
                "options['crank_angle']",
                options.pop("crank_angle"),
                START_ANGLE - LOST,
                START_ANGLE + LOST,
            )
        if "crank_speed" in options:
            speed = finite("options['crank_speed']", options.pop("crank_speed"))
        if options:
            raise ValueError(
                f"reset options {sorted(options)} are unknown, allowed are 'speed_command', "
                "'crank_angle' and 'crank_speed'"
            )
        self._command, self._torque, self._steps = command, 0.0, 0
        self.plant.reset(angle, speed)
        self._begun = True
        if self.render_mode == "human":
            self.render()
        return self._observe(), self._info(PinnedResult(0.0, 0.0, 0.0))

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Hold a torque for ``control_dt`` seconds.

        Raises:
            ValueError: the action is not one finite number.
            FloatingPointError: the simulation diverged.
            gymnasium.error.ResetNeeded: before the first :meth:`reset`.
        """
        arguments.check_begun(self._begun)
        share = arguments.torque_share(action)
        self._torque = share * self.torque_limit
        result = self.plant.step(self._torque, self.control_dt)
        self._steps += 1
        error = self._error()
        terms = {
            "reward/tracking": self.tracking_weight / (1.0 + (error / TRACKING_WIDTH) ** 2),
            "reward/torque": -self.torque_weight * share**2,
        }
        info = {**self._info(result), **terms}
        if self.track_joint_forces:
            info["joint_force_max"] = self.joint_forces().largest()[0]
        if self.render_mode == "human":
            self.render()
        return self._observe(), float(sum(terms.values())), abs(error) > LOST, False, info

    @property
    def reference(self) -> float:
        """r(t) = w t + pi, rad: where the crank should be now."""
        return self._command * self._steps * self.control_dt + START_ANGLE

    def _error(self) -> float:
        return self.reference - float(self.plant.state[0])

    def _observe(self) -> Observation:
        angle, speed = self.plant.state.tolist()
        return np.array(
            [math.cos(angle), math.sin(angle), speed, self.reference - angle, self._command],
            dtype=np.float32,
        )

    def _info(self, result: PinnedResult) -> dict[str, Any]:
        angle, speed = self.plant.state.tolist()
        return {
            "crank_angle": angle,
            "crank_speed": speed,
            "crank_torque": self._torque,
            "tracking_error": self.reference - angle,
            "speed_command": self._command,
            "energy": {
                "motor_work": result.motor_work,
                "joint_loss": result.joint_loss,
                "mechanical_energy_change": result.energy_change,
                "residual": result.energy_residual,
            },
        }

    def joint_forces(self) -> JointForces:
        """Forces in every joint of every leg as they are now, under the last action's torque."""
        return self.plant.joint_forces(self._torque)

    def get_state(self) -> dict[str, Any]:
        """All that the future depends on; :meth:`set_state` continues from it bit for bit."""
        return {
            "plant": self.plant.state,
            "command": self._command,
            "torque": self._torque,
            "steps": self._steps,
            "generator": self.np_random.bit_generator.state,
        }

    def set_state(self, state: dict[str, Any]) -> Observation:
        """Go on from a state of :meth:`get_state`; returns its observation.

        A time limit outside the environment (``TimeLimit``) keeps its own count.

        Raises:
            ValueError: an entry is missing, or the plant's state is not 2 finite numbers.
        """
        missing = {*self.get_state()} - {*state}
        if missing:
            raise ValueError(f"state lacks {sorted(missing)}, must come from get_state()")
        self.plant.state = state["plant"]
        self._command, self._torque = float(state["command"]), float(state["torque"])
        self._steps, self._begun = int(state["steps"]), True
        self.np_random.bit_generator.state = state["generator"]
        return self._observe()

    def render(self) -> NDArray[np.uint8] | None:
        """Draw the linkage as it stands; (H, W, 3) uint8 in ``rgb_array`` mode, else None."""
        if self.render_mode is None:
            gym.logger.warn(
                "render() was called without a render_mode; pass render_mode='rgb_array' or 'human'"
            )
            return None
        from jansen_env.rendering import Frame, Renderer

        if self._renderer is None:
            self._renderer = Renderer(
                self.robot, None, self.render_mode, self.metadata["render_fps"],
                speed_range=2.0 * max(1e-3, *map(abs, self.speed_command_range)),
                speed_unit="rad/s",
            )  # fmt: skip
        angle, speed = self.plant.state
        toes = len(self.robot.legs)
        frame = Frame(
            q=np.array([0.0, 0.0, 0.0, angle]),
            contact_point=np.zeros((toes, 2)),
            contact_tangent=np.zeros((toes, 2)),
            contact_force=np.zeros((toes, 2)),
            slipping=np.zeros(toes, bool),
            command=self._command,
            speed=float(speed),
            torque=self._torque,
            torque_limit=self.torque_limit,
            time=self._steps * self.control_dt,
        )
        picture: NDArray[np.uint8] | None = self._renderer.draw(frame)
        return picture

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_renderer": None}
