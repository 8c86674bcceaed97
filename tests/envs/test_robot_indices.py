"""Positions of robots: checked first, and everywhere alike."""

from copy import deepcopy

import gymnasium as gym
import numpy as np
import pytest
from side_by_side import same

from jansen_env.sb3 import make_vec_env

WRONG = {
    "flag": True,
    "NumPy's flag": np.True_,
    "None": None,
    "slice": slice(0, 2),
    "float": 1.0,
    "NumPy's float": np.float64(1.0),
    "text": "1",
    "list": [0, 1],
    "array": np.array([0, 1]),
    "behind the last": 3,
    "NumPy's behind the last": np.int32(3),
    "before the first": -1,
    "beyond int64": 2**70,
}
WRONG_LISTS = {
    "twice": [1, 1],
    "twice in an array": np.array([2, 0, 2]),
    "mask": np.array([True, False, True]),
    "flags": [True, False],
    "slice": slice(0, 2),
    "floats": [0.0, 1.0],
    "array of floats": np.array([0.0]),
    "one behind the last": [0, 3],
    "one before the first": [0, -1],
    "None among them": [0, None],
    "nested": [[0, 1]],
    "text": "01",
    "flag": True,
    "float": 1.0,
    "behind the last": np.int64(3),
}
RIGHT = [1, np.int8(1), np.int32(1), np.int64(1), np.uint16(1)]
ONE = {
    "set_state": lambda envs, i, state: envs.set_state(i, state),
    "get_state": lambda envs, i, state: envs.get_state(i),
    "set_parameters": lambda envs, i, state: envs.set_parameters(i, command=0.1, friction=0.3),
    "push": lambda envs, i, state: envs.push(i, (1.0, 0.0)),
    "render": lambda envs, i, state: envs.call_one(i, "render"),
    "call_one": lambda envs, i, state: envs.call_one(i, "set_parameters", friction=0.3),
    "task.set_state": lambda envs, i, state: envs.task.set_state(i, state),
    "task.get_state": lambda envs, i, state: envs.task.get_state(i),
    "task.set_parameters": lambda envs, i, state: envs.task.set_parameters(i, friction=0.3),
    "task.checked": lambda envs, i, state: envs.task.checked(i, friction=0.3)(),
    "task.push": lambda envs, i, state: envs.task.push(i, (1.0, 0.0)),
}
"""Calls for robot i; ``state`` is another one than it has."""
SOME = {
    "get_attr": lambda venv, indices: venv.get_attr("friction", indices),
    "set_attr": lambda venv, indices: venv.set_attr("friction", 0.3, indices),
    "env_method": lambda venv, indices: venv.env_method("push", (1.0, 0.0), indices=indices),
    "env_method set_parameters": lambda venv, indices: venv.env_method(
        "set_parameters", friction=0.3, indices=indices
    ),
    "get_wrapper_attr": lambda venv, indices: venv.env_method(
        "get_wrapper_attr", "friction", indices=indices
    ),
    "env_is_wrapped": lambda venv, indices: venv.env_is_wrapped(gym.Wrapper, indices),
}
"""Calls for some robots of a ``VecEnv`` of Stable-Baselines3."""


@pytest.fixture(scope="module")
def made():
    """Three robots, and another state of the second one."""
    envs = gym.make_vec("JansenWalkerBuilt-v0", 3, render_mode="rgb_array").unwrapped
    envs.reset(seed=9)
    other = envs.get_state(1)
    envs.reset(seed=1)
    for _ in range(3):
        envs.step(np.full((3, 1), 0.3, np.float32))
    return envs, other


@pytest.fixture
def robots(made):
    return deepcopy(made[0]), made[1]


def states(envs):
    return {str(i): envs.get_state(i) for i in range(3)}


@pytest.mark.parametrize("what", WRONG)
@pytest.mark.parametrize("call", ONE)
def test_a_wrong_position_is_refused_and_nothing_changes(call, what, robots):
    envs, other = robots
    before = states(envs)
    with pytest.raises(
        ValueError, match=r"^robot index must be a whole number from 0 to 2, got .*"
    ):
        ONE[call](envs, WRONG[what], other)
    assert same(states(envs), before)


@pytest.mark.parametrize("call", ONE)
def test_every_whole_number_is_taken(call, robots):
    """Python's and NumPy's whole numbers have the same effect."""
    ends = []
    for i in RIGHT:
        envs = deepcopy(robots[0])
        ONE[call](envs, i, robots[1])
        ends.append(states(envs))
    assert all(same(end, ends[0]) for end in ends)
    assert "get" in call or call == "render" or not changes_nothing(ends[0], robots[0])


def changes_nothing(end, envs):
    """Whether robots still have the states of ``envs``."""
    try:
        return same(end, states(envs))
    except AssertionError:
        return False


