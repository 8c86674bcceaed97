"""Tasks of one's own: derived from a shipped one, or in plain NumPy; nothing is copied or moved."""

from dataclasses import dataclass

import gymnasium as gym
import numpy as np
import pytest

from jansen_env.envs.single import SingleEnv
from jansen_env.envs.vector import TaskVectorEnv
from jansen_env.tasks.task import CommandedTask
from jansen_env.tasks.walking.walker_env import WalkerSettings, WalkerTask
from jansen_env.world.observations import Observed
from jansen_env.world.settings import WorldSettings, range_each

WORLD = {"robot": "built", "height_scan": (0.2, 0.5, 3), "delay": 0.01, "friction": 0.7}


def environments(task, preset=None):
    """Environments of one robot and of many."""
    single = type("TaskEnv", (SingleEnv,), {"TASK": task, "PRESET": preset or {}})
    return single, type("TaskVector", (TaskVectorEnv,), {"SINGLE": single})


@dataclass(frozen=True, kw_only=True)
class DerivedSettings(WalkerSettings):
    torque_bonus: float = 0.5


class Derived(WalkerTask):
    SETTINGS = DerivedSettings
    OBSERVED = (*WalkerTask.OBSERVED, Observed("crank_torque", "N m", -np.inf, np.inf, "exact"))

    def __init__(self, settings, threads=None):
        self.bonus = settings.torque_bonus
        super().__init__(settings, threads)

    def observe(self):
        return {**super().observe(), "crank_torque": self.world.crank_torque}


class Halved(WalkerTask):
    def reward(self):
        return 0.5 * super().reward()


@dataclass(frozen=True, kw_only=True)
class SlowSettings(WorldSettings):
    speed_command: tuple[float, float] = range_each((0.1, 0.3), -1.0, 1.0)


class Slow(CommandedTask):
    """In plain NumPy, with a command: not to be faster than that."""

    SETTINGS = SlowSettings
    OBSERVED = (Observed("speed_command", "m/s", -1.0, 1.0, "exact"),)
    TERMS = ("slow",)
    FASTEST = 1.0

    def observe(self):
        return {"speed_command": self.info["speed_command"]}

    def reward(self):
        slow = 1.0 * (np.abs(self.world.x_velocity) <= self.info["speed_command"])
        self.keep(slow=slow)
        return slow

    def terminated(self):
        return np.abs(self.world.pitch) > 1.2


PRESET = {"speed_command": 0.2}
DerivedEnv, DerivedVectorEnv = environments(Derived, PRESET)
PlainEnv, _ = environments(WalkerTask, PRESET)
HalvedEnv, _ = environments(Halved)
SlowEnv, SlowVectorEnv = environments(Slow)


def test_arguments_are_those_of_the_world_and_its_own():
    known = DerivedEnv.defaults()
    assert known["torque_bonus"] == 0.5
    assert DerivedEnv().task.speed_command.tolist() == [[0.2, 0.2]]
    assert {*known} == {*PlainEnv.defaults(), "torque_bonus"}
    assert DerivedEnv(torque_bonus=2.0).task.bonus == 2.0
    with pytest.raises(TypeError, match="unexpected keyword argument 'tork_bonus'"):
        DerivedEnv(tork_bonus=2.0)


@pytest.mark.parametrize("noise", [None, {}])
def test_what_is_added_moves_nothing(noise):
    """All other columns, by name, rewards and information are those without it, bit for bit."""
    env, plain = (kind(**WORLD, noise=noise) for kind in (DerivedEnv, PlainEnv))
    many = DerivedVectorEnv(2, **WORLD, noise=noise)
    seen = env.reset(seed=4)[0]
    before = plain.reset(seed=4)[0]
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


TORQUE = Observed("crank_torque", "N m", -np.inf, np.inf, "exact")


def test_an_observation_may_be_added_to_the_walker_itself(monkeypatch):
    """It is added in the class, as CONTRIBUTING.md says, and is seen in each step of one robot and
    of many.
    """
    monkeypatch.setattr(WalkerTask, "OBSERVED", (*WalkerTask.OBSERVED, TORQUE))
    before = WalkerTask.observe
    monkeypatch.setattr(
        WalkerTask,
        "observe",
        lambda self: {**before(self), "crank_torque": self.world.crank_torque},
    )
    env = gym.make("JansenWalker-v0")
    many = gym.make_vec("JansenWalker-v0", 2)
    column = env.unwrapped.task.columns["crank_torque"]
    env.reset(seed=4), many.reset(seed=[3, 4])
    for _ in range(5):
        seen, *_, info = env.step(np.full(1, 0.3, np.float32))
        assert seen[column] == np.float32(info["crank_torque"]) != 0.0
        assert (many.step(np.full((2, 1), 0.3, np.float32))[0][1] == seen).all()


@pytest.mark.parametrize("base", [Slow, WalkerTask, Halved])
def test_an_observation_that_nobody_fills_is_refused_at_construction(base, monkeypatch):
    if base is Slow:
        monkeypatch.delattr(Slow, "observe")
    task = declared(base, OBSERVED=(*base.OBSERVED, TORQUE))
    message = r"observe\(\) of Declared must return \[.*'crank_torque'.*\]"
    with pytest.raises(ValueError, match=message):
        task()


