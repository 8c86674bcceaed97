"""JansenWalker-v0 as a Gymnasium environment: contract, observation, state, falls, rendering."""

import math

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
    return gym.make("JansenWalker-v0")


def test_observation_is_the_documented_table(env):
    env.reset(seed=1, options={"speed_command": 0.4})
    for _ in range(20):
        obs, *_, info = env.step(np.array([0.2], np.float32))
    x, y, theta, psi, vx, vy, w, n = env.unwrapped.plant.state
    loads = info["contact_force"][:, 1] / env.unwrapped.weight
    height = y - float(env.unwrapped.terrain.height(x))
    expected = [
        math.cos(psi),
        math.sin(psi),
        n,
        math.sin(theta),
        math.cos(theta),
        w,
        vx,
        vy,
        height,
        0.4,
        *loads,
        0.2,
    ]
    kept = ("lag", "mean_speed", "mean_slip", "mean_power", "rms_torque")
    expected += [info[name] for name in kept]
    assert obs == pytest.approx(np.array(expected, np.float32), abs=1e-6)
    assert info["crank_torque"] == pytest.approx(0.2 * 20.0, rel=1e-6)


def test_loads_at_rest_carry_the_weight(env):
    for seed in range(10):
        obs, info = env.reset(seed=seed)
        assert obs[LOADS].sum() == pytest.approx(1.0, abs=1e-2)
        assert (info["contact_force"][:, 1] >= 0.0).all()


@pytest.mark.parametrize("robot", ["paper", "holy"])
def test_positive_actions_walk_forward(robot):
    """Negative actions walk backward, whichever way the crank has to turn; information is
    physical.
    """
    ends = []
    turns = math.copysign(1.0, advance_per_turn(jansen_env.ROBOTS[robot]()))
    for sign in (1.0, -1.0):
        env = JansenWalkerEnv(robot=robot, reset_noise_scale=0.0)
        start = 0.3 if sign > 0 else math.pi - 0.3
        observation, _ = env.reset(seed=0, options={"crank_angle": start})
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
        touched = False
        pitch = 0.0
        steps = 0
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
    """Garbage is never returned: the step does nothing, warns, and truncates; a reset
    repairs all.
    """
    env = JansenWalkerEnv(plant=plant, torque_limit=1e12)
    env.reset(seed=0)
    before = env.plant.state
    with pytest.warns(UserWarning, match="their simulation diverged"):
        observation, reward, terminated, truncated, info = env.step(np.array([1.0], np.float32))
    assert truncated and not terminated and info["diverged"] and np.isfinite(reward)
    assert np.isfinite(observation).all() and (env.plant.state == before).all()
    assert not info["slip"].any() and info["energy"]["motor_work"] == 0.0
    state = env.get_state()
    for begin in (lambda: env.reset(seed=0), lambda: env.set_state(state)):
        begin()
        assert not env.task.world.truncated.any() and not env.task.world.plant.diverged.any()
        *_, truncated, info = env.step(np.array([0.0], np.float32))
        assert not truncated and not info["diverged"]


@pytest.mark.parametrize("env_id", ["JansenWalker-v0", "JansenCrank-v0"])
def test_it_can_be_played(env_id):
    """Gymnasium's own function plays it without further arguments: no key, then the right one."""
    env = gym.make(env_id, render_mode="rgb_array")
    torques = []

    def callback(before, after, action, reward, terminated, truncated, info):
        torques.append(info["crank_torque"])
        if len(torques) == 2:
            pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=pygame.K_RIGHT))
        if len(torques) == 5:
            pygame.event.post(pygame.event.Event(pygame.QUIT))

    play(env, callback=callback, fps=1000)
    assert torques[:2] == [0.0, 0.0] and torques[-1] == env.unwrapped.torque_limit
    assert env.unwrapped.dt == env.unwrapped.control_dt
