"""Robots of the walking task one by one: changed, asked, saved, and drawn."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jansen_env.checks import entries, finite, non_negative, shown, whole_number, within
from jansen_env.dynamics.pads import pad_layout
from jansen_env.engine import task
from jansen_env.envs import arguments
from jansen_env.envs.core import Ints, Task
from jansen_env.envs.disturbances import NoisySensors, Pushes
from jansen_env.plants.base import BatchedPlant, check_deflection, check_in_contact, check_state
from jansen_env.push import check_schedule
from jansen_env.rendering import Frame
from jansen_env.terrain import Terrain
from jansen_env.world.episode_parameters import EpisodeParameters, Plan
from jansen_env.world.parameters import CHANGES, PARAMETERS, check

Array = NDArray[np.float64]

FASTEST_COMMAND = 2.0  # m/s, beyond it no command makes sense for this machine
ACCOUNTS: tuple[str, ...] = task.ACCOUNTS.names or ()  # lag and means
NOT_PHYSICAL = {"speed_command", "command", "delay", "terrain_level"}  # of what may be set
MOST_STEPS = 2**63 - 1  # of an episode; and the largest seed of commands
SLIPPING = 0.01  # m/s of mean slip speed from which a toe is drawn as slipping


class WalkerRobots(Task):
    """What can be asked of single robots, and done with them.

    Attributes:
        batch: what moves the robots. episodes: their numbers and grounds.
        speed_command: (n, 2) m/s, range of the next commands. reset_noise_scale: (n,) rad/s.
        loads: (n, toes) normal forces / weight. elapsed: (n,) control steps since the reset.
        covered: (n, 2) m since then, walked towards the commands and commanded; with a curriculum.
    """

    batch: BatchedPlant
    episodes: EpisodeParameters
    speed_command: Array
    reset_noise_scale: Array
    loads: Array
    elapsed: Ints
    covered: Array
    _seed: Ints
    _pushes: Pushes
    _sensors: NoisySensors | None

    @property
    def terrains(self) -> list[Terrain]:
        """Of each robot, in this episode."""
        return self.batch.terrains

    @property
    def weight(self) -> Array:
        """(n,) N."""
        weight: Array = self.rows["weight"]
        return weight

    @abstractmethod
    def _put_in_force(self, rows: Ints, plans: Sequence[Plan]) -> None:
        """Let robots be what is planned for their episodes."""

    @abstractmethod
    def _rate(self, rows: Ints) -> None:
        """Know the weights of robots as they are, and the torque of an action of 1."""

    @abstractmethod
    def _begin(self, rows: Ints, commands: Array, actions: float | Array = 0.0) -> None:
        """Begin robots' episodes: nothing but what a robot is remains of the one before."""

    def set_parameters(self, row: int, **changes: Any) -> None:
        """Change a robot from now on.

        Args:
            friction, restitution: between its toes and its ground.
            payload: a :class:`jansen_env.robot.Payload`, or a mass in kg at the crank axis.
            motor: a :class:`jansen_env.motor.Motor`, or the name of one, whose torque limit then
                holds. pad_compliance: a :class:`jansen_env.robot.Compliance`.
            delay: s, a number or a range, of its next episodes, no longer than was given to the
                constructor for any robot.
            speed_command: m/s, a number or a range, from which commands are drawn from now on.
            tilt, motor_strength, mass_scale ...: any of :data:`CHANGES` that does something here.
            command: m/s, from the next step on. terrain_level: of its next episodes; that from
                which a curriculum goes on. What ``randomize`` names is drawn all the same.

        Energies in ``info`` are of what happens in steps: what a change between two of them adds to
        the robot's energy, that of a payload for one, is in neither of them.

        Raises:
            ValueError: a value out of range, or anything but commands and delay on the plant
                ``"rigid_body"``.
            TypeError: another name.
        """
        arguments.known_parameters(changes, self.SETTABLE)
        physical = sorted({*changes} - NOT_PHYSICAL)
        if not {*physical} <= self.batch.changeable:
            raise ValueError(f"{physical[0]} cannot be changed with plant='rigid_body'")
        checked = self._checked(row, changes)  # all or nothing
        if "speed_command" in checked:
            self.speed_command[row] = checked.pop("speed_command")
        if "delay" in checked:
            self.delay_range[row] = checked.pop("delay")
        if "terrain_level" in checked:
            self.episodes.level[row] = self.episodes.levels[row] = checked.pop("terrain_level")
        if "command" in checked:
            kept = self.rows[row]
            kept["info"]["speed_command"] = kept["next_command"] = checked.pop("command")
            self._describe(np.array([row]))
        if physical:
            self._change(row, checked)

    def _checked(self, row: int, changes: Mapping[str, Any]) -> dict[str, Any]:
        """The changes of :meth:`set_parameters`. Raises ValueError: one is out of range."""
        checks: dict[str, Callable[[Any], Any]] = {
            "friction": lambda value: non_negative("friction", value),
            "restitution": lambda value: within("restitution", value, 0.0, 1.0),
            "payload": arguments.load_payload,
            "motor": arguments.load_motor,
            "pad_compliance": arguments.load_compliance,
            "delay": self._checked_delay_range,
            "speed_command": lambda value: arguments.number_range(
                "speed_command", value, -FASTEST_COMMAND, FASTEST_COMMAND
            ),
            "command": lambda value: within("command", value, -FASTEST_COMMAND, FASTEST_COMMAND),
            "terrain_level": lambda value: self.episodes.checked_level(row, value),
        }
        checks |= {name: partial(check, name, name) for name in CHANGES}
        checked = {name: checks[name](value) for name, value in changes.items()}
        self.episodes.check_names(row, [name for name in checked if name in CHANGES], "changes")
        if {*checked} & self.batch.changeable:
            numbers = self.batch.parameters, self.episodes.nominal
            self.episodes.check_pads(
                row,
                checked.get("pad_compliance", self.robots[row].pad_compliance),
                checked.get("restitution", max(float(of["restitution"][row]) for of in numbers)),
            )
            self.episodes.check_change(row, checked)
        return checked

    def _change(self, row: int, checked: Mapping[str, Any]) -> None:
        """Put changes of a robot and its ground in force."""
        batch = self.batch
        batch.change(row, dict(checked))
        self.robots[row] = batch.robots[row]
        load = batch.robots[row].payload
        place = {"payload_x": load.position[0], "payload_y": load.position[1]}
        for name, value in checked.items():
            numbers = {"payload": load.mass, **place} if name == "payload" else {name: value}
            self.episodes.take(row, numbers if name in PARAMETERS else {})
        self._rate(np.array([row]))

    def push(self, row: int, impulse: Any) -> None:
        """Push a robot's chassis from now on, whatever other pushes there are.

        Args:
            impulse: (2,) N s in x and y; as long as ``push`` has it, without that 0.1 s.

        Raises:
            ValueError: no two finite numbers, or too many pushes at once.
        """
        now = float(self.elapsed[row]) * self.control_dt
        own = check_schedule("impulse", [(now, *entries("impulse", impulse, "(Jx, Jy)"))])
        self._pushes.add(row, own[0])

    def of_each(self, name: str) -> list[Any] | None:
        """``friction``, ``restitution``, ``payload``, ``motor``, ``torque_limit``,
        ``pad_compliance``, ``delay`` (s, of this episode), ``robot``, ``terrain``,
        ``terrain_level``, ``state``, ``weight``, ``speed_command``, ``command``,
        ``reset_noise_scale`` and :data:`CHANGES` of each robot; None for another name.
        """
        batch = self.batch
        if name == "robot":
            return list(self.robots)
        if name == "terrain":
            return list(self.batch.terrains)
        if name == "terrain_level":
            return list(self.episodes.values["terrain_level"].astype(int).tolist())
        if name in ("payload", "motor", "pad_compliance"):
            return [getattr(robot, name) for robot in self.robots]
        if name == "torque_limit":
            return [robot.motor.torque_limit for robot in self.robots]
        if name == "delay":
            return [self._delay_state(row)["delay"] for row in range(self.num_envs)]
        if name == "speed_command":
            return [(low, high) for low, high in self.speed_command.tolist()]
        if name == "command":
            return list(self.rows["info"]["speed_command"].tolist())
        if name in ("weight", "reset_noise_scale"):
            return list(getattr(self, name).tolist())
        if name == "state":
            return list(batch.states.copy())
        if name in ("friction", "restitution", *CHANGES):
            return list(self.episodes.values[name].tolist())
        return None

    def get_state(self, row: int) -> dict[str, Any]:
        """All that a robot's future depends on but its random numbers, see :class:`jansen_env.envs.core.Task`."""
        kept = self.rows[row]
        in_contact = self.batch.in_contact
        return {
            "plant": self.batch.states[row].copy(),
            "in_contact": None if row > 0 or in_contact is None else in_contact.copy(),
            "deflection": self.batch.deflection[row].copy(),
            **self._delay_state(row),
            "command": float(kept["info"]["speed_command"]),
            "action": float(kept["action"]),
            "fallen": bool(kept["info"]["fallen"]),
            **{name: float(kept["info"][name]) for name in ACCOUNTS},
            **self._measured(row),
            "steps": int(self.elapsed[row]),
            "command_seed": int(self._seed[row]),
            "loads": self.loads[row].copy(),
            "covered": self.covered[row].copy(),
            **self.episodes.state(row),
            "pushes": self._pushes.scheduled(row),
            "random_pushes": bool(self._pushes.random[row]),
        }

    def _measured(self, row: int) -> dict[str, Any]:
        """Return the lag and means that noisy sensors measured, for :meth:`get_state`; {} without noise."""
        if self._sensors is None:
            return {}
        return {"measured": dict(zip(ACCOUNTS, self._sensors.measured[row].item(), strict=True))}

    def set_state(self, row: int, state: Mapping[str, Any]) -> None:
        """Go on from a state of :meth:`get_state`, see :class:`jansen_env.envs.core.Task`."""
        arguments.complete_state(state, self.get_state(row))
        # All is checked before anything changes.
        pose, loads = check_state(state["plant"]), np.array(state["loads"], dtype=float)
        if loads.shape != self.loads[row].shape or not np.isfinite(loads).all():
            raise ValueError(
                f"state['loads'] is {loads}, must be {len(self.loads[row])} finite numbers"
            )
        covered = np.array([finite("state['covered']", one) for one in state["covered"]])
        in_contact = check_in_contact(state["in_contact"], len(pad_layout(self.robots[0]).leg))
        deflection = check_deflection(state["deflection"], len(self.batch.deflection[row]))
        delay, asked = self._checked_delay(state)
        command = within("state['command']", state["command"], -FASTEST_COMMAND, FASTEST_COMMAND)
        action = within("state['action']", state["action"], -1.0, 1.0)
        steps = whole_number("state['steps']", state["steps"], MOST_STEPS)
        seed = whole_number("state['command_seed']", state["command_seed"], MOST_STEPS)
        accounts = _checked_accounts("state", state)
        sensors = self._sensors
        measured = sensors and _checked_accounts("state['measured']", state["measured"])
        fallen, random_pushes = bool(state["fallen"]), bool(state["random_pushes"])
        pushes = check_schedule("state['pushes']", state["pushes"])
        plan, level = self.episodes.planned(row, state)
        batch, one = self.batch, np.array([row])
        self._put_in_force(one, [plan])
        self.episodes.level[row] = level
        batch.set_state(row, pose, deflection)
        if row == 0:
            batch.in_contact = in_contact
        self._begin_delay(one, np.array([delay]), asked)
        batch.slip[row] = batch.contact_force[row] = 0.0
        self.loads[row] = loads
        self._begin(one, np.array([command]), action)
        self.elapsed[row], self._seed[row], self.covered[row] = steps, seed, covered
        self._pushes.schedule(row, pushes, random_pushes)
        info = self.rows[row]["info"]
        info["fallen"] = fallen
        for name, value in zip(ACCOUNTS, accounts, strict=True):
            info[name] = value
        if sensors is not None:
            sensors.measured[row] = measured
        self._describe(one)

    def scene(self, row: int) -> dict[str, Any]:
        """Arguments of the renderer."""
        return {
            "robot": self.episodes.shown_robot(row, self.robots[row]),
            "terrain_points": self.batch.terrains[row].polyline,
        }

    def frame(self, row: int) -> Frame:
        """What is to be drawn of a robot as it stands."""
        batch = self.batch
        state = batch.states[row]
        points, tangents = batch.contact_frames(row)
        return Frame(
            q=state[:4],
            contact_point=points,
            contact_tangent=tangents,
            contact_force=batch.contact_force[row],
            slipping=batch.slip[row] > SLIPPING * self.control_dt,
            command=float(self.rows[row]["info"]["speed_command"]),
            speed=float(state[4]),
            torque=float(self.torque[row]),
            torque_limit=abs(float(self.full_torque[row])),
            time=float(self.elapsed[row]) * self.control_dt,
        )


def _checked_accounts(label: str, given: Any) -> tuple[float, ...]:
    """Lag and means in the order of ``task.ACCOUNTS``.

    Raises:
        ValueError: one is missing or out of range.
    """
    if not isinstance(given, Mapping) or not {*ACCOUNTS} <= {*given}:
        raise ValueError(f"{label} is {shown(given)}, must have {[*ACCOUNTS]}")
    furthest = task.FURTHEST_TARGET
    checks: dict[str, Callable[[str, Any], float]] = {
        "lag": partial(within, low=-furthest, high=furthest), "mean_speed": finite,
    }  # fmt: skip
    return tuple(
        checks.get(name, non_negative)(f"{label}[{name!r}]", given[name]) for name in ACCOUNTS
    )


def schedule_of(options: Mapping[str, Any]) -> tuple[Array, bool]:
    """The pushes (k, 3) in options of a reset, and whether there are random ones too."""
    pushes = options.get("pushes")
    return check_schedule("options['pushes']", [] if pushes is None else pushes), pushes is None
