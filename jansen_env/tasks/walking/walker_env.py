"""``JansenWalker-v0``: walk at a commanded speed by the torque on one crank.

:mod:`jansen_env.engine.walk_reward` contains the constants of the reward.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from typing_extensions import Unpack, override

from jansen_env.arrays import Array
from jansen_env.checks import MOST_SINGLE, invalid, non_negative, positive, within
from jansen_env.dynamics.joint_forces import JointForces
from jansen_env.engine import walk_reward
from jansen_env.envs.single import SingleEnv
from jansen_env.envs.vector import TaskVectorEnv, VectorArguments
from jansen_env.plants.parameters import plain
from jansen_env.tasks.compiled import CompiledTask
from jansen_env.terrain import Ground
from jansen_env.world.observations import EXACT, Observed
from jansen_env.world.settings import (
    Check,
    PerRobot,
    Range,
    Values,
    WorldArguments,
    WorldSettings,
    each,
    flag,
    optional,
    range_each,
    shared,
)

SPEED_COMMAND = (0.05, 0.8)  # default range of commanded speeds, in m/s
FASTEST_COMMAND = 2.0  # largest commanded speed that makes sense for this robot, in m/s
ACCOUNTS: tuple[str, ...] = walk_reward.ACCOUNTS.names or ()  # names of the lag and the means
COMMANDED = ("speed_command", *ACCOUNTS)  # in the order of ``walk_reward.observe_walk``
ODOMETRY = ("lag", "mean_speed")  # accounts that are observed with ``observe="onboard"``
FURTHEST = walk_reward.FURTHEST_TARGET


class WalkerArguments(WorldArguments, total=False):
    """Arguments of the walkers; :class:`WalkerSettings` has their defaults and checks."""

    speed_command: PerRobot[Range]
    command_interval: PerRobot[float | None]
    slip_weight: float
    energy_weight: float
    effort_weight: float
    smoothness_weight: float
    posture_weight: float
    load_weight: float
    mean_load_cost: bool
    fall_pitch: float
    fall_contact: bool
    terminate_when_fallen: bool


@dataclass(frozen=True, kw_only=True)
class WalkerSettings(WorldSettings):
    """Arguments of ``JansenWalker-v0`` and its presets: those of the world and of the task.

    Commands are in m/s, their interval is in s, and the pitch is in rad. Weights are exponents of
    the factors of the reward.
    """

    speed_command: list[tuple[float, float]] = range_each(
        SPEED_COMMAND, -FASTEST_COMMAND, FASTEST_COMMAND
    )
    command_interval: list[float | None] = each(None, optional(positive))
    slip_weight: float = shared(1.0, non_negative)
    energy_weight: float = shared(1.0, non_negative)
    effort_weight: float = shared(1.0, non_negative)
    smoothness_weight: float = shared(1.0, non_negative)
    posture_weight: float = shared(1.0, non_negative)
    load_weight: float = shared(1.0, non_negative)
    mean_load_cost: bool = shared(False, flag)
    fall_pitch: float = shared(walk_reward.FALLEN_PITCH, positive)
    fall_contact: bool = shared(True, flag)
    terminate_when_fallen: bool = shared(True, flag)


class WalkerTask(CompiledTask):
    """Task of walking at a commanded speed, in m/s.

    See :class:`jansen_env.tasks.walking.walker_env.JansenWalkerEnv`. One kernel computes the
    reward, the end of the episode and the observation of a step. A derived task may extend it in
    NumPy.
    """

    SETTINGS = WalkerSettings
    OBSERVED = (
        Observed("speed_command", "m/s", -FASTEST_COMMAND, FASTEST_COMMAND, EXACT),
        # Accounts, which are computed from measurements if sensors are noisy or onboard.
        Observed("lag", "m", -FURTHEST, FURTHEST, EXACT),
        Observed("mean_speed", "m/s", -np.inf, np.inf, EXACT),
        Observed("mean_slip", "m/s", 0.0, np.inf, EXACT),
        Observed("mean_power", "W", 0.0, np.inf, EXACT),
        Observed("rms_torque", "N m", 0.0, np.inf, EXACT),
    )
    COMPILED = COMMANDED
    ROW = walk_reward.ROW
    # These values follow from the robot, the arguments, and the command of the last step.
    OMITTED = ("mean_path", "command_range", "command_steps", "next_command")
    SETTABLE = ("speed_command", "command")
    FASTEST = FASTEST_COMMAND

    def __init__(self, settings: WalkerSettings, threads: int | None = None) -> None:
        if self.COMPILED != COMMANDED:  # the kernel fills these columns, and no others
            raise invalid("COMPILED", self.COMPILED, f"{COMMANDED}; observe() returns the others")
        super().__init__(settings, threads)
        weights = (getattr(settings, f"{factor}_weight") for factor, _ in walk_reward.WEIGHTED)
        fall = settings.fall_pitch, settings.fall_contact, settings.terminate_when_fallen
        self.world.reward_settings[0] = (*weights, *fall, settings.mean_load_cost)
        intervals = np.array(settings.command_interval, float)  # NaN for None
        steps = np.maximum(1.0, np.rint(intervals / self.control_dt))
        self.data["command_steps"] = np.where(np.isfinite(intervals), steps, 0.0)
        self.data["command_range"] = settings.speed_command

    @override
    def _connect(self) -> None:
        super()._connect()
        self.speed_command = self.data["command_range"]

    @override
    def _order(self, world: Sequence[Observed]) -> tuple[Observed, ...]:
        """Return all observations in the documented order; those of a derived task come last."""
        places = {"speed_command": 1, "toe_load": 2, "last_action": 3, "height_scan": 5}
        places |= dict.fromkeys(ACCOUNTS, 4)
        every = [*world, *self.OBSERVED]
        if self.world.is_onboard:
            every = [e for e in every if e.name in ODOMETRY or e.name not in ACCOUNTS]

        def place(entry: Observed) -> int:
            kind = entry.name.rstrip("_0123456789")  # without numbers of toes and heights
            return places.get(kind, 0 if entry in world else 6)

        return tuple(sorted(every, key=place))

    @override
    def progress(self, i: int) -> tuple[float, float]:
        """Return how far a robot walked in the direction of its commands.

        Args:
            i: Index of the robot.

        Returns:
            The distance, in m, and the mean magnitude of the commands, in m/s.
        """
        walked, commanded = self.data["covered"][i].tolist()
        return walked, commanded / (max(1, int(self.world.elapsed[i])) * self.control_dt)

    @override
    def _change(self, i: int, changes: Values) -> Callable[[], None]:
        """Check a new range of commands, and a command that applies from the next step on."""
        others = {name: value for name, value in changes.items() if name != "command"}
        apply_range = super()._change(i, others)
        if "command" not in changes:
            return apply_range
        command = within("command", changes["command"], -self.FASTEST, self.FASTEST)

        def apply() -> None:
            apply_range()
            self.info["speed_command"][i] = self.data["next_command"][i] = command
            self._describe(np.array([i]))

        return apply

    @override
    def set_state(self, i: int, state: Values) -> None:
        super().set_state(i, state)
        self.data["next_command"][i] = self.info["speed_command"][i]

    @override
    def _checks_of_state(self) -> dict[str, Check]:
        """Return checks of the accounts, exact and measured, and of the mean for the load."""
        measured = {f"task.measured.{name}": partial(self._checked, name) for name in ACCOUNTS}
        return {
            **super()._checks_of_state(),
            **measured,
            "task.mean_unevenness": partial(within, low=0.0, high=MOST_SINGLE),
        }


class JansenWalkerEnv(SingleEnv[WalkerTask]):
    r"""Walk at a commanded speed by the torque on one crank.

    ## Description
    A planar Theo Jansen linkage walks on the ground. By default it is the four-legged robot of
    *Dynamic Analysis and Modeling of Jansen Mechanism*: 32 bodies on one crank shaft, 3.2 kg. Its
    dynamics are the projected equations of the paper with a free chassis (4 degrees of freedom),
    and its toes stick and slip by Coulomb's law. At a low constant crank speed its toes slip, and
    at some speeds the robot falls over. The task is to control the torque so that the robot walks
    better than that.

    ## Action Space
    | Num | Action | Min | Max | Unit |
    |-----|--------|-----|-----|------|
    | 0 | crank torque, as a fraction of ``torque_limit`` (20 N m) | -1 | 1 | 1 |

    A positive action makes every robot walk towards +x: it turns the crank of the paper's robot
    counter-clockwise, and that of the holy designs clockwise. The reaction torque acts on the
    chassis. Actions beyond the limits are clipped.

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
    | 11 + n | lag: distance by which the target is ahead of the robot | -0.5 | 0.5 | m |
    | 12 + n | mean speed | -Inf | Inf | m/s |
    | 13 + n | mean of the sum of the slip speeds of all toes | 0 | Inf | m/s |
    | 14 + n | mean absolute motor power | 0 | Inf | W |
    | 15 + n | RMS torque | 0 | Inf | N m |
    | 16 + n .. | with ``height_scan``: height of the crank axis over the ground at each scanned position | -Inf | Inf | m |
    | last | with ``observe_lengths``: each link length / the robot's own length, minus 1 (``docs/worlds.md``) | -Inf | Inf | 1 |

    n is the number of toes (4: rf, lf, rb, lb). At a reset, the loads are those at rest. The crank
    angle and the crank speed have the sign of the action: with a positive speed, the robot walks
    towards +x. (In ``info`` they have their physical signs.) The reward is computed from the lag,
    the means and the RMS torque. With ``mean_load_cost``, it also depends on a mean that no
    observation contains, see Rewards. With ``noise``, the observed lag and means are computed from
    measurements, and the mean slip is 0.

    With ``height_scan=(behind, ahead, count)``, the terrain is scanned at ``count`` positions,
    evenly spaced from x - behind to x + ahead (in m; a single position is at x - behind). x is the
    position of the crank axis. The positions do not depend on the pitch or the command: for a robot
    that walks towards -x, the positions ahead of it come first. With ``noise``, all sensors have
    errors, as :class:`jansen_env.Noise` documents.

    ``observe="onboard"`` provides what the onboard computer of a real machine can measure: the
    crank angle and speed from an encoder, the pitch, the pitch rate, the velocity in x and the
    accelerations of the crank axis from an IMU and the leg kinematics
    (:mod:`jansen_env.engine.onboard_estimates`), the crank torque from the motor current (in N m),
    the command, the last action, and the lag and the mean speed from odometry. It provides no
    height, loads or slip.

    ## Rewards
    A target starts at the position of the robot and moves at the commanded speed. It waits while
    the robot is 0.5 m away from it. A robot that walks at the commanded mean speed, however
    unevenly, stays with the target. Speed, slip, power and torque are averaged over a step of the
    feet, by exponential means with the time constant T. T is the time that a quarter turn of the
    crank takes at the commanded speed: the advance of the robot in a quarter turn
    (:func:`jansen_env.robot.kinematics.advance_per_turn`; 0.16 m) / \|command\|, limited to 0.2 to
    3.4 s. The means are 0 at first. The reward is the product of the following factors. Each factor
    is between 0 and 1, and ``info`` contains it:

    | Factor | Value |
    |--------|-------|
    | ``reward/tracking`` | 0.3 + 0.7 / (1 + (lag / 0.2 m)^2) |
    | ``reward/progress`` | with r = mean speed / command: 0 if r is below 0, r up to 1, 1 from 1 to 2 (the robot may catch up), and 2 / r above 2; for the command 0: 1 - \|mean speed\| / 0.05 m/s, at least 0 |
    | ``reward/slip`` | 1 / (1 + s / 0.2), where s is the mean slip speed of all toes together / v |
    | ``reward/energy`` | 1 / (1 + c / 4), where c = mean motor power / (weight v) is a cost of transport |
    | ``reward/effort`` | 1 / (1 + (RMS torque / (weight * 0.3 m))^2) |
    | ``reward/smoothness`` | 1 / (1 + (change of the action / 0.8)^2) |
    | ``reward/posture`` | 1 / (1 + (pitch / 0.4 rad)^2) |
    | ``reward/load`` | 1 / (1 + ((ground load - 1) / 0.8)^2), with the mean of the square over the windows that end in the step, see Information |

    Here v = max(\|command\|, 0.05 m/s). The last six factors are raised to the powers
    ``slip_weight`` ... ``load_weight``, which are 1 by default; an exponent of 0 leaves a factor
    out. With ``mean_load_cost``, the square in ``reward/load`` is an exponential mean with the time
    constant T, too, so a hard landing also lowers the reward of the following steps. A robot that
    stands still earns nothing unless the command is 0. A fall costs what the rest of the episode
    would have earned.

    ## Starting State
    The crank angle is uniform over a turn. The robot is placed at rest at x = 0, on the lowest toe
    in front of its centre of mass and the lowest toe behind it. The crank speed is uniform in +-
    ``reset_noise_scale`` rad/s, and the command is uniform in ``speed_command``. The options
    ``reset(options={"speed_command": 0.3, "crank_angle": 0.0})`` set these values.

    ``reset(options={"pushes": [(t, Jx, Jy), ...]})`` pushes the chassis at the times t of the
    episode, in s, with the impulses Jx and Jy, in N s. It replaces the random pushes in this
    episode. At most 1000 pushes are allowed. Each lasts as long as the argument ``push`` specifies,
    or 0.1 s without this argument. In a vector environment, the option is a list with one such list
    per robot, or None for a robot whose pushes are random. ``push((Jx, Jy))`` adds a push that
    starts now.

    All random numbers come from the generator that ``reset(seed=...)`` seeds. They are sampled in
    this order: crank angle, command, crank speed, ``delay`` if it is a range, a seed for lengths,
    noise and pushes, ``terrain_level`` if it is a range, the parameters that ``randomize`` names
    (in the order of the table in ``docs/worlds.md``), and the terrain. ``reset(options={"friction":
    0.5, "terrain_level": 3})`` sets any of the parameters for one episode. The other parameters do
    not change because of such an option.

    ``reset(options={"robot": ...})`` replaces the robot permanently, including its motor, pads and
    payload. The new robot must have the same linkage and legs on the same sides. In a vector
    environment, the option is one robot for all, or one per robot. No machine code is compiled for
    the new robot; a robot with other lengths takes 3 ms.

    ``reset(options={"lengths": {"crank": 0.1, "foot_CE": 0.26}})`` gives the robot other link
    lengths for one episode, in m. :func:`jansen_env.robot.lengths.lengths` returns their names.
    Masses and inertias change accordingly. The next reset without this option restores the robot's
    own lengths. In a vector environment, the option is one mapping for all robots, or a list. With
    ``randomize={"lengths": 0.1}``, each length is multiplied by its own factor, uniform in 0.9 to
    1.1. The factors are sampled until the linkage closes at a distance from any dead point. An
    option then sets only the lengths that it names.

    A command may be negative (walk towards -x) or 0 (stand). It stays the same during the episode
    unless ``command_interval`` or ``set_parameters(command=...)`` changes it.

    ## Episode End
    An episode is terminated when the robot has fallen: \|pitch\| exceeds ``fall_pitch``, or, with
    ``fall_contact``, a joint other than a toe (knee, ankle, hip, frame pivot) is pressed on the
    ground. Out of 60 falls, the paper's robot gets up after 6 on flat ground and after 4 on rough
    ground, and the holy robot after 36 on rough ground.

    An episode is truncated after 500 steps (10 s) if the environment was made with ``gym.make``. It
    is also truncated if the simulation diverges (because of extreme torques, time steps or
    terrains). That step then has no effect, and ``info`` and a warning report it.

    ## Information
    ``info`` contains:

    * ``x_position`` in m, ``x_velocity`` in m/s, ``pitch`` in rad, ``crank_angle`` in rad (not
      wrapped), ``crank_speed`` in rad/s, ``crank_torque`` in N m.
    * ``speed_command`` in m/s, ``lag`` in m, ``mean_speed`` and ``mean_slip`` in m/s,
      ``mean_power`` in W, ``rms_torque`` in N m (see Rewards).
    * ``slip``, shape (n,): distance in m that each toe slid while it was loaded in this step.
    * ``contact_force``, shape (n, 2): mean tangential and normal force on each toe, in N.
    * ``ground_load``: the sum of the normal forces of all contacts, averaged over 20 ms and divided
      by the weight. It is the largest value of the windows of 20 ms that ended in this step.
    * ``unsupported``: the fraction of this step's time in which the sum of the normal forces is
      below a tenth of the weight.
    * ``is_success``: whether the episode is a success so far, which means no fall and at least 0.8
      of the commanded distance.
    * ``links_in_ground``: number of sides of links (lines between two joints with pads) that pass
      below a vertex of the ground at the end of this step. Rods that end at a crank pin are not
      counted.
    * ``fallen``: whether the robot has fallen since the last reset.
    * ``energy``: energies of this step, in J: ``motor_work``, ``push_work``, ``correction_work``
      (energy added by lifting sunken pads out of the ground), ``joint_loss``, ``slip_loss``,
      ``impact_loss``, ``mechanical_energy_change`` and ``residual``. The sum of the first three
      equals the sum of the others, and no loss is negative (``docs/theory.md``, Energy).
      ``electrical_work`` is the energy that the motor consumed.
    * ``joint_gap``: the widest gap of any joint in this step, in m, play included (0 on the
      projection plant).
    * ``joint_force_max`` in N, with ``track_joint_forces``: the largest force that a link exerts on
      any of its joints in this step, without the time steps in which a toe lands.
      ``joint_impulse_max`` in N s is the largest impulse in those time steps (0 if there were
      none). ``joint_forces()`` returns all joint forces.
    * ``diverged``: whether the simulation diverged in this step, see Episode End.
    * ``true_observation``, with ``noise``: the observation without noise.
    * ``parameters``, if the terrain or parameters are sampled: the parameters of the episode, by
      name. (``env.unwrapped.parameters`` is the same as a vector.)

    At a reset, the terms of the reward and the joint loads are 0, and ``energy`` contains the
    energies of a simulated look ahead of one time step.

    ## Arguments
    | Argument | Default | Meaning |
    |----------|---------|---------|
    | ``robot`` | ``"paper"`` | a :class:`jansen_env.Robot`, or the name of a built-in design; for many robots also a list |
    | ``terrain`` | ``"flat"`` | a :class:`jansen_env.Terrain`, ``"flat"``, ``"slope:ANGLE"`` (rad), (x, y) points, or a ``pymunk.Space`` or list of static shapes; or a generator that creates new terrain at each reset: ``"rough"``, ``"stairs"``, ``"mixed"`` ... or a callable (``docs/terrain.md``) |
    | ``terrain_level`` | 0 | level of a generated terrain, 0 to 9, or (low, high), sampled at each reset |
    | ``curriculum`` | None | a :class:`jansen_env.Curriculum` that sets the level; True for the default curriculum |
    | ``randomize`` | None | parameters that are sampled at each reset, by name: ranges or distributions (``docs/worlds.md``) |
    | ``friction`` | terrain's (0.8) | Coulomb friction coefficient |
    | ``restitution`` | terrain's (0) | Newton's coefficient of restitution, 0 to 1 |
    | ``speed_command`` | (0.05, 0.8) | commanded speed in m/s, a number or a range |
    | ``command_interval`` | None | time in s after which a new command is sampled from ``speed_command``; None for never |
    | ``payload`` | robot's (none) | a :class:`jansen_env.Payload`, or a mass in kg at the crank axis |
    | ``motor`` | robot's (ideal) | a :class:`jansen_env.Motor`, or the name of a motor |
    | ``torque_limit`` | motor's (20) | torque limit in N m, which replaces that of the motor |
    | ``pad_compliance`` | robot's (rigid) | a :class:`jansen_env.Compliance`: the compliance of the feet |
    | ``delay`` | 0 | time in s by which torques are delayed, at most 1; or a range, sampled at each reset |
    | ``control_dt`` | 0.02 | time in s for which an action is held; a multiple of ``time_step``, at most 10,000 times as long |
    | ``time_step`` | the plant's | time step of the integration in s, 1e-9 to 1: 0.001, or for ``"rigid_body"`` 0.00025, or 0.000125 with ``joint_play``; must be short enough for compliant feet |
    | ``plant`` | ``"projection"`` | simulation backend that moves the robot, see Plants |
    | ``links_collide`` | False | whether sides of links touch vertices of the ground, see Plants |
    | ``joint_play`` | 0 | radial clearance of every pin of the legs in m, 0 to 0.005; or clearances by joint, such as ``{"A": 0.0003}``; only with ``plant="rigid_body"``, see Plants |
    | ``backlash`` | 0 | dead band between the motor and the crank in rad at the crank, 0 to 1; only with ``plant="rigid_body"`` and a motor with a rotor inertia, see Plants |
    | ``slip_weight``, ``energy_weight``, ``effort_weight``, ``smoothness_weight``, ``posture_weight``, ``load_weight`` | 1 | exponents of the factors, see Rewards |
    | ``mean_load_cost`` | False | whether the cost of the load is averaged over a quarter turn of the crank, see Rewards |
    | ``reset_noise_scale`` | 0.1 | largest initial crank speed, in rad/s |
    | ``fall_pitch`` | 1.2 | pitch in rad beyond which the robot has fallen |
    | ``fall_contact`` | True | whether a joint on the ground is a fall |
    | ``terminate_when_fallen`` | True | whether a fall ends the episode |
    | ``track_joint_forces`` | False | whether ``info`` contains the largest joint force; a step then takes about 10 ms longer |
    | ``torque_rate`` | None | fastest change of the commanded torque in N m/s, reached if the action differs by 1 from the present one; for smaller differences the rate is proportional to the difference |
    | ``observe`` | ``"all"`` | ``"all"`` or ``"onboard"``, see Observation Space |
    | ``height_scan`` | None | (behind, ahead, count), in m: positions at which the terrain is scanned |
    | ``noise`` | None | the :class:`jansen_env.Noise` of the sensors, or a dictionary of its arguments |
    | ``observe_lengths`` | False | whether observations end with the link lengths of the episode |
    | ``push`` | None | a :class:`jansen_env.Push`: random pushes on the chassis; or a dictionary of its arguments |
    | ``render_mode`` | None | ``"human"`` or ``"rgb_array"`` |

    ## Plants
    The same task runs on two plants (simulation backends). They share the data of the robot, the
    ground, the contact laws and the motor, but not the equations and solvers. ``"projection"``
    integrates the projected equations of the paper with exact contacts, and is fast enough for
    training. ``"rigid_body"`` consists of the bodies and joints of pymunk, and is about a thousand
    times slower. pymunk solves the contacts of rigid feet; compliant feet are springs and dampers
    that push the bodies. The joints have small gaps (``info["joint_gap"]``). A policy that walks on
    both plants does not exploit numerical errors.

    Only ``"rigid_body"`` has pins with play and gears with backlash. With ``joint_play``, each pin
    of the legs moves freely in a hole that is wider by this radius, and ``info["joint_gap"]``
    contains the play. With ``backlash``, the rotor of the motor turns freely within the dead band
    and drives the crank at its two ends (``docs/joint_play.md``).

    With ``links_collide=True``, sides of links touch vertices of the ground by the contact law of
    the pads, as capsules with the radius of the pads, if the vertices are those of ridges. Such a
    contact is not a fall. Robots are placed so that no side is in the ground. The crank, and rods
    that end at the crank pin, pass through the ground.

    ## Version History
    * v0: first release.
    """

    TASK = WalkerTask
    BENCHMARK = "jansen_env.tasks.walking.walker_benchmark:WALKER"

    def __init__(self, **arguments: Unpack[WalkerArguments]) -> None:
        super().__init__(**arguments)

    @property
    def terrain(self) -> Ground:
        """The terrain of this episode."""
        return self.task.world.terrain(0)

    @property
    def weight(self) -> float:
        """Weight of the robot and its payload, in N."""
        return float(self.task.world.weight[0])

    @property
    def parameters(self) -> Array:
        """Parameters of this episode, shape (18,).

        Their order, names and units are those of :data:`jansen_env.plants.parameters.PARAMETERS`.
        """
        return plain(self.task.world.records.parameters)[0].copy()

    def joint_forces(self) -> JointForces:
        """Return the present forces in all joints, under the last torque and the push.

        The forces are means over the next time step. If a toe touches down in it, its impulse
        divided by the time step is included.

        Raises:
            ValueError: If the plant is not ``"projection"``.
            gymnasium.error.ResetNeeded: If :meth:`reset` has not been called yet.
        """
        self._check_begun()
        return self.task.world.joint_forces()


class WalkerVectorArguments(VectorArguments, WalkerArguments, total=False):
    """Arguments of :class:`JansenWalkerVectorEnv`."""


class JansenWalkerVectorEnv(TaskVectorEnv[WalkerTask]):
    """Vector environment of many :class:`JansenWalkerEnv` robots, made by ``gym.make_vec``."""

    SINGLE = JansenWalkerEnv

    def __init__(self, num_envs: int = 1, **arguments: Unpack[WalkerVectorArguments]) -> None:
        super().__init__(num_envs, **arguments)
