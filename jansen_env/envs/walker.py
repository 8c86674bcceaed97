"""``JansenWalker-v0``: walk at a commanded speed by the torque on one crank."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from jansen_env.checks import non_negative, positive
from jansen_env.dynamics.joint_forces import JointForces
from jansen_env.envs import arguments
from jansen_env.envs.rewards import RewardWeights
from jansen_env.envs.walking import (
    FASTEST_COMMAND,
    REWARD_KEYS,
    SPEED_COMMAND,
    WalkingTask,
    draw_start,
    observation_space,
)
from jansen_env.gravity import GRAVITY
from jansen_env.plants.base import StepResult, no_step
from jansen_env.plants.make import make_plant, plant_time_step
from jansen_env.plants.projected import ProjectionPlant
from jansen_env.robot import Payload, Robot
from jansen_env.terrain import Terrain, make_terrain

Observation = NDArray[np.float32]


class JansenWalkerEnv(gym.Env[Observation, NDArray[np.float32]]):
    """Walk at a commanded speed by the torque on one crank.

    ## Description
    A planar Theo Jansen linkage walks on the ground: by default the four-legged machine of
    *Dynamic Analysis and Modeling of Jansen Mechanism*, 32 bodies on one crank shaft, 3.2 kg. Its
    dynamics are the paper's projected equations with the chassis free (4 degrees of freedom);
    its toes stick and slip by Coulomb's law. At constant crank speed its toes must slip, and at
    some speeds it falls over; the task is to do better with the torque.

    ## Action Space
    | Num | Action | Min | Max | Unit |
    |-----|--------|-----|-----|------|
    | 0 | crank torque, as a share of ``torque_limit`` (20 N m) | -1 | 1 | 1 |

    Positive torque turns the crank counter-clockwise, which walks towards +x. Its reaction acts on
    the chassis. Actions beyond the limits are clipped.

    ## Observation Space
    | Num | Observation | Min | Max | Unit |
    |-----|-------------|-----|-----|------|
    | 0 | cosine of the crank angle (crank relative to chassis) | -1 | 1 | 1 |
    | 1 | sine of the crank angle | -1 | 1 | 1 |
    | 2 | crank speed | -Inf | Inf | rad/s |
    | 3 | sine of the chassis pitch | -1 | 1 | 1 |
    | 4 | cosine of the chassis pitch | -1 | 1 | 1 |
    | 5 | pitch rate | -Inf | Inf | rad/s |
    | 6 | velocity of the crank axis in x | -Inf | Inf | m/s |
    | 7 | velocity of the crank axis in y | -Inf | Inf | m/s |
    | 8 | height of the crank axis over the ground below it | -Inf | Inf | m |
    | 9 | commanded speed | -2 | 2 | m/s |
    | 10 .. 9 + n | normal load of each toe / weight, mean over the last step | 0 | Inf | 1 |
    | 10 + n | last action | -1 | 1 | 1 |
    | 11 + n | distance behind the farthest point reached | 0 | Inf | m |

    n is the number of toes (4: rf, lf, rb, lb). At reset the loads are those at rest.

    ## Rewards
    The sum of five terms, each in ``info``:

    | Term | Value |
    |------|-------|
    | ``reward/tracking`` | ``tracking_weight`` * exp(-((v - command) / width)^2), v the mean speed onto new ground over the step, width = min(0.75 \\|command\\|, 0.25 m/s) |
    | ``reward/slip`` | -``slip_weight`` * slip speed of all toes, m/s |
    | ``reward/energy`` | -``energy_weight`` * \\|motor power\\| / (weight * 1 m/s) |
    | ``reward/posture`` | -``posture_weight`` * pitch^2 |
    | ``reward/fall`` | -``fall_weight`` in the step in which the robot falls |

    Standing still earns at most 17 % of the tracking term, at every command. Only new ground
    counts: while the robot is behind the farthest point it has reached, v is at most 0, so that
    creeping forward and leaping back earns no more than standing.

    ## Starting State
    Crank angle uniform over a turn, set down at rest at x = 0 on the lowest toe before and the
    lowest toe behind its centre of mass; crank speed uniform in +- ``reset_noise_scale`` rad/s;
    command uniform in ``speed_command``, or as given by
    ``reset(options={"speed_command": 0.3, "crank_angle": 0.0})``.

    ## Episode End
    Terminated when the robot has fallen: \\|pitch\\| > 1.2 rad, or a joint other than a toe (knee,
    ankle, hip, frame pivot) is pressed on the ground. Truncated after 500 steps (10 s) when made
    with ``gym.make``, and where the simulation diverges (absurd torques, time steps or grounds): that
    step does nothing, says so in ``info`` and in a warning.

    ## Information
    ``x_position`` m, ``x_velocity`` m/s, ``pitch`` rad, ``crank_angle`` rad (not wrapped),
    ``crank_speed`` rad/s, ``crank_torque`` N m, ``speed_command`` m/s, ``slip`` (n,) m slid by each
    toe while loaded in this step, ``contact_force`` (n, 2) mean tangential and normal force on each
    toe in N, ``fallen`` (since the last reset), and ``energy``, J in this step: ``motor_work``, ``joint_loss``,
    ``slip_loss``, ``impact_loss``, ``mechanical_energy_change``, ``residual``; the first is the sum
    of the others; ``joint_gap`` m, the widest gap of any joint in this step (0 on the projection
    plant). With ``track_joint_forces``: ``joint_force_max`` N, the largest force with which a
    link bears on any of its joints in this step, but for the time steps in which a toe lands, and
    ``joint_impulse_max`` N s, the largest impulse in those (0 if there were none). ``joint_forces()`` has all of them.
    ``diverged``: whether this step was refused, see Episode End.

    ## Arguments
    | Argument | Default | Meaning |
    |----------|---------|---------|
    | ``robot`` | ``"paper"`` | a :class:`jansen_env.Robot`, or the name of a built-in design |
    | ``terrain`` | ``"flat"`` | a :class:`jansen_env.Terrain`, ``"flat"``, ``"slope:ANGLE"`` (rad), or (x, y) points |
    | ``friction`` | terrain's (0.8) | Coulomb coefficient |
    | ``restitution`` | terrain's (0) | Newton's coefficient, 0 to 1 |
    | ``speed_command`` | (0.05, 0.8) | m/s, a number or a range |
    | ``torque_limit`` | 20 | N m |
    | ``payload`` | robot's (none) | a :class:`jansen_env.Payload`, or a mass in kg at the crank axis |
    | ``control_dt`` | 0.02 | s for which an action is held; a multiple of ``time_step``, at most 10,000 times as long |
    | ``time_step`` | the plant's | s, of the integration, 1e-6 to 1: 0.001, ``"rigid_body"`` 0.00025 |
    | ``plant`` | ``"projection"`` | what moves the robot, see Plants |
    | ``tracking_weight`` ... ``fall_weight`` | 1, 4, 0.1, 0.5, 200 | see Rewards |
    | ``reset_noise_scale`` | 0.1 | rad/s, of the starting crank speed |
    | ``terminate_when_fallen`` | True | whether a fall ends the episode |
    | ``track_joint_forces`` | False | adds them to ``info``; a step then takes some 10 ms more |
    | ``render_mode`` | None | ``"human"`` or ``"rgb_array"`` |

    ## Plants
    The same task runs on two plants that share the robot's geometry and masses, the ground and how
    it is set down there, but nothing of their dynamics. ``"projection"``
    integrates the paper's projected equations with exact contacts; it is fast, and what policies
    are trained on. ``"rigid_body"`` is built of pymunk's bodies, joints and contacts, some hundred
    times slower; its joints gap a little (``info["joint_gap"]``). A policy that walks on both does
    not live on the numerics of one of them.

    ## Version History
    * v0: first release.
    """

    metadata: dict[str, Any] = {"render_modes": arguments.RENDER_MODES, "render_fps": 50}

    def __init__(
        self,
        robot: Robot | str = "paper",
        terrain: Terrain | str | Any = "flat",
        friction: float | None = None,
        restitution: float | None = None,
        speed_command: float | tuple[float, float] = SPEED_COMMAND,
        torque_limit: float = 20.0,
        payload: Payload | float | None = None,
        control_dt: float = 0.02,
        time_step: float | None = None,
        plant: str = "projection",
        tracking_weight: float = RewardWeights.tracking,
        slip_weight: float = RewardWeights.slip,
        energy_weight: float = RewardWeights.energy,
        posture_weight: float = RewardWeights.posture,
        fall_weight: float = RewardWeights.fall,
        reset_noise_scale: float = 0.1,
        terminate_when_fallen: bool = True,
        track_joint_forces: bool = False,
        render_mode: str | None = None,
    ) -> None:
        self.render_mode = arguments.render_mode(render_mode)
        self.robot = arguments.load_robot(robot, payload)
        self.terrain = make_terrain(terrain, friction, restitution)
        self.speed_command_range = arguments.command_range(speed_command, FASTEST_COMMAND)
        self.torque_limit = positive("torque_limit", torque_limit)
        self.control_dt, time_step = arguments.control_period(
            control_dt, plant_time_step(plant, time_step)
        )
        self.plant = make_plant(plant, self.robot, self.terrain, time_step)
        self.weights = RewardWeights(
            tracking_weight, slip_weight, energy_weight, posture_weight, fall_weight
        )
        self.reset_noise_scale = non_negative("reset_noise_scale", reset_noise_scale)
        self.terminate_when_fallen = arguments.flag("terminate_when_fallen", terminate_when_fallen)
        self.metadata = {**self.metadata, "render_fps": max(1, round(1.0 / self.control_dt))}
        self.track_joint_forces = arguments.flag("track_joint_forces", track_joint_forces)
        if self.track_joint_forces:
            self._traceable.tracing = True
        self.weight = self.robot.mass * GRAVITY
        toes = self.plant.toes
        self._task = WalkingTask(
            [self.terrain], toes, np.array([self.weight]), self.control_dt, self.weights
        )
        self.observation_space = observation_space(toes)
        self.action_space = spaces.Box(-1.0, 1.0, (1,), np.float32)
        self._begun = False
        self._time = 0.0
        self._result: StepResult | None = None
        self._diverged = False
        self._renderer: Any = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Start an episode; ``options`` may fix ``speed_command`` (m/s) and ``crank_angle`` (rad).

        Raises:
            ValueError: an unknown option, or a value out of range.
        """
        super().reset(seed=seed)
        command, crank_angle, crank_speed = draw_start(
            self.np_random,
            self.speed_command_range,
            self.reset_noise_scale,
            arguments.reset_options(options),
        )
        self._time, self._diverged = 0.0, False
        self.plant.reset(0.0, crank_angle)
        self._result = self.plant.peek()
        self._task.begin(
            slice(None), np.array([command]), self._result.contact_force[None, :, 1] / self.weight
        )
        state = self.plant.state
        state[7] = crank_speed
        self.plant.state = state
        self._begun = True
        if self.render_mode == "human":
            self.render()
        return self._observe(state), self._info(state, self._result, float(state[4]), 0.0)

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Hold a torque for ``control_dt`` seconds.

        Raises:
            ValueError: the action is not one finite number.
            gymnasium.error.ResetNeeded: before the first :meth:`reset`.
        """
        arguments.check_begun(self._begun)
        task = self._task
        share = arguments.torque_share(action)
        torque = share * self.torque_limit
        x_before = self.plant.x
        self._diverged = False
        try:
            self._result = result = self.plant.step(torque, self.control_dt)
        except FloatingPointError as error:
            gym.logger.warn(f"the episode ends: {error}")
            self._diverged = True
            self._result = result = no_step(self.plant.toes)
        state = self.plant.state
        task.share[0] = share
        task.judge(
            state[None], np.array([x_before]), result.slip[None], result.contact_force[None],
            np.array([result.motor_work]), np.array([result.bumped]),
        )  # fmt: skip
        self._time += self.control_dt
        info = self._info(state, result, float(task.speed[0]), torque)
        info.update(zip(REWARD_KEYS, task.terms[0].tolist(), strict=True))
        if self.track_joint_forces:
            loads = (0.0, 0.0) if self._diverged else self._traceable.peak_loads()
            info["joint_force_max"], info["joint_impulse_max"] = loads
        if self.render_mode == "human":
            self.render()
        terminated = bool(task.fallen[0]) and self.terminate_when_fallen
        return task.observation[0].copy(), float(task.reward[0]), terminated, self._diverged, info

    def _observe(self, state: NDArray[np.float64]) -> Observation:
        observation: Observation = self._task.observe(state[None])[0].copy()
        return observation

    def _info(
        self, state: NDArray[np.float64], result: StepResult, speed: float, torque: float
    ) -> dict[str, Any]:
        x, _, pitch, crank_angle, _, _, _, crank_speed = state.tolist()
        return {
            "x_position": x,
            "x_velocity": speed,
            "pitch": pitch,
            "crank_angle": crank_angle,
            "crank_speed": crank_speed,
            "crank_torque": torque,
            "speed_command": float(self._task.command[0]),
            "slip": result.slip.copy(),
            "contact_force": result.contact_force.copy(),
            "fallen": bool(self._task.fallen[0]),
            "energy": {
                "motor_work": result.motor_work,
                "joint_loss": result.joint_loss,
                "slip_loss": result.slip_loss,
                "impact_loss": result.impact_loss,
                "mechanical_energy_change": result.energy_change,
                "residual": result.energy_residual,
            },
            "joint_gap": result.joint_gap,
            "diverged": self._diverged,
        }

    def joint_forces(self) -> JointForces:
        """Forces in every joint of every leg as they are now, under the last action's torque.

        Means over the next time step; one in which a toe lands contains its impulse / time step.

        Raises:
            ValueError: the plant is another than ``"projection"``.
            gymnasium.error.ResetNeeded: before the first :meth:`reset`.
        """
        plant = self._traceable
        arguments.check_begun(self._begun)
        return plant.joint_forces(self._torque)

    @property
    def _torque(self) -> float:
        """The last action's torque, N m."""
        return float(self._task.share[0]) * self.torque_limit

    @property
    def _traceable(self) -> ProjectionPlant:
        """The plant, if it knows the forces in its joints."""
        if isinstance(self.plant, ProjectionPlant):
            return self.plant
        raise ValueError(
            "joint forces are known with plant='projection' only: track_joint_forces must be False"
        )

    def get_state(self) -> dict[str, Any]:
        """All that the future depends on; :meth:`set_state` continues from it bit for bit.

        On the plant ``"rigid_body"`` up to what pymunk keeps to itself: there the joints are closed
        and the solver starts anew.
        """
        task = self._task
        return {
            "plant": self.plant.state,
            "pressed": self.plant.pressed,
            "command": float(task.command[0]),
            "action": float(task.share[0]),
            "fallen": bool(task.fallen[0]),
            "farthest": float(task.farthest[0]),
            "time": self._time,
            "loads": task.loads[0].copy(),
            "generator": self.np_random.bit_generator.state,
        }

    def set_state(self, state: dict[str, Any]) -> Observation:
        """Go on from a state of :meth:`get_state`; returns its observation.

        A time limit outside the environment (``TimeLimit``) keeps its own count.

        Raises:
            ValueError: an entry is missing, or the plant's state is not 8 finite numbers.
        """
        missing = {*self.get_state()} - {*state}
        if missing:
            raise ValueError(f"state lacks {sorted(missing)}, must come from get_state()")
        loads = np.array(state["loads"], dtype=float)
        task = self._task
        if loads.shape != task.loads[0].shape:
            raise ValueError(
                f"state['loads'] has shape {loads.shape}, must be {task.loads[0].shape}"
            )
        self.plant.state = state["plant"]
        self.plant.pressed = state["pressed"]
        task.command[0], task.share[0] = float(state["command"]), float(state["action"])
        task.fallen[0], task.farthest[0] = bool(state["fallen"]), float(state["farthest"])
        task.loads[0] = loads
        self._time = float(state["time"])
        self.np_random.bit_generator.state = state["generator"]
        self._result = None
        self._begun = True
        return self._observe(self.plant.state)

    def render(self) -> NDArray[np.uint8] | None:
        """Draw the robot as it stands; (H, W, 3) uint8 in ``rgb_array`` mode, else None."""
        if self.render_mode is None:
            gym.logger.warn(
                "render() was called without a render_mode; pass render_mode='rgb_array' or 'human'"
            )
            return None
        from jansen_env.envs.walker_picture import walking_frame
        from jansen_env.rendering import Renderer

        if self._renderer is None:
            self._renderer = Renderer(
                self.robot, self.terrain.polyline, self.render_mode, self.metadata["render_fps"]
            )
        toes, result = self.plant.toes, self._result
        slip = np.zeros(toes) if result is None else result.slip
        force = np.zeros((toes, 2)) if result is None else result.contact_force
        frame = walking_frame(
            self.plant, slip, force, float(self._task.command[0]), self._torque,
            self.torque_limit, self._time, self.control_dt,
        )  # fmt: skip
        picture: NDArray[np.uint8] | None = self._renderer.draw(frame)
        return picture

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_renderer": None}
