"""What differs from episode to episode: drawn, put in force, reported, fixed by options."""

import gc
import pickle
import weakref

import gymnasium as gym
import numpy as np
import pymunk
import pytest
from gymnasium.utils import seeding
from side_by_side import WORLD

from jansen_env import Compliance, Terrain
from jansen_env.plants.parameters import PARAMETERS
from jansen_env.terrain.generators import HIGHEST, Curriculum
from jansen_env.uniform import draw_seed


def make(**more):
    return gym.make("JansenWalker-v0", **{**WORLD, **more})


def walk(env, seed, steps=40, **options):
    """Observations, rewards and parameters of an episode."""
    obs, info = env.reset(seed=seed, options=options)
    seen = [obs]
    rng = np.random.default_rng(0)
    for _ in range(steps):
        obs, reward, *_ = env.step(rng.uniform(-0.2, 0.6, 1).astype(np.float32))
        seen.append(np.append(obs, reward))
    return np.concatenate(seen), info


def test_each_is_drawn_from_its_range():
    """The mean of many samples is within three standard errors of the middle."""
    env = gym.make_vec("JansenWalker-v0", 400, **WORLD)
    drawn = env.reset(seed=0)[1]["parameters"]
    ranges = {**WORLD["randomize"], "terrain_level": (0, 9)}
    for name, (low, high) in ranges.items():
        values = drawn[name]
        assert low <= values.min() < values.max() <= high
        width = high - low + (name == "terrain_level")
        assert values.mean() == pytest.approx(0.5 * (low + high), abs=3 * width / np.sqrt(12 * 400))
    assert set(np.unique(drawn["terrain_level"])) == set(range(10))
    assert np.unique(drawn["restitution"]).tolist() == [0.0]  # not drawn
    assert {*drawn} == {*PARAMETERS} | {f"_{name}" for name in PARAMETERS}
    env.close()


@pytest.mark.parametrize(
    "name, value", [("friction", 0.45), ("restitution", 0.3), ("payload", 0.7), ("delay", 0.013)]
)
def test_what_is_drawn_is_what_an_argument_gives(name, value):
    """Walks agree bit for bit, and the next episode is as it was without the option."""
    drawn = gym.make("JansenWalker-v0", randomize={name: (value, value)})
    fixed = gym.make("JansenWalker-v0", **{name: value})
    expected = walk(fixed, 3)[0]
    if name == "delay":  # which the observation shows in nothing but the motion
        np.testing.assert_allclose(walk(drawn, 3)[0], expected, atol=1e-12)
    else:
        np.testing.assert_array_equal(walk(drawn, 3)[0], expected)
    plain = gym.make("JansenWalker-v0", delay=(0.0, 0.0) if name != "delay" else (0.0, 0.02))
    before = walk(plain, 3)[0]
    np.testing.assert_array_equal(walk(plain, 3, **{name: value})[0][:21], expected[:21])
    np.testing.assert_array_equal(walk(plain, 3)[0], before)


def test_the_order_of_draws_is_the_documented_one():
    """One generator gives all values of an episode.

    The order is: crank angle, command, crank speed, delay, seed, level, parameters and terrain.
    """
    drawn_ground = []

    def ground(rng, level):
        drawn_ground.append((level, rng.random()))
        return Terrain()

    ranges = {"payload": (0.0, 0.5), "friction": (0.4, 1.0)}
    env = make(terrain=ground, delay=(0.0, 0.02), randomize=ranges)
    _, info = env.reset(seed=5)
    rng, _ = seeding.np_random(5)
    expected = {"crank_angle": rng.uniform(0.0, 2.0 * np.pi)}
    expected["speed_command"] = rng.uniform(0.05, 0.8)
    expected["crank_speed"] = 0.1 * rng.uniform(-1.0, 1.0)
    parameters = {"delay": rng.uniform(0.0, 0.02)}
    rng.integers(2**63)
    parameters["terrain_level"] = rng.integers(0, 9, endpoint=True)
    parameters["friction"] = rng.uniform(0.4, 1.0)
    parameters["payload"] = rng.uniform(0.0, 0.5)
    assert drawn_ground == [(parameters["terrain_level"], rng.random())]
    for told, values in ((info, expected), (info["parameters"], parameters)):
        assert {name: told[name] for name in values} == pytest.approx(values, rel=1e-12)


def test_an_episodes_seed_is_numpys_integer():
    """It leaves the generator, and its samples of 32 bits, as ``integers`` does."""
    ours, numpys = (np.random.Generator(np.random.PCG64(3)) for _ in range(2))
    for _ in range(1000):
        assert draw_seed(ours) == numpys.integers(2**63)
        assert ours.integers(2**32) == numpys.integers(2**32)
        assert ours.random() == numpys.random()


def test_fixing_one_leaves_the_others():
    """They stay as they are sampled with the same seed."""
    env = make()
    drawn = walk(env, 4, 1)[1]["parameters"]
    fixed = walk(env, 4, 1, friction=0.9, terrain_level=2)[1]["parameters"]
    assert fixed == {**drawn, "friction": 0.9, "terrain_level": 2.0}


