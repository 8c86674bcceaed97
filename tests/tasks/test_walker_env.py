"""JansenWalker-v0 as a Gymnasium environment: contract, observation, state, falls, rendering."""

import copy
import math
import pickle

import gymnasium as gym
import numpy as np
import pygame
import pytest
from gymnasium.utils.play import play

import jansen_env
from jansen_env.robot.kinematics import advance_per_turn
from jansen_env.tasks.walking import JansenWalkerEnv

SEES = JansenWalkerEnv().task.columns
COS, SIN, SPEED = (SEES[name] for name in ("cos_crank_angle", "sin_crank_angle", "crank_speed"))
LOADS = [SEES[name] for name in SEES if name.startswith("toe_load_")]


@pytest.fixture
def env():
    made = gym.make("JansenWalker-v0")
    yield made
    made.close()


def roll(env, steps, seed=0):
    """Observations and rewards of seeded random actions."""
    rng = np.random.default_rng(seed)
    rows = []
    for _ in range(steps):
        obs, reward, terminated, truncated, _ = env.step(rng.uniform(-1, 1, 1).astype(np.float32))
        rows.append(np.append(obs, reward))
        if terminated or truncated:
            env.reset()
    return np.array(rows)


def test_observation_is_the_documented_table(env):
    env.reset(seed=1, options={"speed_command": 0.4})
    for _ in range(20):
        obs, *_, info = env.step(np.array([0.2], np.float32))
    x, y, theta, psi, vx, vy, w, n = env.unwrapped.plant.state
    loads = info["contact_force"][:, 1] / env.unwrapped.weight
    height = y - float(env.unwrapped.terrain.height(x))
    expected = [math.cos(psi), math.sin(psi), n, math.sin(theta), math.cos(theta), w, vx, vy,
                height, 0.4, *loads, 0.2]  # fmt: skip
    expected += [
        info[name] for name in ("lag", "mean_speed", "mean_slip", "mean_power", "rms_torque")
    ]
    assert obs == pytest.approx(np.array(expected, np.float32), abs=1e-6)
    assert info["crank_torque"] == pytest.approx(0.2 * 20.0, rel=1e-6)


def test_observations_move_and_share_no_memory(env):
    """No element but the command is constant over 1000 random steps; each array is fresh."""
    first, _ = env.reset(seed=0)
    kept = first.copy()
    rows = roll(env, 1000)
    assert np.array_equal(first, kept)
    assert (np.ptp(rows, axis=0) > 1e-4).all()


def test_loads_at_rest_carry_the_weight(env):
    for seed in range(10):
        obs, info = env.reset(seed=seed)
        assert obs[LOADS].sum() == pytest.approx(1.0, abs=1e-2)
        assert (info["contact_force"][:, 1] >= 0.0).all()


def test_stands_level_at_every_starting_angle():
    """The robot is set down level within 0.05 rad on both sides, wherever its crank stands."""
    env = JansenWalkerEnv(reset_noise_scale=0.0)
    for angle in np.linspace(0.0, 2.0 * math.pi, 40):
        env.reset(seed=0, options={"crank_angle": angle})
        state = env.plant.state
        assert abs(state[2]) < 0.05
        gap = env.plant.toe_positions()[:, 1] - env.robot.pad_radius
        assert np.sort(gap)[1] < 1e-3  # a second toe is down too