@pytest.mark.parametrize("what", WRONG_LISTS)
@pytest.mark.parametrize("call", SOME)
def test_wrong_positions_of_stable_baselines3_are_refused_and_nothing_changes(call, what):
    venv = make_vec_env("JansenWalkerBuilt-v0", 3, seed=1)
    venv.reset()
    before = states(venv.env)
    with pytest.raises(ValueError, match=r"^robot ind(ex|ices) must be .*, got"):
        SOME[call](venv, WRONG_LISTS[what])
    assert same(states(venv.env), before)


@pytest.mark.parametrize(
    "indices", [[2, 0], (2, 0), np.array([2, 0], np.int32), np.array([2, 0]), range(2, -1, -2)]
)
def test_positions_of_stable_baselines3_are_lists_of_whole_numbers(indices):
    venv = make_vec_env("JansenWalkerBuilt-v0", 3, env_kwargs={"friction": 0.4})
    venv.set_attr("friction", 0.9, indices)
    assert venv.get_attr("friction") == [0.9, 0.4, 0.9]
    assert venv.env_method("get_wrapper_attr", "friction", indices=np.int64(1)) == [0.4]
    venv.set_attr("friction", 0.8, [])
    venv.set_attr("friction", 0.7, np.int16(1))
    assert venv.get_attr("friction", indices) == [0.9, 0.9]
    assert venv.get_attr("friction") == [0.9, 0.7, 0.9]


def test_states_and_seeds_of_another_number_of_robots_are_refused():
    venv = make_vec_env("JansenWalkerBuilt-v0", 3, seed=1)
    venv.reset()
    before = states(venv.env)
    given = venv.get_states()
    venv.step(np.full((3, 1), 0.3, np.float32))
    after = states(venv.env)
    wrong = [given[:2], [*given, given[0]], [given[0], {**given[1], "elapsed": -1}, given[2]]]
    for some in wrong:
        with pytest.raises(ValueError, match=r"states must have|elapsed must be"):
            venv.set_states(some)
        assert same(states(venv.env), after)
    venv.set_states(given)
    assert same(states(venv.env), before)
    for seeds, options in (([1], [{}] * 3), ([None] * 3, [{}] * 2)):
        with pytest.raises(ValueError, match="must have 3 entries, got"):
            venv.env.reset_each(seeds, options)
    with pytest.raises(ValueError, match=r"reset_mask"):
        venv.env.reset_each([None] * 3, [{}] * 3, np.ones(2, bool))
    assert same(states(venv.env), before)


ACTIONS = {
    "text": lambda action: action.astype(str),
    "texts in lists": lambda action: action.astype(str).tolist(),
    "bytes": lambda action: action.astype(bytes),
    "complex": lambda action: action.astype(complex),
    "complex in lists": lambda action: action.astype(complex).tolist(),
    "dates": lambda action: action.astype("M8[s]"),
    "durations": lambda action: action.astype("m8[s]"),
    "objects": lambda action: action.astype(object),
    "masked": lambda action: np.ma.masked_array(action, mask=True),
    "masked, no mask": lambda action: np.ma.masked_array(action),
    "masked in a list": lambda action: [np.ma.masked_array(part, mask=True) for part in action],
    "flags": lambda action: action.astype(bool),
    "a record": lambda action: action.view([("torque", action.dtype)]),
    "None": lambda action: None,
    "mapping": lambda action: dict(enumerate(action)),
}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("kind", ACTIONS)
def test_actions_that_are_no_real_numbers_are_refused_and_nothing_changes(kind, made):
    envs = deepcopy(made[0])
    single = gym.make("JansenCrank-v0").unwrapped
    single.reset(seed=0)
    before = states(envs)
    alone = single.get_state()
    wrong = ACTIONS[kind]
    with pytest.raises(ValueError, match=r"(?s)^actions must be numbers, shape \(3, 1\), got "):
        envs.step(wrong(np.ones((3, 1))))
    with pytest.raises(ValueError, match=r"(?s)^action must be one finite number, .*got"):
        single.step(wrong(np.ones(1)))
    venv = make_vec_env("JansenWalkerBuilt-v0", 3)
    venv.reset()
    with pytest.raises(ValueError, match=r"^actions must be numbers"):
        venv.step(wrong(np.ones((3, 1))))
    assert same(states(envs), before) and same(single.get_state(), alone)


@pytest.mark.parametrize("kind", ["f2", "f4", "f8", "g", "i1", "i8", "u4", ">f4", list])
def test_actions_of_every_kind_of_real_number_are_taken(kind, made):
    action = np.ones((3, 1))
    other = action.tolist() if kind is list else action.astype(kind)
    first, second = (deepcopy(made[0]).step(each)[0] for each in (action, other))
    assert (first == second).all()
