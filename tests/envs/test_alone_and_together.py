"""A robot of a batch does what it does alone, bit for bit, through falls, time limits and resets.

``CASES`` has robots of every environment and of all that may differ between robots; each case is
compared through Gymnasium's vector interface and through Stable-Baselines3's.
"""

from dataclasses import dataclass, field
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from courses import COURSE, WALL
from gymnasium.vector import AutoresetMode
from side_by_side import ROUGH, compare, compare_for_sb3
from stable_baselines3.common.vec_env import DummyVecEnv

from jansen_env import Compliance, Motor, Payload, Terrain, paper_robot
from jansen_env.registration import IDS
from jansen_env.sb3 import BatchVecEnv, make_vec_env
from jansen_env.scoring.benchmarks import vector_env
from jansen_env.scoring.rollout import make_env

WALKER = "JansenWalker-v0"


@dataclass(frozen=True)
class Case:
    """Robots of one environment.

    Attributes:
        env_id: Id of the environment.
        arguments: Arguments that all robots have.
        each: Further arguments of the robots; they are used again where there are more robots.
        count: Number of robots.
        steps: Number of steps.
        actions: Range from which actions are sampled.
        falls: Least number of episodes that end with a fall.
        ends: Least number of episodes that end.
    """

    env_id: str = WALKER
    arguments: dict[str, Any] = field(default_factory=dict)
    each: list[dict[str, Any]] = field(default_factory=lambda: [{}])
    count: int = 5
    steps: int = 130
    actions: tuple[float, float] = (-1.0, 1.0)
    falls: int = 0
    ends: int = 15


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
OWN = [
    {
        "terrain": "flat",
        "restitution": 0.0,
        "payload": 0.0,
        "friction": 0.2,
        "speed_command": (0.1, 0.1),
        "command_interval": 0.4,
        "motor": MOTOR,
        "pad_compliance": FEET,
        "torque_limit": 8.0,
        "delay": (0.0, 0.0),
    },
    {
        "terrain": ROUGH,
        "restitution": 0.4,
        "payload": 3.0,
        "friction": 0.8,
        "speed_command": (-0.2, 0.3),
        "command_interval": 0.1,
        "motor": "ideal",
        "pad_compliance": Compliance(),
        "torque_limit": 15.0,
        "delay": (0.013, 0.013),
    },
    {
        "terrain": "slope:0.1",
        "restitution": 0.0,
        "payload": Payload(1.0, 0.1, (0.2, 0.1)),
        "friction": 1.0,
        "speed_command": (0.05, 0.8),
        "command_interval": None,
        "motor": MOTOR,
        "pad_compliance": FEET,
        "torque_limit": 5.0,
        "delay": (0.0, 0.05),
    },
]
"""All arguments that may differ between robots."""
VARIANTS = [
    {"max_episode_steps": 30, "reset_noise_scale": 4.0, "command_interval": 0.1},
    {
        "max_episode_steps": 100,
        "speed_command": (0.05, 0.25),
        "terrain": "slope:-0.6",
        "payload": 2.0,
    },
    {
        "max_episode_steps": 100,
        "speed_command": (0.3, 0.3),
        "friction": 0.3,
        "terrain": Terrain(((-1, 0), (0.5, 0.02), (1, 0))),
    },
]
"""Robots that leave out some arguments, as variants of a configuration do."""
SHAPES = {
    "rigid feet": {},
    "compliant feet": {"pad_compliance": Compliance(2e4, 50.0)},
    "senses": {
        "noise": {},
        "push": {"impulse": (1.0, 0.5)},
        "observe": "onboard",
        "delay": (0, 0.03),
    },
}
LENGTHS = {
    "max_episode_steps": 20,
    "observe_lengths": True,
    "randomize": {"lengths": {"coupler": (0.95, 1.1), "upper_rod": 0.03}},
}


def walkers(limit, **arguments):
    """Robots of the walker, which fall under random torque, with a time limit in steps."""
    return Case(arguments={"max_episode_steps": limit, **arguments})


def on_course(**arguments):
    """Three robots on the course of shapes."""
    arguments = {"max_episode_steps": 25, **arguments}
    return Case(arguments=arguments, count=3, steps=60, ends=6)


def variants(noise):
    shared = {"slip_weight": 2.0, "noise": noise}
    return Case(arguments=shared, each=VARIANTS, count=6, steps=200, falls=2, ends=12)


