"""Lengths of an episode: given, drawn, observed and saved, in every environment."""

import json
import pickle
from copy import deepcopy
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from side_by_side import walk

from agents.training.training_state import plain
from jansen_env import Payload, built_robot, paper_robot
from jansen_env.robot.kinematics import nearest_dead_point
from jansen_env.robot.lengths import lengths, with_lengths
from jansen_env.world import episode_lengths

IDS = ("JansenWalker-v0", "JansenWalkerHardcore-v0", "JansenGoal-v0", "JansenCrank-v0")
PLANTS = [*((name, {}, 40) for name in IDS), ("JansenWalker-v0", {"plant": "rigid_body"}, 2)]
every = pytest.mark.parametrize(("env_id", "kwargs", "steps"), PLANTS)
WANTED = {"crank": 0.1, "foot_CE": 0.26, "frame_angle": 0.13}
DRAWN = {"randomize": {"lengths": 0.1}}


def made(env_id, **kwargs):
    return gym.make(env_id, **kwargs).unwrapped


def length_columns(env):
    """Columns of the observed lengths, in the order of the lengths."""
    return [env.task.columns[f"length_{name}"] for name in lengths(env.robot)]


@pytest.mark.slow
@every
def test_given_lengths_are_those_of_a_robot_made_so_for_one_episode(env_id, kwargs, steps):
    env, nominal = made(env_id, **kwargs), made(env_id, **kwargs)
    other = made(env_id, robot=with_lengths(env.robot, WANTED), **kwargs)
    seen = env.reset(seed=3, options={"lengths": WANTED})[0], other.reset(seed=3)[0]
    assert (seen[0] == seen[1]).all() and (walk(env, steps) == walk(other, steps)).all()
    assert env.robot == other.robot
    nominal.reset(seed=3)
    assert (env.reset()[0] == nominal.reset()[0]).all()
    assert (walk(env, steps) == walk(nominal, steps)).all() and env.robot == nominal.robot


@every
def test_a_state_holds_the_lengths(env_id, kwargs, steps):
    """It goes through JSON into another environment; a state without lengths brings back the
    robot's own.
    """
    env, other = (made(env_id, observe_lengths=True, **DRAWN, **kwargs) for _ in range(2))
    nominal_env = made(env_id, observe_lengths=True, randomize={}, **kwargs)
    first, info = env.reset(seed=1)
    walk(env, steps)
    state = json.loads(json.dumps(plain(env.get_state())))
    assert state["lengths"] == info["lengths"] == env.task.information.single(0)["lengths"]
    other.reset(seed=2)
    if env_id == "JansenWalker-v0" and steps < 9:  # whose solver a state restarts
        env.set_state(state)
    factors = length_columns(env)
    assert (other.set_state(state)[factors] == first[factors]).all() and env.robot == other.robot
    assert (walk(env, steps) == walk(other, steps)).all()
    assert (env.reset()[0] == other.reset()[0]).all() and env.robot == other.robot
    nominal_env.reset(seed=5)
    nominal = nominal_env.get_state()
    assert "lengths" not in nominal
    nominal_env.set_state(state)
    robot = nominal_env.robot
    assert robot == made(env_id, robot=robot, **kwargs).robot != built_robot()
    assert (nominal_env.set_state(nominal)[factors] == 0.0).all()
    assert "lengths" not in nominal_env.get_state()


@pytest.mark.parametrize("env_id", IDS)
def test_draws_are_the_seeds_and_leave_the_others_as_they_are(env_id):
    env, same = made(env_id, **DRAWN), made(env_id, **DRAWN)
    without = made(env_id, randomize={})
    infos = [walker.reset(seed=4)[1] for walker in (env, same, without)]
    assert infos[0]["lengths"] == infos[1]["lengths"] and (walk(env) == walk(same)).all()
    assert "lengths" not in infos[2] and env.robot != without.robot
    for name in ("speed_command", "crank_angle", "goal", "parameters"):
        assert infos[0].get(name) == infos[2].get(name)
    robots = []
    for _ in range(5):
        env.reset()
        same.reset()
        assert env.robot == same.robot
        robots.append(env.robot)
        nominal = lengths(without.robot)
        factors = [value / nominal[name] for name, value in lengths(env.robot).items()]
        assert 0.9 <= min(factors) < 0.98 and 1.02 < max(factors) <= 1.1
        assert nearest_dead_point(env.robot)[0] >= episode_lengths.MARGIN
    assert len({*robots}) == 5


@pytest.mark.slow
@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
@pytest.mark.parametrize("env_id", IDS)
def test_a_batch_keeps_as_many_designs_as_it_needs(env_id, mode):
    """Tables of designs are used again, and its copies continue with the lengths it has."""
    kwargs = {"max_episode_steps": 20, "observe_lengths": True}
    kwargs["randomize"] = {"lengths": {"coupler": (0.95, 1.1), "upper_rod": 0.03}}
    batch = gym.make_vec(env_id, 5, autoreset_mode=mode, **kwargs).unwrapped
    batch.reset(seed=7)
    walk(batch, 45)
    assert len(batch.task.world.plant.designs.depths) <= 10
    copies = deepcopy(batch), pickle.loads(pickle.dumps(batch))
    after = walk(batch, 20)
    for copy in copies:
        assert (walk(copy, 20) == after).all()
    assert len({*batch.get_attr("robot")}) == 5