def test_a_commanded_task_in_numpy_is_scored_and_observed():
    world = {"robot": "built", "noise": {}}
    env = SlowEnv(**world)
    many = SlowVectorEnv(2, **world)
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
    env = HalvedEnv(robot="built")
    plain = gym.make("JansenWalkerBuilt-v0").unwrapped
    rewards = []
    for single in (env, plain):
        single.reset(seed=4)
        rewards.append([single.step(np.ones(1, np.float32))[1] for _ in range(10)])
    assert rewards[1] == [2.0 * reward for reward in rewards[0]] and min(rewards[0]) > 0.0


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (("torque", "N m", -1.0, 1.0, "giro"), "noise .* 'torque' must be .*'gyro'.*got 'giro'"),
        (("torque", "N m", -1.0, 1.0, -0.1), "noise .* 'torque' must be 0 or above, got -0.1"),
        (("torque", "N m", -1.0, 1.0, None), "noise .* 'torque' must be.*got None"),
        (("torque", "", -1.0, 1.0, "exact"), "unit of an observation must be .*, got ''"),
        (
            ("torque", "N m", 1.0, 1.0, "exact"),
            "limits of the observation 'torque' must increase, got 1.0 to 1.0",
        ),
    ],
)
def test_an_observation_without_noise_limits_or_unit_is_refused(wrong, message):
    with pytest.raises(ValueError, match=message):
        Observed(*wrong)
    with pytest.raises(TypeError, match="missing"):
        Observed(*wrong[:4])


def test_an_observation_has_its_own_noise():
    class Noisy(Slow):
        OBSERVED = (Observed("speed_command", "m/s", -1.0, 1.0, 0.1),)

    env = environments(Noisy)[0](noise={}, speed_command=0.5)
    env.reset(seed=0)
    seen = [env.step(np.zeros(1, np.float32))[0][-1] for _ in range(200)]
    assert np.mean(seen) == pytest.approx(0.5, abs=0.03)
    assert np.std(seen) == pytest.approx(0.1, rel=0.2)


def test_a_task_that_observes_something_else_is_refused():
    class Forgetful(Slow):
        def observe(self):
            return {}

    with pytest.raises(ValueError, match=r"must return \['speed_command"):
        environments(Forgetful)[0]().reset(seed=0)


def declared(base=Slow, **names):
    """A task of that base with other class attributes."""
    return environments(type("Declared", (base,), {**names, "SETTINGS": WalkerSettings}))[0]


@pytest.mark.parametrize(
    ("base", "names", "message"),
    [
        (
            Slow,
            {"INFO": {**Slow.INFO, "pitch": float}},
            r"INFO must not have names of the world's .*, got \['pitch'\]",
        ),
        (
            Slow,
            {"INFO": {**Slow.INFO, "slip": float}},
            r"INFO must not have names of the world's .*, got \['slip'\]",
        ),
        (
            Slow,
            {"INFO": {**Slow.INFO, "energy": float}},
            r"INFO must not have names of the world's .*, got \['energy'\]",
        ),
        (
            Slow,
            {"INFO": {**Slow.INFO, "slow": float}},
            r"INFO and TERMS must have different names, got \['slow'\]",
        ),
        (
            WalkerTask,
            {"INFO": {"hops": float}},
            "a name in INFO and TERMS must be one of .*, got 'hops'",
        ),
        (
            WalkerTask,
            {"TERMS": ("grace",)},
            "a name in INFO and TERMS must be one of .*, got 'grace'",
        ),
        (
            WalkerTask,
            {"COMPILED": (*WalkerTask.COMPILED, "hops")},
            r"COMPILED must be .*; observe\(\) returns the others, got .*'hops'",
        ),
    ],
)
def test_names_that_information_would_mix_up_or_ignore_are_refused(base, names, message):
    with pytest.raises(ValueError, match=message):
        declared(base, **names)()


@pytest.mark.parametrize("base", [Slow, WalkerTask])
def test_a_settable_name_that_no_change_applies_is_refused(base):
    env = declared(base, SETTABLE=(*base.SETTABLE, "gain"))()
    env.reset(seed=0)
    with pytest.raises(NotImplementedError, match=r"Declared._change\(\) must apply \['gain'\]"):
        env.set_parameters(gain=3.0, speed_command=0.1)
    assert env.task.speed_command.tolist() != [[0.1, 0.1]]


def test_a_curriculum_needs_a_task_that_tells_progress():
    with pytest.raises(ValueError, match="curriculum must be None for a task that defines"):
        gym.make("JansenGoal-v0", terrain="mixed", curriculum=True)


def test_numbers_of_a_task_are_saved():
    env, other = SlowEnv(), SlowEnv()
    env.reset(seed=3)
    state = env.get_state()
    assert other.set_state(state)[-1] == np.float32(
        state["record"]["task"]["info"]["speed_command"]
    )
    with pytest.raises(
        ValueError, match=r"\['info'\]\['speed_command'\] must be between -1\.0 and.*, got 7\.0"
    ):
        state["record"]["task"]["info"]["speed_command"] = 7.0
        env.set_state(state)