class Twice:
    """A distribution of one's own: half as often 1 as 0."""

    def sample(self, rng):
        return float(rng.random() < 1.0 / 3.0)


class Wild:
    def sample(self, rng):
        return -rng.random()


def test_any_distribution_will_do():
    envs = gym.make_vec("JansenWalker-v0", 300, randomize={"payload": Twice()})
    payloads = envs.reset(seed=0)[1]["parameters"]["payload"]
    assert set(payloads) == {0.0, 1.0}
    assert payloads.mean() == pytest.approx(1.0 / 3.0, abs=0.09)
    envs.close()
    env = gym.make("JansenWalker-v0", randomize={"payload": Wild()})
    with pytest.raises(
        ValueError, match=r"a sample of randomize\['payload'\] must be.*, got -0\.\d+"
    ):
        env.reset(seed=0)


@pytest.mark.parametrize(
    ("randomize", "message"),
    [
        ({"frictoin": (0.4, 1.0)}, r"must be one of \[.*'friction'.*, got 'frictoin'"),
        (
            {"friction": (1.0, 0.4)},
            r"randomize\['friction'\] must be \(low, high\) with.*, got \(1\.0, 0\.4\)",
        ),
        (
            {"friction": (-1.0, 0.4)},
            r"randomize\['friction'\] must be between 0\.0 and.*, got -1\.0",
        ),
        ({"friction": (0.1, 0.2, 0.3)}, r"a number or \(low, high\)"),
        ({"friction": "0.5"}, r"randomize\['friction'\] must be .*, got '0.5'"),
        (
            {"foot_stiffness_scale": (0.5, 2.0)},
            "that has an effect here, .*, got 'foot_stiffness_scale'",
        ),
        (
            {"rotor_inertia_scale": (0.5, 2.0)},
            "that has an effect here, .*, got 'rotor_inertia_scale'",
        ),
        ({"terrain_level": (0, 3)}, "that has an effect here, .*, got 'terrain_level'"),
        ({"noise_level": (0, 3)}, "that has an effect here, .*, got 'noise_level'"),
        ({"push_strength": (0, 3)}, "that has an effect here, .*, got 'push_strength'"),
        ({"lengths": "long"}, r"randomize\['lengths'\] must be a finite number, got 'long'"),
        ({"lengths": -0.1}, r"randomize\['lengths'\] must be between 0.0 and 0.9, got -0.1"),
        (
            {"lengths": (1.1, 0.9)},
            r"randomize\['lengths'\] must be \(low, high\) with.*, got \(1\.1, 0\.9\)",
        ),
        (
            {"lengths": {"tail": 0.1}},
            r"randomize\['lengths'\] must be one of \[.*'frame'.*, got 'tail'",
        ),
        (
            {"lengths": {"crank": (0.0, 1.0)}},
            r"randomize\['lengths'\]\['crank'\] must be between.*, got 0\.0",
        ),
    ],
)
def test_wrong_names_and_ranges_are_refused(randomize, message):
    with pytest.raises(ValueError, match=message):
        gym.make("JansenWalker-v0", randomize=randomize)


def refused(env, options, message):
    """A reset with these options, which must leave where and what the robots are."""

    def states():
        return env.call("get_state") if hasattr(env, "call") else [env.get_state()]

    before = states()
    with pytest.raises(ValueError, match=message):
        env.reset(options=options)
    for was, now in zip(before, states(), strict=True):
        assert was["record"]["parameters"] == now["record"]["parameters"]
        np.testing.assert_array_equal(was["terrain"].pop("points"), now["terrain"].pop("points"))
        assert was["terrain"] == now["terrain"]
        motions = (state["record"]["state"] for state in (was, now))
        np.testing.assert_allclose(*motions, atol=1e-12)


def test_what_feet_cannot_bear_changes_nothing():
    """Feet may be too soft for the load, or on ground on which they may not land: no robot of a
    batch moves.
    """

    def ground(rng, level):
        return Terrain(restitution=0.3 * (level == 9))

    envs = gym.make_vec("JansenWalkerHardcore-v0", 3, terrain=ground, terrain_level=0)
    envs.reset(seed=0)
    soft = {"foot_stiffness_scale": np.array([1.0, 1.0, 0.01]), "payload": 2.0}
    refused(envs, soft, "must be at least .* to carry")
    refused(envs, {"terrain_level": np.array([1, 2, 9])}, "must be 0 with compliant pads")
    envs.close()
    given = gym.make("JansenWalkerHardcore-v0", terrain=ground, terrain_level=9, restitution=0.0)
    assert given.reset(seed=0)[1]["parameters"]["restitution"] == 0.0
    with pytest.raises(ValueError, match=r"must be at least .* to carry"):
        soft = {"foot_stiffness_scale": (0.01, 1.0), "payload": (0.0, 2.0)}
        gym.make("JansenWalkerHardcore-v0", randomize=soft)


