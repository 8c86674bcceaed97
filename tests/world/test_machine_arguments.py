"""The environments' motor, delay and compliant feet: through all APIs, and on both plants."""

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from jansen_env import Compliance, Motor, paper_robot
from jansen_env.engine.records import UNKNOWN_DEFLECTION
from jansen_env.tasks.walking import JansenWalkerEnv

MOTOR = Motor(
    stall_torque=12.0,
    no_load_speed=7.0,
    torque_limit=8.0,
    gear_ratio=60.0,
    rotor_inertia=1.4e-5,
    friction=0.3,
    viscous_friction=0.02,
    efficiency=0.7,
)
FEET = Compliance(3e4, 60.0, 2e4, 40.0)
ROBOT = replace(paper_robot(), bearing_friction=(0.01,) * 10)
WALKER = "JansenWalker-v0"
CRANK = "JansenCrank-v0"


def actions(steps):
    """Half random, half driving on: (steps, 1)."""
    return np.random.default_rng(0).uniform(0.1, 0.9, (steps, 1)).astype(np.float32)


def episode(env, torques, **reset):
    """Information of each step of one robot."""
    env.reset(**reset)
    return [env.step(action)[4] for action in torques]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "plant"),
    [
        (WALKER, {"plant": "projection"}),
        (WALKER, {"plant": "rigid_body"}),
        (CRANK, {}),
    ],
)
def test_a_delay_of_control_steps_is_the_same_actions_later(name, plant):
    """Before them there is no torque.

    The delay is two steps, so that a torque on its way is not the newest.
    """
    env = gym.make(name, **plant)
    torques = actions(8)
    dt = env.unwrapped.control_dt
    late = episode(gym.make(name, delay=2 * dt, **plant), torques, seed=1)
    none = np.zeros((2, 1), np.float32)
    shifted = episode(env, np.concatenate([none, torques[:-2]]), seed=1)
    for delayed, other in zip(late, shifted, strict=True):
        for name in ("crank_torque", "crank_angle", "crank_speed"):
            assert delayed[name] == other[name]


@pytest.mark.parametrize("plant", ["projection", "rigid_body"])
def test_a_delay_within_a_control_step_switches_there(plant):
    """The mean torque is that of the old and the new one, each for its time."""
    env = gym.make(WALKER, delay=0.005, plant=plant)
    infos = episode(env, np.array([[0.2], [0.4], [0.1]]), seed=2)
    torques = [info["crank_torque"] for info in infos]
    assert torques == pytest.approx([0.75 * 4.0, 0.25 * 4.0 + 0.75 * 8.0, 0.25 * 8.0 + 0.75 * 2.0])


def test_a_delays_range_is_drawn_at_each_reset_and_can_be_set():
    env = gym.make(WALKER, delay=(0.0, 0.04))
    delays = []
    for _ in range(20):
        env.reset(seed=None if delays else 0)
        delays.append(env.unwrapped.get_state()["record"]["parameters"]["delay"])
    assert len(set(delays)) > 10 and 0.0 <= min(delays) < 0.01 and 0.03 < max(delays) <= 0.04
    env.reset(options={"delay": 0.02})
    assert env.unwrapped.get_state()["record"]["parameters"]["delay"] == 0.02
    with pytest.raises(ValueError, match=r"\['delay'\] must be between 0.0 and 0.04, got 0.1"):
        env.reset(options={"delay": 0.1})


def test_bristles_do_not_outlast_the_feet():
    env = JansenWalkerEnv(pad_compliance=FEET)
    episode(env, actions(10), seed=0)
    assert np.abs(env.get_state()["record"]["statistics"]["deflection"][:, 1]).max() > 0.0
    env.task.set_parameters(0, pad_compliance=Compliance())
    assert (env.get_state()["record"]["statistics"]["deflection"] == UNKNOWN_DEFLECTION).all()


def test_the_crank_task_has_the_motor():
    """A motor that friction holds does not turn the crank; one past its line turns it slower."""
    env = gym.make(CRANK, motor=replace(MOTOR, friction=50.0))
    still = {"crank_speed": 0.0}
    infos = episode(env, np.full((20, 1), 0.3, np.float32), seed=0, options=still)
    assert len({info["crank_angle"] for info in infos}) == 1
    assert {info["crank_speed"] for info in infos} == {0.0}
    assert gym.make(CRANK).unwrapped.torque_limit == 5.0
    assert gym.make(CRANK, motor="ideal").unwrapped.torque_limit == 20.0
    assert gym.make(CRANK, motor=MOTOR).unwrapped.torque_limit == 8.0
    assert gym.make(CRANK, motor=MOTOR, torque_limit=6.0).unwrapped.torque_limit == 6.0
