"""Whatever is passed to whatever argument: taken as documented, or refused by its name."""

import inspect
import math
import re
from decimal import Decimal
from fractions import Fraction

import gymnasium as gym
import numpy as np
import pytest

import jansen_env
from jansen_env import Bar, Leg, Noise, Payload, Push, Robot, Terrain, Triangle
from jansen_env.envs.arguments import OF_BATCHES
from jansen_env.robot import JANSEN, Linkage, Plate
from jansen_env.tasks.crank import JansenCrankEnv
from jansen_env.tasks.walking import JansenWalkerEnv, JansenWalkerVectorEnv
from jansen_env.terrain.generators import LEVELS, Curriculum
from jansen_env.world import settings as arguments

WRONG = {
    "None": None,
    "text": "x",
    "bytes": b"xy",
    "flag": True,
    "nan": math.nan,
    "inf": math.inf,
    "numpy nan": np.float32(math.nan),
    "beyond a float": 10**400,
    "beyond printing": 10**5000,
    "signalling nan": Decimal("sNaN"),
    "complex": 1.0 + 1.0j,
    "empty": [],
    "objects": [object(), object()],
    "mapping": {},
    "set": {0.0, 1.0},
    "no dimensions": np.array(math.nan),
    "array": np.full((2, 2), math.nan),
    "object": object(),
    "type": Bar,
    "other part": Leg("fore"),
}

NEEDED = {
    "slope": {"angle": 0.1},
    "rough": {"rng": np.random.default_rng(0)},
    "steps": {"rng": np.random.default_rng(0)},
}
"""Arguments that a terrain needs."""

MAKERS = {
    "Bar": (Bar, {"length": 1.0}),
    "Triangle": (Triangle, {"d": 0.1, "l": 0.1, "h": 0.1, "alpha": 2.0, "gamma": 2.0}),
    "from_sides": (
        Triangle.from_sides,
        {"first_second": 3.0, "second_third": 4.0, "third_first": 5.0},
    ),
    "Plate": (Plate, {"points": ((0.0, 0.0), (1.0, 0.0))}),
    "Linkage": (Linkage, {"bodies": JANSEN.bodies, "dyads": JANSEN.dyads, "toes": "T"}),
    "Leg": (Leg, {"side": "fore"}),
    "Payload": (Payload, {}),
    "Motor": (jansen_env.Motor, {}),
    "Compliance": (jansen_env.Compliance, {}),
    "Robot": (Robot, {}),
    "phased_legs": (jansen_env.phased_legs, {}),
    **{name: (make, {}) for name, make in jansen_env.ROBOTS.items()},
    "Terrain": (Terrain, {}),
    "flat": (Terrain.flat, {}),
    **{name: (getattr(Terrain, name), NEEDED.get(name, {})) for name in LEVELS},
    "curriculum": (Curriculum, {}),
    "Noise": (jansen_env.Noise, {}),
    "Push": (jansen_env.Push, {}),
    "walker": (JansenWalkerEnv, {}),
    "crank": (JansenCrankEnv, {}),
    "walkers": (JansenWalkerVectorEnv, {"num_envs": 2}),
}
"""What makes a thing, and the arguments that it needs."""

TAKEN = {
    ("*", "friction"): {"None"},
    ("*", "restitution"): {"None"},
    ("*", "payload"): {"None", "mapping"},
    ("*", "motor"): {"None", "mapping"},
    ("*", "time_step"): {"None"},
    ("*", "command_interval"): {"None"},
    ("*", "render_mode"): {"None"},
    ("*", "torque_limit"): {"None"},
    ("*", "pad_compliance"): {"None", "mapping"},
    ("*", "curriculum"): {"None"},
    ("*", "randomize"): {"None", "mapping"},
    ("*", "height_scan"): {"None"},
    ("*", "noise"): {"None", "mapping"},
    ("*", "push"): {"None", "mapping"},
    ("*", "terminate_when_fallen"): {"flag"},
    ("*", "fall_contact"): {"flag"},
    ("*", "mean_load_cost"): {"flag"},
    ("*", "track_joint_forces"): {"flag"},
    ("*", "observe_lengths"): {"flag"},
    ("*", "links_collide"): {"flag"},
    ("*", "torque_rate"): {"None"},
    ("*", "joint_play"): {"mapping"},
    ("walkers", "joint_play"): set(),
    ("crank", "time_step"): set(),
    ("walkers", "track_joint_forces"): set(),
    ("walkers", "max_episode_steps"): {"None"},
    ("walkers", "info_keys"): {"None", "empty"},
    ("walkers", "threads"): {"None", "beyond a float", "beyond printing"},
    ("Triangle", "outward"): {"flag"},
    ("from_sides", "outward"): {"flag"},
    ("Motor", "torque_limit"): set(),
    ("Motor", "friction"): set(),
    ("Motor", "stall_torque"): {"inf"},
    ("Motor", "no_load_speed"): {"inf"},
    ("Compliance", "stiffness"): {"inf"},
    ("Compliance", "tangential_damping"): {"None"},
    ("Compliance", "tangential_stiffness"): {"None", "inf"},
    ("Robot", "springs"): {"empty"},
    **{("Linkage", name): {"empty"} for name in ("pins", "damped", "bearings", "pads")},
}
"""Of the environments' arguments: those of WRONG that are right."""