def test_compliant_feet_stay_out_of_drawn_restitution():
    """They are refused even where this episode happens to have no restitution."""
    randomize = {"restitution": (0.0, 0.5)}
    soft = r"stiffness must be at least 785 N/m .*, got 100\.0 N/m"
    for arguments, message in (
        ({"pad_compliance": Compliance(1e5), "randomize": randomize}, "restitution"),
        (
            {"pad_compliance": Compliance(1e5), "restitution": 0.5},
            r"restitution must be 0 with compliant pads, .*, got 0\.5",
        ),
        ({"pad_compliance": Compliance(100.0), "plant": "projection"}, soft),
        ({"pad_compliance": Compliance(100.0), "plant": "rigid_body"}, soft),
    ):
        with pytest.raises(ValueError, match=message):
            gym.make("JansenWalker-v0", **arguments)
    drawn = gym.make("JansenWalker-v0", randomize=randomize)
    fixed = gym.make("JansenWalker-v0", restitution=0.3)
    for env in (drawn, fixed):
        env.reset(seed=0, options={"restitution": 0.0})
        with pytest.raises(ValueError, match="restitution"):
            env.unwrapped.set_parameters(pad_compliance=Compliance(2e4, 20.0))
    fixed.unwrapped.set_parameters(restitution=0.0, pad_compliance=Compliance(2e4, 20.0))
    fixed.reset()
    copy = pickle.loads(pickle.dumps(fixed.unwrapped))
    for walker in (fixed, copy):
        seen = walker.step(np.full(1, 0.3, np.float32))[0]
    np.testing.assert_array_equal(seen, fixed.unwrapped.task.observation[0])


def test_a_seed_and_a_level_replay_an_episode_of_a_curriculum():
    """They do whatever came before, also beyond the top."""
    first, other = (make(curriculum=Curriculum(up=0.0, down=0.0)) for _ in range(2))
    expected = walk(first, 5, terrain_level=3)
    walk(other, 1, terrain_level=HIGHEST)  # goes up
    again = walk(other, 5, terrain_level=3)
    np.testing.assert_array_equal(again[0], expected[0])
    assert again[1]["parameters"] == expected[1]["parameters"]


def test_friction_of_a_ground_of_ones_own():
    """The friction is the generator's, unless an argument gives it."""

    def ground(rng, level):
        points = (-1.0, 0.0), (1.0, 0.0), (2.0, 0.01 * level)
        return Terrain(points, friction=rng.uniform(0.2, 0.3))

    env = gym.make("JansenWalker-v0", terrain=ground, terrain_level=3)
    friction = env.reset(seed=0)[1]["parameters"]["friction"]
    assert 0.2 < friction < 0.3
    assert env.get_wrapper_attr("terrain").friction == friction
    given = gym.make("JansenWalker-v0", terrain=ground, terrain_level=3, friction=0.6)
    assert given.reset(seed=0)[1]["parameters"]["friction"] == 0.6
    assert given.unwrapped.task.world.get_attr("friction") == [0.6]
    refused = gym.make("JansenWalker-v0", terrain=lambda rng, level: level)
    with pytest.raises(ValueError, match="must be a Terrain"):
        refused.reset(seed=0)


def test_the_second_plant_has_the_same_world():
    """Information, parameters and ground are the same, and the motion nearly is."""
    kwargs = {**WORLD, "randomize": {**WORLD["randomize"], "delay": 0.0}}
    plants = ("projection", "rigid_body")
    envs = [gym.make("JansenWalker-v0", plant=plant, **kwargs) for plant in plants]
    for seed in (0, 1):
        infos = [env.reset(seed=seed)[1] for env in envs]
        assert infos[0]["parameters"] == infos[1]["parameters"]
        assert envs[0].unwrapped.terrain == envs[1].unwrapped.terrain
        for _ in range(10):
            ends = [env.step(np.full(1, 0.2, np.float32))[4] for env in envs]
        assert ends[0].keys() == ends[1].keys()
        assert ends[0]["energy"].keys() == ends[1]["energy"].keys()
        assert ends[0]["joint_gap"] == 0.0 < ends[1]["joint_gap"] < 2e-4
        for name in ("x_position", "pitch", "crank_speed"):
            assert ends[0][name] == pytest.approx(ends[1][name], rel=0.05, abs=0.01)


@pytest.mark.slow
def test_a_reset_lets_go_of_the_grounds_before():
    """Python's objects and pymunk's are freed: memory stays flat over many episodes."""
    envs = gym.make_vec("JansenWalker-v0", 4, **WORLD)
    spaces = []
    envs.reset(seed=0)
    grounds = [weakref.ref(ground) for ground in envs.get_attr("terrain")]
    for _ in range(3):
        envs.reset()
        gc.collect()
        spaces.append(sum(type(known) is pymunk.Space for known in gc.get_objects()))
    assert not any(ground() for ground in grounds) and len({*spaces}) == 1
