"""What a user gives is what an environment has, whatever its preset draws.

``CASES`` has every argument of every environment; a new argument needs an entry there.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from jansen_env import Compliance, Noise, Payload, Push
from jansen_env.plants.parameters import ARGUMENTS, PARAMETERS
from jansen_env.registration import IDS
from jansen_env.robot import ROBOTS
from jansen_env.robot.lengths import lengths
from jansen_env.robot.motor import MOTORS
from jansen_env.sb3 import BatchVecEnv, make_vec_env
from jansen_env.scoring.benchmarks import single_env
from jansen_env.tasks.task import Task
from jansen_env.terrain import make_terrain
from jansen_env.terrain.generators import Curriculum

HARDCORE = "JansenWalkerHardcore-v0"


@dataclass
class Case:
    """An argument that is given.

    Attributes:
        value: The argument's value.
        shown: What an environment shows of robot i, called with its task, i and the robot's
            information after a step.
        expected: What it must show; by default the value.
        needs: Further arguments, without which the value would be refused.
    """

    value: Any
    shown: Callable[[Any, int, dict[str, Any]], Any]
    expected: Any = None
    needs: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self):
        if self.expected is None:
            self.expected = self.value


def attribute(name):
    """What ``get_attr`` tells of robot i."""
    return lambda task, i, info: task.world.get_attr(name)[i]


def parameter(name):
    """What ``get_attr`` tells of robot i, and the information if it has the parameters."""

    def shown(task, i, info):
        value = task.world.get_attr(name)[i]
        if name == "payload":
            row = task.world.records.parameters[i]
            value = Payload(row["payload"], position=(row["payload_x"], row["payload_y"]))
            assert task.world.robots[i].payload == value
        elif "parameters" in info:
            assert info["parameters"][name] == value
        return value

    return shown


def columns(task, i, info):
    """Return how many observations there are of each of two kinds."""
    names = [name.rpartition("_")[0] for name in task.columns]
    return names.count("height_scan"), names.count("acceleration")


def weight(factor, value=0.0, at_zero=1.0):
    """A weight of 0, which leaves a factor of the reward out."""
    return Case(value, lambda task, i, info: abs(info[f"reward/{factor}"]), at_zero)


CASES = {
    "robot": Case(
        "holy", lambda task, i, info: lengths(task.world.robots[i]), lengths(ROBOTS["holy"]())
    ),
    "payload": Case(Payload(1.5, position=(0.02, 0.01)), parameter("payload")),
    "motor": Case("mx_106", attribute("motor"), MOTORS["mx_106"]),
    "torque_limit": Case(7.5, attribute("torque_limit")),
    "pad_compliance": Case(Compliance(3e4, 60.0), attribute("pad_compliance")),
    "delay": Case(0.01, attribute("delay")),
    "control_dt": Case(0.025, lambda task, i, info: task.control_dt),
    "time_step": Case(0.0005, lambda task, i, info: task.world.time_step),
    "plant": Case("rigid_body", lambda task, i, info: info["joint_gap"] > 0.0, True),
    "links_collide": Case(True, lambda task, i, info: not task.world.plant.knows_joint_forces),
    "joint_play": Case(
        {"A": 2e-4},
        lambda task, i, info: info["joint_gap"] > 1.5e-4,
        True,
        needs={"plant": "rigid_body"},
    ),
    "backlash": Case(
        0.01,
        lambda task, i, info: task.world.plant.backlash,
        needs={"plant": "rigid_body", "motor": "ak80_6"},
    ),
    "terrain": Case(
        "slope:0.1",
        lambda task, i, info: task.world.terrain(i).points,
        make_terrain("slope:0.1").points,
    ),
    "friction": Case(0.37, parameter("friction")),
    "restitution": Case(0.3, parameter("restitution"), needs={"robot": "paper"}),
    "terrain_level": Case(3, parameter("terrain_level"), needs={"terrain": "mixed"}),
    "curriculum": Case(
        Curriculum(up=0.9),
        lambda task, i, info: task.world.episodes.curriculum,
        needs={"terrain": "mixed"},
    ),
    "randomize": Case(
        {"lengths": {"crank": (1.01, 1.01)}},
        lambda task, i, info: [*task.world.lengths.changed[i]],
        ["crank"],
    ),
    "reset_noise_scale": Case(0.0, attribute("reset_noise_scale")),
    "torque_rate": Case(1.0, lambda task, i, info: task.world.action[i] < 0.1, True),
    "observe": Case("onboard", lambda task, i, info: columns(task, i, info)[1], 2),
    "height_scan": Case((0.1, 0.1, 3), lambda task, i, info: columns(task, i, info)[0], 3),
    "noise": Case(Noise.only(height=0.1), lambda task, i, info: task.world._noise),
    "push": Case(
        Push(0.5, duration=0.2),
        lambda task, i, info: task.world.pushes.settings[0].item(),
        (0.5, 0.0, 0.2, 5.0, 0.001),
    ),
    "observe_lengths": Case(True, lambda task, i, info: "length_crank" in task.columns),
    "track_joint_forces": Case(True, lambda task, i, info: "joint_force_max" in info),
    "render_mode": Case("rgb_array", lambda task, i, info: None),
    "speed_command": Case(0.33, lambda task, i, info: info["speed_command"]),
    "command_interval": Case(
        0.4, lambda task, i, info: task.data["command_steps"][i] * task.control_dt
    ),
    "slip_weight": weight("slip"),
    "energy_weight": weight("energy"),
    "effort_weight": weight("effort"),
    "smoothness_weight": weight("smoothness"),
    "posture_weight": weight("posture"),
    "load_weight": weight("load"),
    "mean_load_cost": Case(
        True, lambda task, i, info: task.world.reward_settings["mean_load_cost"][0]
    ),
    "fall_pitch": Case(1e-6, lambda task, i, info: info["fallen"], True),
    "fall_contact": Case(
        False, lambda task, i, info: task.world.reward_settings["fall_contact"][0]
    ),
    "terminate_when_fallen": Case(
        False, lambda task, i, info: bool(task.ended[i]), needs={"fall_pitch": 1e-6}
    ),
    "arrival_weight": Case(3.0, lambda task, i, info: task.arrival_weight),
    "tracking_weight": weight("tracking", at_zero=0.0),
    "torque_weight": weight("torque", at_zero=0.0),
}

GIVEN = [
    pytest.param(env_id, name, id=f"{env_id} {name}")
    for env_id in IDS
    for name in single_env(env_id).defaults()
    if name != "curriculum" or single_env(env_id).TASK.progress is not Task.progress  # refused
]


def settings_of(env_id):
    return single_env(env_id).TASK.SETTINGS


def check(case, task, i, info):
    shown = case.shown(task, i, info)
    if isinstance(shown, float):
        assert shown == pytest.approx(case.expected, rel=1e-12)
    elif shown is not None:
        assert shown == case.expected


def step(env, count):
    """Reset and take a step; return the information of each robot."""
    env.reset(seed=7)
    shape = (1,) if count is None else (count, 1)
    env.step(np.full(shape, 0.6, np.float32))
    information = env.unwrapped.task.information
    return [information.single(i) for i in range(count or 1)]


def test_every_argument_has_a_case():
    arguments = {name for env_id in IDS for name in single_env(env_id).defaults()}
    assert arguments == {*CASES}, "CASES needs a Case for each argument of a task"


@pytest.mark.parametrize(("env_id", "name"), GIVEN)
def test_what_is_given_is_what_is_shown(env_id, name):
    """This holds for one robot and, where possible, for many with one value for all."""
    case = CASES[name]
    arguments = {**case.needs, name: case.value}
    env = gym.make(env_id, **arguments)
    check(case, env.unwrapped.task, 0, step(env, None)[0])
    if name in settings_of(env_id).defaults("single_only"):
        return
    envs = gym.make_vec(env_id, 2, **arguments)
    for i, info in enumerate(step(envs, 2)):
        check(case, envs.unwrapped.task, i, info)


@pytest.mark.parametrize(
    ("env_id", "name"),
    [each for each in GIVEN if each.values[1] in settings_of(each.values[0]).defaults("several")],
)
def test_what_is_given_to_one_robot_leaves_the_others(env_id, name):
    """In a list None leaves the environment's own value, as variants leave what they do not name.

    Robot 1 starts as a single environment without the argument, bit for bit.
    """
    case = CASES[name]
    own = {} if name == "randomize" else None  # of which None draws nothing
    listed = gym.make_vec(env_id, 2, **case.needs, **{name: [case.value, own]})
    variants = [{name: case.value}, {}]
    venv = make_vec_env(env_id, 2, seed=7, env_kwargs=case.needs, variants=variants)
    assert isinstance(venv.unwrapped, BatchVecEnv)
    check(case, listed.unwrapped.task, 0, step(listed, 2)[0])
    started, _ = listed.reset(seed=7)
    together = venv.reset()
    alone = gym.make(env_id, **case.needs, **({name: {}} if name == "randomize" else {}))
    assert np.array_equal(started[1], alone.reset(seed=8)[0])
    alone = gym.make(env_id, **case.needs)
    assert np.array_equal(together[1], alone.reset(seed=8)[0])
    venv.step(np.full((2, 1), 0.6, np.float32))
    check(case, venv.env.task, 0, venv.env.task.information.single(0))


@pytest.mark.parametrize(
    ("name", "parameter_name"),
    [*((name, name) for name in ARGUMENTS), ("payload", "payload_x"), ("payload", "payload_y")],
)
def test_what_is_given_and_drawn_by_the_user_is_refused(name, parameter_name):
    """Both are named. What agrees is taken, and so is another parameter."""
    value = CASES[name].value
    row = PARAMETERS[parameter_name]
    same = {"payload": 1.5, "payload_x": 0.02, "payload_y": 0.01}.get(parameter_name, value)
    other = 4 if row.whole else same + 0.05
    needs = CASES[name].needs
    message = rf"^{name} is .* and randomize has '{parameter_name}'"
    for drawn in (other, (same, other)):
        given = {**needs, name: value, "randomize": {parameter_name: drawn}}
        for make in (gym.make, lambda *a, **k: gym.make_vec(*a, 2, **k)):
            with pytest.raises(ValueError, match=message):
                make(HARDCORE, **given)
    assert gym.make(HARDCORE, **{**given, "randomize": {parameter_name: same}})


def test_a_curriculum_and_a_drawn_level_are_refused():
    given = {"terrain": "mixed", "randomize": {"terrain_level": (0, 3)}}
    gym.make("JansenWalker-v0", **given)
    with pytest.raises(ValueError, match=r"^curriculum is .* and randomize has 'terrain_level'"):
        gym.make("JansenWalker-v0", **given, curriculum=True)


def test_what_is_set_replaces_what_a_preset_draws():
    """For one robot, in this episode and later ones; what the user draws is still drawn."""
    envs = gym.make_vec(HARDCORE, 2).unwrapped
    envs.reset(seed=1)
    envs.set_parameters(0, friction=0.5, delay=0.01, payload=1.0, motor_strength=0.9)
    for seed in (2, 3):
        drawn = envs.reset(seed=seed)[1]["parameters"]
        assert drawn["friction"][0] == 0.5 and drawn["delay"][0] == 0.01
        assert drawn["motor_strength"][0] == 0.9
        assert [drawn[f"payload{end}"][0] for end in ("", "_x", "_y")] == [1.0, 0.0, 0.0]
        assert drawn["friction"][1] != 0.5 and drawn["delay"][1] != 0.01
    env = gym.make("JansenWalker-v0", randomize={"friction": (0.6, 0.7)}).unwrapped
    env.reset(seed=1)
    env.set_parameters(friction=0.5)
    assert env.task.world.get_attr("friction") == [0.5]
    assert 0.6 < env.reset(seed=2)[1]["parameters"]["friction"] < 0.7


@pytest.mark.parametrize(("name", "drawn"), [("delay", (0.0, 0.02)), ("terrain_level", (0, 3))])
def test_a_later_value_that_the_users_own_draw_would_undo_is_refused(name, drawn):
    env = gym.make("JansenWalker-v0", terrain="mixed", randomize={name: drawn}).unwrapped
    env.reset(seed=1)
    with pytest.raises(ValueError, match=rf"^{name} is .* and randomize has '{name}'"):
        env.set_parameters(**{name: 0})