def arguments_of(make):
    """Names of the arguments of a function, class or environment."""
    single = getattr(make, "SINGLE", make)
    known = single.defaults() if hasattr(single, "defaults") else {}
    vectors = OF_BATCHES if single is not make else ()
    named = () if known else inspect.signature(make).parameters.values()
    named = [p.name for p in named if p.kind is not inspect.Parameter.VAR_KEYWORD]
    return [*known, *vectors, *named]


CASES = [(maker, name) for maker, (make, _) in MAKERS.items() for name in arguments_of(make)]


@pytest.mark.parametrize(("maker", "argument"), CASES)
def test_wrong_values_are_refused_by_name(maker, argument):
    """All but a few raise ValueError with the argument's name and a message of a sane length."""
    make, needed = MAKERS[maker]
    environments = "walker", "crank", "walkers"
    shared = TAKEN.get(("*", argument), set()) if maker in environments else set()
    allowed = TAKEN.get((maker, argument), shared)
    for what, value in WRONG.items():
        if what in allowed:
            make(**{**needed, argument: value})
            continue
        with pytest.raises(ValueError) as error:
            make(**{**needed, argument: value})
            pytest.fail(f"took {what}")
        message = str(error.value)
        assert re.search(rf"(\b|_){argument}\b", message, re.IGNORECASE), (what, message)
        assert len(message) < 700, what


@pytest.mark.parametrize(
    ("make", "arguments", "message"),
    [
        (Curriculum, {"up": 1.5}, "up must be .*, got 1.5"),
        (Curriculum, {"down": -0.1}, "down must be .*, got -0.1"),
        (Curriculum, {"up": 0.2}, r"down must be at most up \(0\.2\), got 0\.25"),
        (Curriculum, {"highest": 10}, "highest must be .*, got 10"),
        (Curriculum, {"horizon": 0.0}, "horizon must be .*, got 0.0"),
        (Push, {"impulse": -1.0}, "Push.impulse must be 0 or above, got -1.0"),
        (Push, {"impulse": (1.0, 2.0, 3.0)}, "must be a number or two"),
        (Push, {"duration": 0.0}, "Push.duration must be between.*got 0.0"),
        (Push, {"duration": 2.0, "interval": 1.0}, "must be between 0.001 and 1.0"),
        (Noise, {"gyro": -0.1}, "Noise.gyro must be 0 or above, got -0.1"),
        (Noise, {"gyro": (0.1, 0.2, 0.3)}, "must be a number or two"),
        (Noise, {"gyro": (0.1, "much")}, "must be a finite number"),
        (
            Noise.only,
            {"lidar": 0.1},
            r"a key of noise must be one of \[.*'accelerometer'.*, got 'lidar'",
        ),
        (JansenWalkerEnv, {"noise": 0.1}, "must be None, a Noise or a dictionary with some of"),
        (
            JansenWalkerEnv,
            {"delay": 1.0, "control_dt": 1e-9, "time_step": 1e-9},
            r"delay must be at most 10000 times control_dt,.*, got 1\.0 s",
        ),
        (
            JansenCrankEnv,
            {"delay": (0.0, 1.0), "control_dt": 1e-9, "time_step": 1e-9},
            r"delay must be at most 10000 times control_dt,.*, got 1\.0 s",
        ),
    ],
)
def test_values_out_of_range_are_refused(make, arguments, message):
    with pytest.raises(ValueError, match=message):
        make(**arguments)


