"""What holds for every registered environment: checkers, energy accounts, information, pages."""

import inspect
import re
import warnings
from pathlib import Path

import gymnasium as gym
import numpy as np
import pygame
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from side_by_side import random_walk
from stable_baselines3.common.env_checker import check_env as check_for_sb3

from agents.training.config import shipped_config
from jansen_env.plants.parameters import PARAMETERS, Uniform
from jansen_env.registration import IDS
from jansen_env.robot import Compliance, Payload
from jansen_env.robot.motor import MOTORS
from jansen_env.sb3 import make_vec_env
from jansen_env.sb3.run_config import load_config
from jansen_env.scoring.benchmarks import find_benchmark
from jansen_env.terrain.generators import Curriculum

WALKERS = [name for name in IDS if "Walker" in name]
ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("env_id", IDS)
def test_each_has_a_benchmark_baselines_a_training_configuration_and_a_page(env_id):
    assert find_benchmark(env_id).baselines and find_benchmark(env_id).commands
    assert load_config(shipped_config(env_id, "ppo"), algo="ppo", env=env_id).timesteps > 0
    page = (ROOT / "docs" / "environments" / f"{env_id}.md").read_text(encoding="utf-8")
    assert f"<!-- environment {env_id} -->" in page


@pytest.mark.parametrize("env_id", IDS)
def test_gymnasiums_checker_warns_of_unbounded_observations_alone(env_id, monkeypatch):
    """Anything but the note on infinite bounds is an error; both render modes are tried."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(gym.make(env_id, render_mode="rgb_array").unwrapped)
    # Files that other tests left open may be closed meanwhile.
    told = [warning for warning in caught if not issubclass(warning.category, ResourceWarning)]
    texts = [str(warning.message) for warning in told]
    assert all("infinity" in text for text in texts), texts


def test_gymnasiums_checker_needs_no_display(monkeypatch):
    """Its window is skipped with a warning."""
    for name in ("SDL_VIDEODRIVER", "DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.warns(UserWarning, match="window cannot be opened: .*'rgb_array' needs no display"):
        check_env(gym.make("JansenCrank-v0").unwrapped)


def test_somebody_else_may_quit_pygame():
    """Gymnasium's own environments quit it when they close."""
    env = gym.make("JansenWalker-v0", render_mode="rgb_array")
    env.reset(seed=0)
    picture = env.render()
    pygame.quit()
    assert (env.render() == picture).all()
    env.close()


@pytest.mark.parametrize(
    "given",
    [
        {"payload": Payload(1.0, 0.1, (0.1, 0.2))},
        {"motor": MOTORS["mx_106"]},
        {"pad_compliance": Compliance(1e5, 60.0)},
        {"curriculum": Curriculum()},
    ],
)
def test_a_specification_in_json_makes_the_same(given):
    spec = gym.spec("JansenWalkerRough-v0")
    specs = (spec := gym.make(spec, **given).spec), EnvSpec.from_json(spec.to_json())
    first, second = (gym.make(s).reset(seed=0)[0] for s in specs)
    assert (first == second).all()


def test_the_terrain_has_the_friction_of_the_episode():
    env = gym.make("JansenWalker-v0", friction=0.3)
    env.reset(seed=0, options={"friction": 0.5})
    assert env.unwrapped.terrain.friction == 0.5


@pytest.mark.parametrize("env_id", IDS)
def test_stable_baselines_checker_has_nothing_to_say(env_id):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_for_sb3(gym.make(env_id).unwrapped)


RESIDUALS = {  # the largest allowed of a control step, J; as in docs/theory.md
    "JansenWalker-v0": 1e-3,
    "JansenWalkerBuilt-v0": 0.05,
    "JansenWalkerRough-v0": 0.1,
    "JansenWalkerHardcore-v0": 0.1,
    "JansenGoal-v0": 0.05,
    "JansenCrank-v0": 1e-7,
}
RESIDUAL_OF_BUILT = 0.05  # the same of any other environment, J, whose robot is the built one


@pytest.mark.parametrize("env_id", IDS)
def test_energy_balances_in_every_step(env_id):
    """Under random hard torque the account is closed to 1e-12 J, and its residual is small."""
    each = RESIDUALS.get(env_id, RESIDUAL_OF_BUILT)
    share = 1e-6 if env_id == "JansenCrank-v0" else 1e-3
    env = gym.make(env_id)
    rng = np.random.default_rng(1)
    missed = worked = 0.0
    env.reset(seed=0)
    for _ in range(1000):
        _, _, terminated, truncated, info = env.step(rng.uniform(-0.5, 1, 1).astype(np.float32))
        energy = {**info["energy"]}
        del energy["electrical_work"]
        work = energy.pop("motor_work")
        residual = energy["residual"]
        put_in = work + energy.pop("push_work", 0.0) + energy.pop("correction_work", 0.0)
        assert put_in == pytest.approx(sum(energy.values()), abs=1e-12)
        assert abs(residual) < each
        assert min(energy.get(f"{loss}_loss", 0.0) for loss in ("joint", "slip", "impact")) >= 0.0
        missed = missed + abs(residual)
        worked = worked + abs(work)
        if terminated or truncated:
            env.reset()
    assert worked > 5.0 and missed < share * worked


