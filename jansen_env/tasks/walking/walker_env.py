"""``JansenWalker-v0``: walk at a commanded speed by the torque on one crank.

Numbers: :mod:`jansen_env.engine.walk_reward`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from typing_extensions import Unpack

from jansen_env.arrays import Array
from jansen_env.checks import finite_numbers, non_negative, positive, shown, within
from jansen_env.dynamics.joint_forces import JointForces
from jansen_env.engine import walk_reward
from jansen_env.envs.single import SingleEnv
from jansen_env.envs.vector import TaskVectorEnv, VectorArguments
from jansen_env.parameters import plain
from jansen_env.tasks.compiled import CompiledTask
from jansen_env.terrain import Ground
from jansen_env.world.observations import EXACT, Observed
from jansen_env.world.settings import (
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

SPEED_COMMAND = (0.05, 0.8)  # m/s, the default range of commanded speeds
FASTEST_COMMAND = 2.0  # m/s, beyond it no command makes sense for this machine
ACCOUNTS: tuple[str, ...] = walk_reward.ACCOUNTS.names or ()  # lag and means
COMMANDED = ("speed_command", *ACCOUNTS)  # in the order of ``walk_reward.observe_walk``
ODOMETRY = ("lag", "mean_speed")  # of them, those that are observed onboard
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
    fall_pitch: float
    fall_contact: bool
    terminate_when_fallen: bool


@dataclass(frozen=True, kw_only=True)
class WalkerSettings(WorldSettings):
    """Arguments of ``JansenWalker-v0`` and its presets: those of the world, and of its task.

    Commands in m/s, their interval in s, pitch in rad; weights are exponents of the reward.
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
    fall_pitch: float = shared(walk_reward.FALLEN_PITCH, positive)
    fall_contact: bool = shared(True, flag)
    terminate_when_fallen: bool = shared(True, flag)


class WalkerTask(CompiledTask):
    """Walk at a commanded speed, m/s.

    See :class:`jansen_env.tasks.walking.walker_env.JansenWalkerEnv`.
    One kernel rewards, ends and observes a step; a derived task may do more in NumPy.
    """

    SETTINGS = WalkerSettings
    OBSERVED = (
        Observed("speed_command", "m/s", -FASTEST_COMMAND, FASTEST_COMMAND, EXACT),
        # Noisy and onboard sensors measure these:
        Observed("lag", "m", -FURTHEST, FURTHEST, EXACT),
        Observed("mean_speed", "m/s", -np.inf, np.inf, EXACT),
        Observed("mean_slip", "m/s", 0.0, np.inf, EXACT),
        Observed("mean_power", "W", 0.0, np.inf, EXACT),
        Observed("rms_torque", "N m", 0.0, np.inf, EXACT),
    )
    COMPILED = COMMANDED
    ROW = walk_reward.ROW
    SETTABLE = ("speed_command", "command")
    FASTEST = FASTEST_COMMAND

    def __init__(self, settings: WalkerSettings, threads: int | None = None) -> None:
        super().__init__(settings, threads)
        weights = (getattr(settings, f"{factor}_weight") for factor, _ in walk_reward.WEIGHTED)
        fall = settings.fall_pitch, settings.fall_contact, settings.terminate_when_fallen
        self.world.weights[0] = (*weights, *fall)
        intervals = np.array(settings.command_interval, float)  # NaN for None
        steps = np.maximum(1.0, np.rint(intervals / self.control_dt))
        self.data["command_steps"] = np.where(np.isfinite(intervals), steps, 0.0)
        self.data["command_range"] = settings.speed_command

    def _connect(self) -> None:
        super()._connect()
        self.speed_command = self.data["command_range"]
        self._is_measured = bool(self.world.plant.world[["noisy", "onboard"]].item() != (0, 0))

    def _order(self, world: Sequence[Observed]) -> tuple[Observed, ...]:
        """Return all observations in the documented order; a derived task's come last."""
        places = {"speed_command": 1, "toe_load": 2, "last_action": 3, "height_scan": 5}
        places |= dict.fromkeys(ACCOUNTS, 4)
        every = [*world, *self.OBSERVED]
        if self.world.is_onboard:
            every = [e for e in every if e.name in ODOMETRY or e.name not in ACCOUNTS]

        def place(entry: Observed) -> int:
            kind = entry.name.rstrip("_0123456789")  # of numbered toes and heights
            return places.get(kind, 0 if entry in world else 6)

        return tuple(sorted(every, key=place))

    def progress(self, i: int) -> tuple[float, float]:
        """Return how far a robot got towards its commands, m, and their mean size, m/s."""
        walked, commanded = self.data["covered"][i].tolist()
        return walked, commanded / (max(1, int(self.world.elapsed[i])) * self.control_dt)

    def _change(self, i: int, changes: Values) -> Callable[[], None]:
        """Check another range of commands, and a command that holds from the next step on."""
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

    def get_state(self, i: int) -> Values:
        """Return all that a robot's future depends on but its random numbers."""
        state = {**super().get_state(i), "covered": self.data["covered"][i].copy()}
        if self._is_measured:
            measured = self.data["measured"][i].item()
            state["measured"] = dict(zip(ACCOUNTS, measured, strict=True))
        return state

    def set_state(self, i: int, state: Values) -> None:
        """Continue from a complete state of :meth:`get_state`; ValueError: an entry out of range."""
        covered = finite_numbers("state['covered']", state["covered"], 2)
        measured: tuple[float, ...] = ()
        if self._is_measured:
            given, label = state["measured"], "state['measured']"
            if not isinstance(given, Mapping) or not {*ACCOUNTS} <= {*given}:
                raise ValueError(f"{label} is {shown(given)}, must have {[*ACCOUNTS]}")
            measured = tuple(self._checked(label, name, given[name]) for name in ACCOUNTS)
        super().set_state(i, state)
        self.data["next_command"][i] = self.info["speed_command"][i]
        self.data["covered"][i] = covered
        if measured:
            self.data["measured"][i] = measured
            self._describe(np.array([i]))


