"""A task that derives from another one: nothing is copied, nothing moves."""

import inspect
from dataclasses import dataclass
from typing import Annotated, TypedDict

import gymnasium as gym
import numpy as np
import pytest

from jansen_env.envs.single import SingleEnv
from jansen_env.envs.vector import TaskVectorEnv
from jansen_env.tasks.task import CommandedTask
from jansen_env.tasks.walking import WalkerTask
from jansen_env.world.argument_checks import PerRobot, Range, range_per_robot
from jansen_env.world.entries import Observed

WORLD = {"robot": "built", "height_scan": (0.2, 0.5, 3), "delay": 0.01, "friction": 0.7}


@dataclass(frozen=True)
class Bonus:
    torque_bonus: float = 0.5


class Derived(WalkerTask):
    RECORDS = {**WalkerTask.RECORDS, "bonus": Bonus}  # noqa: RUF012
    DEFAULTS = {"speed_command": 0.2}  # noqa: RUF012

    def take(self, records):
        super().take(records)
        self.bonus = records["bonus"].torque_bonus

    @property
    def own_entries(self):
        return [*super().own_entries, Observed("crank_torque", "N m", -np.inf, np.inf, "exact")]

    def observe(self, rows):
        torque = self.world.rows["info"]["crank_torque"][rows]
        self.observation[rows, self.columns["crank_torque"]] = torque


class Plain(WalkerTask):
    DEFAULTS = Derived.DEFAULTS


class Halved(WalkerTask):
    def score(self, rows):
        self.reward[rows] *= 0.5


class Commands(TypedDict, total=False):
    speed_command: Annotated[PerRobot[Range], range_per_robot((0.1, 0.3), -1.0, 1.0)]


class Slow(CommandedTask):
    """In plain NumPy, with a command: not to be faster than that."""

    RECORDS = {"commands": Commands}  # noqa: RUF012
    ROW = np.dtype([("info", [("speed_command", "f8")]), ("reward", [("slow", "f8")])])
    FASTEST = 1.0

    def take(self, records):
        self.speed_command = records["commands"].speed_command

    @property
    def own_entries(self):
        return [Observed("speed_command", "m/s", -1.0, 1.0, "exact")]

    def observe(self, rows):
        self.observation[rows, self.columns["speed_command"]] = self.commands[rows]

    def score(self, rows):
        speed = np.abs(self.world.rows["info"]["x_velocity"][rows])
        self.reward[rows] = self.rows["reward"]["slow"][rows] = speed <= self.commands[rows]

    @property
    def commands(self):
        return self.rows["info"]["speed_command"]


class SlowEnv(SingleEnv[Slow]):
    TASK = Slow


class HalvedEnv(SingleEnv[Halved]):
    TASK = Halved


class DerivedEnv(SingleEnv[Derived]):
    TASK = Derived


class DerivedVectorEnv(TaskVectorEnv[Derived]):
    TASK = Derived


class PlainEnv(SingleEnv[Plain]):
    TASK = Plain


def test_arguments_are_those_of_the_world_and_its_own():
    known = inspect.signature(DerivedEnv).parameters
    assert known["torque_bonus"].default == 0.5 and known["speed_command"].default == 0.2
    assert {*known} == {*inspect.signature(PlainEnv).parameters, "torque_bonus"}
    assert DerivedEnv(torque_bonus=2.0).task.bonus == 2.0
    with pytest.raises(TypeError, match="unexpected keyword argument 'tork_bonus'"):
        DerivedEnv(tork_bonus=2.0)


@pytest.mark.parametrize("noise", [None, {}])
def test_what_is_added_moves_nothing(noise):
    """All other columns, by name, and rewards and information are those without it, bit for bit."""
    env, plain = (kind(**WORLD, noise=noise) for kind in (DerivedEnv, PlainEnv))
    many = DerivedVectorEnv(2, **WORLD, noise=noise)
    seen, before = env.reset(seed=4)[0], plain.reset(seed=4)[0]
    together = many.reset(seed=[4, 5])[0]
    rng = np.random.default_rng(1)
    for _ in range(30):
        assert (together[0] == seen).all()
        for place, entry in enumerate(plain.observed):
            if noise is None or entry.name not in ("lag", "mean_speed", "mean_power"):
                assert seen[env.task.columns[entry.name]] == before[place], entry.name
        action = rng.uniform(-0.2, 0.8, (2, 1)).astype(np.float32)
        seen, reward, _, _, info = env.step(action[0])
        before, expected, _, _, other = plain.step(action[0])
        together = many.step(action)[0]
        assert reward == expected and {*info} == {*other} and info["energy"] == other["energy"]
        assert seen[-1] == np.float32(info["crank_torque"])
    state = env.get_state()
    assert (env.set_state(state)[: len(seen) - 1] == seen[:-1]).all()


def test_a_commanded_task_in_numpy_is_scored_and_observed():
    world = {"robot": "built", "noise": {}}
    env, many = SlowEnv(**world), TaskVectorEnv.of(SlowEnv)(2, **world)
    seen, _ = env.reset(seed=4)
    many.reset(seed=[3, 4])
    rewards = []
    for _ in range(40):
        action = np.ones((2, 1), np.float32)
        seen, reward, _, _, info = env.step(action[0])
        together, others, *_ = many.step(action)
        assert (together[1] == seen).all() and others[1] == reward == info["reward/slow"]
        assert seen[-1] == np.float32(info["speed_command"]) > 0.0
        rewards.append(reward)
    assert {*rewards} == {0.0, 1.0}


def test_a_task_derived_from_the_walkers_may_change_its_reward():
    env, plain = HalvedEnv(robot="built"), gym.make("JansenWalkerBuilt-v0").unwrapped
    rewards = []
    for one in (env, plain):
        one.reset(seed=4)
        rewards.append([one.step(np.ones(1, np.float32))[1] for _ in range(10)])
    assert rewards[1] == [2.0 * reward for reward in rewards[0]] and min(rewards[0]) > 0.0


@pytest.mark.parametrize(("sensor", "said"), [("", "''"), ("giro", "'giro'")])
def test_an_observation_without_a_sensor_is_refused_with_noise(sensor, said, monkeypatch):
    added = Observed("crank_torque", "N m", -np.inf, np.inf, sensor)
    monkeypatch.setattr(
        Derived, "own_entries", property(lambda self: [*Plain.own_entries.fget(self), added])
    )
    DerivedEnv()
    with pytest.raises(
        ValueError,
        match=r"^noise is given, must be None: sensor of the observation 'crank_torque' is "
        rf"{said}, must be in .*'gyro'.*'exact'",
    ):
        DerivedEnv(noise={})