@pytest.mark.parametrize("env_id", IDS)
def test_observations_move_and_share_no_memory(env_id):
    """No element but a command is constant over 500 random steps; each array is fresh."""
    env = gym.make(env_id).unwrapped
    envs = gym.make_vec(env_id, 2)
    first = env.reset(seed=0)[0]
    returned = envs.reset(seed=0)[0]
    step = envs.step(np.full((2, 1), 0.3, np.float32))
    told = [value for value in step[4].values() if isinstance(value, np.ndarray)]
    arrays = [first, returned, *step[:4], *told]
    kept = [array.copy() for array in arrays]
    rows = random_walk(env, 500)[0][:, :-1]
    envs.step(np.ones((2, 1), np.float32))
    assert all((a == b).all() for a, b in zip(arrays, kept, strict=True))
    constant = {env.observed[i].name for i in np.flatnonzero(np.ptp(rows, axis=0) < 1e-4)}
    hidden = {"mean_slip"} if "Hardcore" in env_id else set()
    assert constant <= {"speed_command", *hidden}


def kind(value):
    """Keys and kinds of a dictionary's values, shape and type of an array, type of all else."""
    if isinstance(value, dict):
        return {name: kind(entry) for name, entry in value.items()}
    if isinstance(value, np.ndarray):
        return value.shape, value.dtype
    return type(value)


@pytest.mark.parametrize("env_id", IDS)
def test_reset_and_step_inform_of_the_same(env_id):
    """Information has the same types, as wrappers that stack it need: for one robot, for many, and
    for Stable-Baselines3.
    """
    env = gym.make(env_id, track_joint_forces=True)
    envs = gym.make_vec(env_id, 3)
    venv = make_vec_env(env_id, 2, info_keys=None)
    venv.reset()
    resets = [env.reset()[1], envs.reset()[1], venv.reset_infos[0]]
    actions = [np.full(shape, 0.5, np.float32) for shape in ((1,), (3, 1), (2, 1))]
    steps = [env.step(actions[0])[4], envs.step(actions[1])[4], venv.step(actions[2])[3][0]]
    again = [env.reset()[1], envs.reset()[1], resets[2]]
    for first, step, second in zip(resets, steps, again, strict=True):
        assert kind(first) == kind(step) == kind(second)
        terms = [name for name in step if name.startswith(("reward/", "joint_"))]
        assert len(terms) >= 2 and any(np.any(step[name]) for name in terms)
        assert not any(np.any(info[name]) for info in (first, second) for name in terms)
    env.close(), envs.close(), venv.close()


@pytest.mark.parametrize("env_id", WALKERS)
def test_the_documented_defaults_are_those_of_the_class(env_id):
    env = gym.make(env_id).unwrapped
    doc = " ".join(type(env).__doc__.split())
    low, high = env.task.speed_command[0]
    assert f"{low:g} to {high:g} m/s" in doc or f"({low:g}, {high:g})" in doc
    episodes = env.task.world.episodes
    levels = {"terrain_level": Uniform(*episodes.levels[0])} if episodes.levels.any() else {}
    for name, drawn in {**episodes.randomizations[0], **levels}.items():
        assert f"``{name}``" in doc
        assert f"{drawn.low:g} to {drawn.high:g}" in doc, name
    assert f"{len(env.observed) - 1} |" in doc or env_id == "JansenWalker-v0"


def documented_observations(env):
    """How many observations the table of a class has, by default arguments."""
    count = 0
    toes = env.unwrapped.task.world.plant.toes
    table = inspect.getdoc(type(env.unwrapped)).partition("| Num | Observation |")[2]
    for line in table.split("\n\n")[0].splitlines()[2:]:
        number, meaning = line.split("|")[1:3]
        if "with ``height_scan``" in meaning or "with ``observe_lengths``" in meaning:
            continue
        number = number.replace("then", str(count))
        places = [eval(place, {"n": toes}) for place in number.split("..")]
        assert places[0] == count, line
        count = places[-1] + 1
    return count


@pytest.mark.parametrize("env_id", [name for name in IDS if name != "JansenWalkerBuilt-v0"])
def test_the_documented_observation_has_the_shape_of_the_observation(env_id):
    env = gym.make(env_id)
    assert (documented_observations(env),) == env.observation_space.shape


@pytest.mark.parametrize("env_id", IDS)
def test_documented_shapes_are_the_actual_ones(env_id):
    """All properties of an environment of one robot are compared whose docstrings begin with a
    shape.
    """
    env = gym.make(env_id).unwrapped
    env.reset(seed=0)
    for name, member in inspect.getmembers(type(env), lambda member: isinstance(member, property)):
        shape = re.match(r"\((\d+,[ \d,]*)\)", member.__doc__ or "")
        if shape:
            assert getattr(env, name).shape == eval(shape[0]), name
    if "Walker" in env_id:
        assert env.parameters.shape == (len(PARAMETERS),)


def test_the_readmes_table_has_the_numbers_of_observations():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\|.*?\[`(Jansen\w+-v0)`\].*?\| (\d+)[^|]*\|[^|]*\|$", text, re.MULTILINE)
    assert {env_id for env_id, _ in rows} == {*IDS}
    for env_id, count in rows:
        assert gym.make(env_id).observation_space.shape == (int(count),), env_id


def test_defaults_that_would_do_nothing_are_left_out():
    """Another argument may take away what a default is about.

    What the user asks for is refused there.
    """
    flat = gym.make("JansenWalkerRough-v0", terrain="flat").reset(seed=0)[1]["parameters"]
    assert flat["terrain_level"] == 0 and flat["payload"] > 0.0
    plain = gym.make_vec("JansenWalkerHardcore-v0", 2, robot="paper", noise=None, push=None)
    drawn = plain.reset(seed=0)[1]["parameters"]
    assert drawn["noise_level"].tolist() == drawn["foot_stiffness_scale"].tolist() == [1.0, 1.0]
    assert drawn["friction"][0] != drawn["friction"][1]
    plain.close()
    with pytest.raises(ValueError, match="noise_level"):
        gym.make("JansenWalkerHardcore-v0", noise=None, randomize={"noise_level": (0.5, 1.0)})