@pytest.mark.parametrize("kind", [Fraction, Decimal, np.float32, np.float16])
def test_every_kind_of_number_is_taken(kind):
    names = ("friction", "speed_command", "slip_weight", "torque_limit", "payload")
    seen = []
    made = []
    for half in (kind(0.5), 0.5):
        parts = Bar(half), Leg("fore", half), Payload(half, position=(half, half))
        made.append(repr([*parts, Terrain.flat(half), Terrain(((0, 0), (half, Fraction(0))))]))
        env = JansenWalkerEnv(**dict.fromkeys(names, half))
        seen.append([*env.reset(seed=0)[0], env.step(np.ones(1))[1]])
    assert made[0] == made[1] and seen[0] == seen[1]


@pytest.mark.parametrize("make", [JansenWalkerEnv, JansenCrankEnv, JansenWalkerVectorEnv])
@pytest.mark.parametrize(
    ("control_dt", "time_step", "named"),
    [
        (1e300, 1e-3, "control_dt must be at most 10000 times time_step, 0.001, got 1e[+]300"),
        (0.02, 1e-300, "time_step must be between 1e-09 and 1.0, got 1e-300"),
        (5e-324, 5e-324, "time_step must be .*, got 5e-324"),
        (1e300, 1e300, "time_step must be .*, got 1e[+]300"),
        (10.001, 1e-3, "control_dt must be at most.*got 10.001"),
        pytest.param(10**400, 1e-3, "control_dt must be .*, got 1000", id="period beyond a float"),
        pytest.param(0.02, 10**400, "time_step must be .*, got 1000", id="step beyond a float"),
        (0.0015, 1e-3, "control_dt must be a multiple of time_step, 0.001, got 0.0015"),
        (0.0005, 1e-3, "control_dt must be a multiple.*got 0.0005"),
    ],
)
def test_control_periods_that_never_end_are_refused(make, control_dt, time_step, named):
    with pytest.raises(ValueError, match=named):
        make(control_dt=control_dt, time_step=time_step)


def test_the_longest_control_period():
    """It is 10,000 time steps, of the backend's own length or of another; Decimals are exact."""
    assert arguments.control_period(10.0, 1e-3) == (10.0, 1e-3)
    assert arguments.control_period(Decimal("0.03"), Fraction(1, 1000)) == (0.03, 0.001)
    JansenWalkerEnv(control_dt=1e-4, time_step=1e-4, delay=1.0)
    assert JansenWalkerEnv(plant="rigid_body", control_dt=2.5).control_dt == 2.5
    with pytest.raises(ValueError, match=r"control_dt must be .*, got 3\.0"):
        JansenWalkerEnv(plant="rigid_body", control_dt=3.0)


@pytest.mark.parametrize("make", [JansenWalkerEnv, JansenCrankEnv])
def test_a_step_before_the_first_reset_is_refused(make):
    env, other = make(), make()
    with pytest.raises(gym.error.ResetNeeded, match="reset"):
        env.step(np.zeros(1))
    other.reset(seed=0)
    env.set_state(other.get_state())
    assert np.array_equal(env.step(np.zeros(1))[0], other.step(np.zeros(1))[0])


ACTIONS = ("x", None, [10**400], [[0.0]], [object()], {}, [], [math.inf], [math.nan], [0, 0])
SEEDS = ("ab", [0.5, 1], ["a", "b"], [1], -1, [-1, 0], {}, {1, 2})


@pytest.mark.parametrize("make", [JansenWalkerEnv, JansenCrankEnv])
def test_actions_seeds_and_options_that_are_none_are_refused(make):
    env = make()
    envs = JansenWalkerVectorEnv(2)
    env.reset(seed=0)
    for action in ACTIONS:
        with pytest.raises(ValueError, match="action must be one finite number"):
            env.step(action)
    for seed in SEEDS:
        with pytest.raises(ValueError, match="seed must be"):
            envs.reset(seed=seed)
    for options in (5, "speed_command", ["speed_command"], {1}):
        for each in (env, envs):
            with pytest.raises(ValueError, match=r"options must be a dict, got .*"):
                each.reset(options=options)