class JansenWalkerEnv(SingleEnv[WalkerTask]):
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

    A positive action walks towards +x, whatever the robot: it turns the crank of the paper's machine
    counter-clockwise, that of the holy designs clockwise. Its reaction acts on the chassis. Actions
    beyond the limits are clipped.

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
    | 11 + n | lag: how far the target is ahead | -0.5 | 0.5 | m |
    | 12 + n | mean speed | -Inf | Inf | m/s |
    | 13 + n | mean slip speed of all toes together | 0 | Inf | m/s |
    | 14 + n | mean motor power, without its sign | 0 | Inf | W |
    | 15 + n | RMS torque | 0 | Inf | N m |
    | 16 + n .. | with ``height_scan``: height of the crank axis over the ground at each place | -Inf | Inf | m |
    | last | with ``observe_lengths``: each length / the robot's own, less 1 (``docs/worlds.md``) | -Inf | Inf | 1 |

    n is the number of toes (4: rf, lf, rb, lb). At reset the loads are those at rest. The crank's
    angle and speed are counted as the action is: positive speed walks towards +x. (In ``info`` they
    have their physical signs.) Lag, means and RMS torque are what the reward goes by;
    with ``noise`` they are as measured, and mean slip is 0.

    ``height_scan=(behind, ahead, count)`` looks at ``count`` places, evenly from x - behind to
    x + ahead (m; of one, x - behind), x the crank axis', whatever the pitch and the command: for a
    robot that walks towards -x those ahead come first. With ``noise`` all sensors err, as
    :class:`jansen_env.Noise` documents.

    ``observe="onboard"`` shows what a machine's own computer has: crank angle and speed by an
    encoder, pitch and its rate, the velocity in x and the accelerations of the crank axis by an IMU
    and the legs (:mod:`jansen_env.engine.onboard_estimates`), crank torque by the motor's
    current (N m), command, last action, lag and mean speed by odometry; no height, loads or slip.

    ## Rewards
    A target starts where the robot does and moves at the commanded speed; it waits while the robot
    is 0.5 m away from it. Walking at the mean speed asked for, however unevenly, is to stay with it.
    The other costs are rated over a stride too, by exponential means over the time T that a quarter
    turn of the crank takes at the commanded speed: what it advances the robot
    (:func:`jansen_env.robot.kinematics.advance_per_turn`; 0.16 m) / \\|command\\|, 0.2 to 3.4 s; 0 at
    first. The reward is the product of these factors, each from 0 to 1 and in ``info``:

    | Factor | Value |
    |--------|-------|
    | ``reward/tracking`` | 0.3 + 0.7 / (1 + (lag / 0.2 m)^2) |
    | ``reward/progress`` | r = mean speed / command, but 0 below 0, 1 from 1 to 2 (the robot may catch up) and 2 / r above; for the command 0 1 - \\|mean speed\\| / 0.05 m/s, at least 0 |
    | ``reward/slip`` | 1 / (1 + s / 0.2), s the mean slip speed of all toes / v |
    | ``reward/energy`` | 1 / (1 + c / 4), c = mean motor power / (weight v), a cost of transport |
    | ``reward/effort`` | 1 / (1 + (RMS torque / (weight * 0.3 m))^2) |
    | ``reward/smoothness`` | 1 / (1 + (change of the action / 0.8)^2) |
    | ``reward/posture`` | 1 / (1 + (pitch / 0.4 rad)^2) |
    | ``reward/load`` | 1 / (1 + ((ground load - 1) / 0.8)^2), the mean of the square over the windows that end in the step, see Information |

    with v = max(\\|command\\|, 0.05 m/s), and the last six to the powers ``slip_weight`` ...
    ``load_weight``, which are 1 by default; 0 leaves a factor out. Standing still earns nothing at any
    command but 0, and a fall costs what the rest of the episode would have earned.

    ## Starting State
    Crank angle uniform over a turn, placed at rest at x = 0 on the lowest toe before and the
    lowest toe behind its centre of mass; crank speed uniform in +- ``reset_noise_scale`` rad/s;
    command uniform in ``speed_command``, or as given by
    ``reset(options={"speed_command": 0.3, "crank_angle": 0.0})``.

    ``reset(options={"pushes": [(t, Jx, Jy), ...]})`` pushes the chassis at these times of the
    episode, s, with these impulses, N s, and at no others; at most 1000, each as long as ``push``
    has it, without that 0.1 s. Of many robots the option is a list of such lists, one for each,
    None for a robot whose pushes are random. ``push((Jx, Jy))`` is one more, from now on.

    Everything comes from the generator that ``reset(seed=...)`` seeds, in this order: crank angle,
    command, crank speed, ``delay`` if it is a range, a seed for lengths, noise and pushes,
    ``terrain_level`` if it is a range, the parameters that ``randomize`` names (in the order of the
    table in ``docs/worlds.md``), and the terrain.
    ``reset(options={"friction": 0.5, "terrain_level": 3})`` fixes any of the parameters for one
    episode; the others are what they would have been.

    ``reset(options={"robot": ...})`` exchanges the robot for good, with its motor, pads and payload,
    for one of the same linkage with legs on the same sides; of many robots the option is one for all or one for
    each. Nothing is compiled to machine code for it: 3 ms a robot of other lengths.

    ``reset(options={"lengths": {"crank": 0.1, "foot_CE": 0.26}})`` gives the robot other lengths for one
    episode, m, by the names of :func:`jansen_env.robot.lengths.lengths`; masses and inertias follow. The
    next reset without has the robot's own again. Of many robots the option is one for all or a list. With
    ``randomize={"lengths": 0.1}`` each length is multiplied by a factor of its own, uniform in 0.9 to 1.1,
    until the linkage closes off any dead point; an option then fixes those that it names.

    A command may be negative (walk towards -x) or 0 (stand). It stays for the episode, but for
    ``command_interval`` and ``set_parameters(command=...)``.

    ## Episode End
    Terminated when the robot has fallen: \\|pitch\\| > ``fall_pitch``, or, if ``fall_contact``, a
    joint other than a toe (knee, ankle, hip, frame pivot) is pressed on the ground. Of 60 falls the
    paper's robot gets up after 6 on flat and 4 on rough ground, the holy one on rough ground after
    36.

    Truncated after 500 steps (10 s) when made with ``gym.make``, and where the simulation diverges
    (absurd torques, time steps or terrains): that step does nothing, says so in ``info`` and in a
    warning.

    ## Information
    ``x_position`` m, ``x_velocity`` m/s, ``pitch`` rad, ``crank_angle`` rad (not wrapped),
    ``crank_speed`` rad/s, ``crank_torque`` N m, ``speed_command`` m/s, ``lag`` m, ``mean_speed``
    and ``mean_slip`` m/s, ``mean_power`` W, ``rms_torque`` N m (see Rewards), ``slip`` (n,) m slid by each
    toe while loaded in this step, ``contact_force`` (n, 2) mean tangential and normal force on each
    toe in N, ``ground_load`` (the normal forces of all contacts together, mean over 20 ms, divided by
    the weight; the largest of the windows of 20 ms that ended in this step), ``unsupported`` (the share of
    this step's time in which these forces are below a tenth of the weight), ``is_success`` (whether the
    episode is a success so far: no fall, and at least 0.8 of the commanded distance), ``links_in_ground`` (how many sides of links, lines between two joints with pads, pass below a vertex of the ground at the
    end of this step; rods to a crank pin are not looked at), ``fallen`` (since the last reset), and ``energy``, J in this step: ``motor_work``, ``push_work``,
    ``correction_work`` (what taking sunken pads out of the ground adds), ``joint_loss``, ``slip_loss``, ``impact_loss``,
    ``mechanical_energy_change``, ``residual``; the first three are the sum of the others, and no loss is negative (``docs/theory.md``, Energy);
    ``electrical_work`` is what the motor drew; ``joint_gap`` m, the widest gap of any joint in this step (0 on the projection
    plant). With ``track_joint_forces``: ``joint_force_max`` N, the largest force with which a
    link bears on any of its joints in this step, but for the time steps in which a toe lands, and
    ``joint_impulse_max`` N s, the largest impulse in those (0 if there were none). ``joint_forces()`` has all of them.
    ``diverged``: whether this step was refused, see Episode End. At a reset the terms of the reward and
    the loads of joints are 0, and ``energy`` is that of a look one time step ahead. With ``noise``:
    ``true_observation``, as it would be without. Where terrain or parameters are drawn:
    ``parameters``, the numbers of the episode by name (``env.unwrapped.parameters``: as a vector).

    ## Arguments
    | Argument | Default | Meaning |
    |----------|---------|---------|
    | ``robot`` | ``"paper"`` | a :class:`jansen_env.Robot`, or the name of a built-in design; of many robots also a list |
    | ``terrain`` | ``"flat"`` | a :class:`jansen_env.Terrain`, ``"flat"``, ``"slope:ANGLE"`` (rad), (x, y) points, or a ``pymunk.Space`` or list of static shapes; or what draws a new one at each reset, ``"rough"``, ``"stairs"``, ``"mixed"`` ... or a callable (``docs/terrain.md``) |
    | ``terrain_level`` | 0 | of a terrain that is drawn, 0 to 9, or (low, high), drawn at each reset |
    | ``curriculum`` | None | a :class:`jansen_env.Curriculum` that sets the level, True for the default one |
    | ``randomize`` | None | what is drawn at each reset, by name: ranges or distributions (``docs/worlds.md``) |
    | ``friction`` | terrain's (0.8) | Coulomb coefficient |
    | ``restitution`` | terrain's (0) | Newton's coefficient, 0 to 1 |
    | ``speed_command`` | (0.05, 0.8) | m/s, a number or a range |
    | ``command_interval`` | None | s, after which another command is drawn from ``speed_command``; None for never |
    | ``payload`` | robot's (none) | a :class:`jansen_env.Payload`, or a mass in kg at the crank axis |
    | ``motor`` | robot's (ideal) | a :class:`jansen_env.Motor`, or the name of one |
    | ``torque_limit`` | motor's (20) | N m, in place of the motor's own |
    | ``pad_compliance`` | robot's (rigid) | a :class:`jansen_env.Compliance`: how the feet give |
    | ``delay`` | 0 | s by which torques come late, at most 1; or a range, drawn at each reset |
    | ``control_dt`` | 0.02 | s for which an action is held; a multiple of ``time_step``, at most 10,000 times as long |
    | ``time_step`` | the plant's | s, of the integration, 1e-9 to 1: 0.001, ``"rigid_body"`` 0.00025; short enough for compliant feet |
    | ``plant`` | ``"projection"`` | what moves the robot, see Plants |
    | ``links_collide`` | False | whether sides of links touch vertices of the ground, see Plants |
    | ``slip_weight``, ``energy_weight``, ``effort_weight``, ``smoothness_weight``, ``posture_weight``, ``load_weight`` | 1 | see Rewards |
    | ``reset_noise_scale`` | 0.1 | rad/s, of the starting crank speed |
    | ``fall_pitch`` | 1.2 | rad, beyond which the robot has fallen |
    | ``fall_contact`` | True | whether a joint on the ground is a fall |
    | ``terminate_when_fallen`` | True | whether a fall ends the episode |
    | ``track_joint_forces`` | False | adds them to ``info``; a step then takes some 10 ms more |
    | ``torque_rate`` | None | N m/s at most by which the torque asked for changes: at an action that is 1 off, else in proportion |
    | ``observe`` | ``"all"`` | or ``"onboard"``, see Observation Space |
    | ``height_scan`` | None | (behind, ahead, count), m: places at which the ground is looked at |
    | ``noise`` | None | a :class:`jansen_env.Noise` of the sensors, or a dictionary of its arguments |
    | ``observe_lengths`` | False | whether observations end with the lengths of the episode |
    | ``push`` | None | a :class:`jansen_env.Push`: random pushes on the chassis; or a dictionary of its arguments |
    | ``render_mode`` | None | ``"human"`` or ``"rgb_array"`` |

    ## Plants
    The same task runs on two plants that share the robot's data, the ground, the contact laws and the
    motor, but not equations and solvers. ``"projection"`` integrates the paper's projected equations
    with exact contacts, fast enough to train on. ``"rigid_body"`` is built of pymunk's bodies, joints
    and contacts, some hundred times slower; its joints gap a little (``info["joint_gap"]``). A policy
    that walks on both does not exploit numerical error.

    With ``links_collide=True`` sides of links touch vertices of the ground by the pads' law, as capsules
    of the pads' radius, if the vertices are those of ridges. Their touch is no fall. Robots are placed
    so that no side is in the ground. Rods that end at the crank's pin, and the crank, pass through.

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
        """Weight of robot and payload, N."""
        return float(self.task.world.weight[0])

    @property
    def parameters(self) -> Array:
        """(18,) the numbers of this episode in the order of
        :data:`jansen_env.parameters.PARAMETERS`, which has their names and units."""
        return plain(self.task.world.records.parameters)[0].copy()

    def joint_forces(self) -> JointForces:
        """Return the forces in every joint now, under the last action's torque and the push.

        Means over the next time step, with the impulse / time step of a toe that touches down.

        Raises:
            ValueError: the plant is another than ``"projection"``.
            gymnasium.error.ResetNeeded: before the first :meth:`reset`.
        """
        self._check_begun()
        return self.task.world.joint_forces()


class WalkerVectorArguments(VectorArguments, WalkerArguments, total=False):
    """Arguments of :class:`JansenWalkerVectorEnv`."""


class JansenWalkerVectorEnv(TaskVectorEnv[WalkerTask]):
    """:class:`JansenWalkerEnv` for many robots at once: what ``gym.make_vec`` makes."""

    SINGLE = JansenWalkerEnv

    def __init__(self, num_envs: int = 1, **arguments: Unpack[WalkerVectorArguments]) -> None:
        super().__init__(num_envs, **arguments)