@pytest.mark.slow
def test_robots_are_exchanged_while_other_threads_move_theirs():
    arguments = {"max_episode_steps": 12, **DRAWN}
    envs = [gym.make_vec("JansenWalkerBuilt-v0", 40, threads=n, **arguments) for n in (1, 3)]
    for batch in envs:
        batch.reset(seed=0)
        batch.unwrapped._elapsed[:] = np.arange(40) % 12  # so that each step ends some episodes
    seen = [walk(batch, 40) for batch in envs]
    assert (seen[0] == seen[1]).all() and len({*envs[0].unwrapped.get_attr("robot")}) == 40


def test_a_batch_takes_one_set_of_lengths_or_one_for_each():
    envs = gym.make_vec("JansenWalker-v0", 3, robot="built").unwrapped
    built = built_robot()
    envs.reset(seed=0, options={"lengths": WANTED})
    assert envs.get_attr("robot") == (with_lengths(built, WANTED),) * 3
    each = [{}, {"rocker": 0.24}, WANTED]
    envs.reset(options={"lengths": each})
    assert envs.get_attr("robot") == tuple(with_lengths(built, given) for given in each)
    mask = np.array([True, False, False])
    envs.reset(options={"lengths": WANTED, "reset_mask": mask, "robot": "paper"})
    robots = envs.get_attr("robot")
    assert robots[0] == with_lengths(paper_robot(), WANTED) and robots[1] != built
    envs.reset()
    assert envs.get_attr("robot") == (paper_robot(), built, built)


@pytest.mark.parametrize("env_id", IDS)
def test_observed_are_factors_less_one_beside_all_else(env_id):
    env, without = made(env_id, observe_lengths=True), made(env_id)
    names = [entry.name for entry in env.observed]
    nominal = lengths(env.robot)
    columns = length_columns(env)
    others = [name not in columns for name in range(len(names))]
    assert [entry for entry, other in zip(env.observed, others, strict=True) if other] == [
        *without.observed
    ]
    assert [names[column] for column in columns] == [f"length_{name}" for name in nominal]
    observation, info = env.reset(seed=0, options={"lengths": WANTED})
    assert info["lengths"] == {**nominal, **WANTED}
    factors = [{**nominal, **WANTED}[name] / nominal[name] - 1.0 for name in nominal]
    np.testing.assert_allclose(observation[columns], factors, atol=1e-7)
    without.reset(seed=0, options={"lengths": WANTED})
    seen = walk(env)
    plain = walk(without)
    noisy = "Hardcore" in env_id
    assert (seen[:, columns] == observation[columns]).all()
    assert noisy or (seen[:, others] == plain).all()
    assert (env.task.world.plant.states == without.task.world.plant.states).all()
    if noisy:
        assert (env.step([0.1])[4]["true_observation"][columns] == observation[columns]).all()
    assert (env.reset()[0][columns] == 0.0).all()


def test_ranges():
    for value, low, high in (((0.9, 1.0), 0.9, 1.0), ({"coupler": 0.04}, 0.96, 1.04)):
        env = made("JansenWalker-v0", randomize={"lengths": value})
        nominal = lengths(env.robot)
        for seed in range(8):
            for name, length in env.reset(seed=seed)[1]["lengths"].items():
                factor = length / nominal[name]
                drawn = name in value or not isinstance(value, dict)
                assert (low <= factor <= high and drawn) or factor == 1.0


def test_an_option_fixes_what_it_names_and_info_can_be_given_back():
    env, other = made("JansenWalkerBuilt-v0", **DRAWN), made("JansenWalkerBuilt-v0")
    drawn = env.reset(seed=6)[1]["lengths"]
    fixed = env.reset(seed=6, options={"lengths": {"coupler": 0.24}})[1]["lengths"]
    assert fixed == {**drawn, "coupler": 0.24}
    for again in (env, other):
        again.reset(seed=6, options={"lengths": drawn})
        assert lengths(again.robot) == lengths(with_lengths(built_robot(), drawn))
    assert (walk(env) == walk(other)).all()


def test_draws_that_never_turn_end_with_the_reason():
    env = made("JansenWalker-v0", randomize={"lengths": {"crank": (1.9, 2.0)}})
    with pytest.raises(ValueError, match=r"^randomize\['lengths'\] must allow .* joint . does"):
        env.reset(seed=0)
    near = made("JansenWalker-v0", robot="holy", randomize={"lengths": {"frame": (1.0, 1.0)}})
    near.reset(seed=0)


def test_what_changes_in_an_episode_stays_with_the_robot():
    """Payload and motor stay, lengths do not; the robot is one that has always had them."""
    env = made("JansenWalkerBuilt-v0")
    env.reset(seed=0, options={"lengths": WANTED})
    env.set_parameters(payload=1.5, motor=replace(env.robot.motor, torque_limit=9.0))
    assert env.robot.body("crank").length == 0.1
    env.reset(seed=1)
    loaded = replace(built_robot(), payload=Payload(1.5))
    loaded = replace(loaded, motor=replace(loaded.motor, torque_limit=9.0))
    other = made("JansenWalkerBuilt-v0", robot=loaded)
    other.reset(seed=1)
    assert env.robot == loaded and (walk(env) == walk(other)).all()