CASES = {
    **{
        env_id: Case(
            env_id, {"max_episode_steps": 30}, count=4, steps=100, actions=(-0.6, 0.6), ends=12
        )
        for env_id in IDS
    },
    "ten legs": walkers(40, robot=paper_robot(phases=5), control_dt=0.03, time_step=0.0015),
    "lying on their bumpers": walkers(40, terrain="slope:-0.5", terminate_when_fallen=False),
    "rough terrain": walkers(40, terrain=ROUGH, slip_weight=3.0, command_interval=0.1),
    "onboard": walkers(40, observe="onboard", noise={}, delay=(0.0, 0.03), torque_rate=400.0),
    "everything of their own": Case(
        arguments={"max_episode_steps": 50}, each=OWN, count=3, steps=120, ends=6
    ),
    "variants": variants(noise=None),
    "noisy variants": variants(noise={}),
    **{f"shapes, {name}": on_course(terrain=COURSE, **SHAPES[name]) for name in SHAPES},
    "shapes beside height lines": Case(
        arguments={"max_episode_steps": 25},
        each=[{"terrain": COURSE}, {"terrain": "slope:0.1"}, {"terrain": Terrain.flat()}],
        count=3,
        steps=60,
        ends=6,
    ),
}
CLIMBER = {"robot": "climber", "terrain": WALL, "speed_command": 0.4}
CASES |= {
    f"a climber, links_collide={collide}": Case(
        "JansenWalkerBuilt-v0",
        {**CLIMBER, "links_collide": collide},
        count=2,
        steps=150,
        actions=(0.4, 0.4),
        ends=0,
    )
    for collide in (True, False)
}
SLOW = {
    f"sampled lengths, {env_id}": Case(env_id, LENGTHS, steps=45, actions=(-0.6, 0.6), ends=10)
    for env_id in (WALKER, "JansenWalkerHardcore-v0", "JansenGoal-v0", "JansenCrank-v0")
}
MODES = {"next step": AutoresetMode.NEXT_STEP, "same step": AutoresetMode.SAME_STEP}


def listed(values):
    """Values of the robots: an array of numbers or of ranges, else a list."""
    array = np.array(values, object)
    return np.array(values) if all(isinstance(x, (int, float)) for x in array.flat) else values


def compare_vectors(case, mode):
    """Compare Gymnasium's vector environments."""
    rows = [case.each[i % len(case.each)] for i in range(case.count)]
    names = {name: None for row in rows for name in row}
    lists = {name: listed([row.get(name) for row in rows]) for name in names}
    together = gym.make_vec(case.env_id, case.count, autoreset_mode=mode, **case.arguments, **lists)
    alone = gym.vector.SyncVectorEnv(
        [lambda row=row: gym.make(case.env_id, **{**case.arguments, **row}) for row in rows],
        autoreset_mode=mode,
    )
    assert isinstance(together.unwrapped, vector_env(case.env_id))
    assert together.single_observation_space == alone.single_observation_space
    return compare(together, alone, case.steps, actions=case.actions)


def compare_vec_envs(case):
    """Compare ``VecEnv`` of Stable-Baselines3."""
    together = make_vec_env(
        case.env_id, case.count, env_kwargs=case.arguments, variants=case.each, info_keys=None
    )
    rows = [{**case.arguments, **case.each[i % len(case.each)]} for i in range(case.count)]
    alone = DummyVecEnv([lambda row=row: make_env(case.env_id, row) for row in rows])
    assert isinstance(together.unwrapped, BatchVecEnv)
    return compare_for_sb3(together, alone, case.steps, actions=case.actions)


@pytest.mark.parametrize("api", [*MODES, "Stable-Baselines3"])
@pytest.mark.parametrize(
    "name", [*CASES, *(pytest.param(name, marks=pytest.mark.slow) for name in SLOW)]
)
def test_a_robot_of_a_batch_does_what_it_does_alone(name, api):
    """Observations, rewards, ends and information of each step are the same."""
    case = {**CASES, **SLOW}[name]
    if api == "Stable-Baselines3":
        falls, limits = compare_vec_envs(case)
    else:
        falls, limits = compare_vectors(case, MODES[api])
    assert falls + limits >= case.ends and falls >= case.falls


@pytest.mark.parametrize("env_id", [WALKER, "JansenCrank-v0"])
def test_joint_forces_are_those_of_a_single_environment_after_a_restart(env_id):
    arguments = {"track_joint_forces": True, "max_episode_steps": 5}
    alone = gym.vector.SyncVectorEnv([lambda: gym.make(env_id, **arguments)])
    assert sum(compare(gym.make_vec(env_id, 1, **arguments), alone, 60)) == 10