def test_state_copies_and_pickles_go_on_bit_for_bit():
    """get_state/set_state into a fresh environment, deepcopy and pickle, all in mid-walk."""
    env = JansenWalkerEnv(command_interval=0.3)
    env.reset(seed=5)
    roll(env, 60)
    fresh = JansenWalkerEnv(command_interval=0.3)
    fresh.reset(seed=99)
    fresh.set_state(copy.deepcopy(env.get_state()))
    others = [fresh, copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    expected = roll(env, 300, seed=6)
    for other in others:
        assert np.array_equal(roll(other, 300, seed=6), expected)


def test_energy_balances_in_every_step():
    """To 1e-3 J in a step of hard random torque (up to 20 N m), and to 0.1 % of the work in all."""
    env = JansenWalkerEnv()
    env.reset(seed=0)
    rng = np.random.default_rng(1)
    residual, work = 0.0, 0.0
    for _ in range(1000):
        _, _, terminated, _, info = env.step(rng.uniform(-1, 1, 1).astype(np.float32))
        energy = info["energy"]
        parts = ("joint_loss", "slip_loss", "impact_loss", "mechanical_energy_change", "residual")
        assert energy["push_work"] == 0.0
        put_in = energy["motor_work"] + energy["correction_work"]
        assert put_in == pytest.approx(sum(energy[p] for p in parts), abs=1e-12)
        assert abs(energy["residual"]) < 1e-3
        assert min(energy[p] for p in ("joint_loss", "slip_loss")) >= 0.0
        residual += abs(energy["residual"])
        work += abs(energy["motor_work"])
        if terminated:
            env.reset()
    assert residual < 1e-3 * work


@pytest.mark.parametrize("robot", ["paper", "holy"])
def test_positive_actions_walk_forward(robot):
    """And negative ones backward, whichever way the crank has to turn; information is physical."""
    ends, turns = [], math.copysign(1.0, advance_per_turn(jansen_env.ROBOTS[robot]()))
    for sign in (1.0, -1.0):
        env = JansenWalkerEnv(robot=robot, reset_noise_scale=0.0)
        observation, _ = env.reset(
            seed=0, options={"crank_angle": 0.3 if sign > 0 else math.pi - 0.3}
        )
        for _ in range(300):
            torque = 10.0 * (sign - observation[SPEED]) + 1.5 * sign
            action = np.clip(torque / 20.0, -1, 1)
            observation, *_, info = env.step(np.array([action]))
        ends.append(info["x_position"])
        assert info["crank_torque"] == turns * 20.0 * action
        assert observation[SPEED] == pytest.approx(turns * info["crank_speed"], rel=1e-6)
        angle = math.atan2(observation[SIN], observation[COS])
        assert math.cos(angle - turns * info["crank_angle"]) == pytest.approx(1.0)
    assert ends[0] > 0.2 and ends[1] < -0.2
    assert ends[0] == pytest.approx(-ends[1], rel=0.1)  # chaos in detail, not in the mean


def test_what_a_fall_is():
    def over(**arguments):
        env = JansenWalkerEnv(torque_limit=60.0, **arguments)
        env.reset(seed=0, options={"crank_angle": 1.0})
        touched, pitch, steps = False, 0.0, 0
        for _ in range(150):
            steps += 1
            _, _, terminated, _, info = env.step(np.array([1.0], np.float32))
            touched |= bool(env.task.world.plant.accumulators["non_toe_impulse"][0] > 0.0)
            pitch = max(pitch, abs(info["pitch"]))
            if terminated:
                break
        return steps, touched, pitch

    touching = over(fall_pitch=9.0)
    assert touching[1] and touching[2] < 9.0
    leaning = over(fall_pitch=0.3, fall_contact=False)
    assert 0.3 < leaning[2] < 0.8 and leaning[0] <= touching[0]
    neither = over(fall_pitch=1e3, fall_contact=False)
    assert neither[0] == 150 and neither[1]


@pytest.mark.parametrize("plant", ["projection", "rigid_body"])
def test_a_simulation_that_diverges_ends_the_episode(plant):
    """Garbage is never returned: the step does nothing, warns, and truncates; a reset mends all."""
    env = JansenWalkerEnv(plant=plant, torque_limit=1e12)
    env.reset(seed=0)
    before = env.plant.state
    with pytest.warns(UserWarning, match="their simulation diverged"):
        observation, reward, terminated, truncated, info = env.step(np.array([1.0], np.float32))
    assert truncated and not terminated and info["diverged"] and np.isfinite(reward)
    assert np.isfinite(observation).all() and (env.plant.state == before).all()
    assert not info["slip"].any() and info["energy"]["motor_work"] == 0.0
    _, info = env.reset(seed=0)
    assert not info["diverged"]
    *_, truncated, info = env.step(np.array([0.0], np.float32))
    assert not truncated and not info["diverged"]


def test_reset_options():
    env = JansenWalkerEnv()
    obs, info = env.reset(seed=0, options={"speed_command": 0.3, "crank_angle": 1.0})
    assert info["speed_command"] == 0.3 and obs[SEES["speed_command"]] == np.float32(0.3)
    assert info["crank_angle"] == 1.0
    with pytest.raises(ValueError, match="sped_command"):
        env.reset(options={"sped_command": 0.3})


@pytest.mark.parametrize("robot", [*sorted(jansen_env.ROBOTS), jansen_env.paper_robot(3)])
def test_every_design_walks_without_harm(robot):
    """Up a slope with a payload for 3 s: no fall, pads on the ground, contacts solved to 1e-9 N s,
    and no energy from nothing."""
    env = JansenWalkerEnv(robot=robot, terrain="slope:0.02", payload=1.0)
    observation, info = env.reset(seed=0, options={"crank_angle": 2.0})
    start, missed, work = info["x_position"], 0.0, 0.0
    for _ in range(150):
        torque = env.weight * (0.08 * (3.5 - observation[SPEED]) + 0.02)
        share = np.clip(torque / env.torque_limit, -1.0, 1.0)
        observation, _, terminated, _, info = env.step(np.array([share]))
        assert not terminated and not info["fallen"] and not info["diverged"]
        assert env.task.world.plant.accumulators["worst_residual"][0] < 1e-9
        pads = env.plant.toe_positions() - [0.0, env.robot.pad_radius]
        assert (pads[:, 1] - env.terrain.height(pads[:, 0])).min() > -0.01
        missed += abs(info["energy"]["residual"])
        work += abs(info["energy"]["motor_work"])
    assert info["x_position"] - start > 0.2  # 0.42 at least
    assert missed < 1e-3 * work


@pytest.mark.slow
@pytest.mark.parametrize(
    ("robot", "terrain", "low", "high"),
    # 60 falls each: 6, 4 and 36 get up, give or take two standard deviations
    [("paper", "flat", 0.0, 0.18), ("paper", "rough", 0.0, 0.15), ("holy", "rough", 0.47, 0.73)],
)
def test_a_fall_is_a_fall(robot, terrain, low, high):
    """Whichever criterion strikes first, the paper's robot hardly ever gets up, of 60 falls."""
    ground = jansen_env.Terrain.rough(np.random.default_rng(0), height=0.03)
    env = JansenWalkerEnv(
        robot=robot, terrain=ground if terrain == "rough" else terrain, terminate_when_fallen=False
    )
    rng = np.random.default_rng(0)
    falls, recovered, episode = 0, 0, 0

    def hold(seen, crank_speed, noise=0.0):
        share = (
            10.0 * (crank_speed - seen[SPEED]) + 1.5 * crank_speed
        ) / 20.0 + noise * rng.normal()
        return env.step(np.array([np.clip(share, -1.0, 1.0)]))

    while falls < 60:
        seen, _ = env.reset(seed=episode)
        episode += 1
        assert episode < 1000
        crank_speed, fallen, up, steps = rng.choice([2.0, 3.0, 10.0, -2.0, 12.0]), False, 0, 0
        while not fallen and steps < 500:
            seen, _, _, _, info = hold(seen, crank_speed, 0.3)
            fallen, steps = info["fallen"], steps + 1
        if not fallen:
            continue
        for step in range(400):
            seen = hold(seen, 0.0 if step < 100 else 3.0)[0]
            level = (
                abs(env.plant.state[2]) < 0.5
                and not env.task.world.plant.accumulators["non_toe_impulse"][0] > 0.0
            )
            up = up + 1 if level else 0
            if up > 50:
                recovered += 1
                break
        falls += 1
    print(f"{robot} on {terrain}: {recovered} of {falls} got up")
    assert low * falls <= recovered <= high * falls


@pytest.mark.parametrize("env_id", ["JansenWalker-v0", "JansenCrank-v0"])
def test_it_can_be_played(env_id):
    """By Gymnasium's own function, without further arguments: no key, then the right one."""
    env, torques = gym.make(env_id, render_mode="rgb_array"), []

    def callback(before, after, action, reward, terminated, truncated, info):
        torques.append(info["crank_torque"])
        if len(torques) == 2:
            pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=pygame.K_RIGHT))
        if len(torques) == 5:
            pygame.event.post(pygame.event.Event(pygame.QUIT))

    play(env, callback=callback, fps=1000)
    assert torques[:2] == [0.0, 0.0] and torques[-1] == env.unwrapped.torque_limit
    assert env.unwrapped.dt == env.unwrapped.control_dt


def test_parameters_can_be_changed():
    env = JansenWalkerEnv()
    env.set_parameters(friction=0.3, restitution=0.2, payload=1.5, speed_command=0.4)
    other = JansenWalkerEnv(friction=0.3, restitution=0.2, payload=1.5, speed_command=0.4)
    assert np.array_equal(env.reset(seed=3)[0], other.reset(seed=3)[0])
    for _ in range(20):
        assert env.step(np.ones(1))[1] == other.step(np.ones(1))[1]
    with pytest.raises(TypeError, match="terrain"):
        env.set_parameters(terrain="flat")
    with pytest.raises(ValueError, match="friction cannot be changed"):
        JansenWalkerEnv(plant="rigid_body").set_parameters(friction=0.3)
