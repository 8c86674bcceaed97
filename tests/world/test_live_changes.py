"""A robot changed and pushed while it walks: as if a state with that had been put in."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from side_by_side import same, together, walk

from jansen_env import Compliance, Motor, Push

FEET = {"pad_compliance": Compliance(20_000.0, 20.0)}
HEAVY = {"mass_scale": (1.0, 3.0)}
SOFT = {"pad_compliance": Compliance(2000.0, 20.0)}


def begun(**arguments):
    """A robot that has walked a little."""
    env = gym.make("JansenWalker-v0", speed_command=0.3, **arguments).unwrapped
    env.reset(seed=1)
    walk(env, 10)
    return env


@pytest.mark.slow
def without_info(state):
    """Return a saved state without the information on the last step, which no later step reads."""
    record = {name: value for name, value in state["record"].items() if name != "info"}
    return {**state, "record": record}


@pytest.mark.parametrize(
    ("name", "value", "arguments"),
    [
        ("tilt", 0.1, {}),
        ("motor_strength", 0.5, FEET),
        ("mass_scale", 1.5, {}),
        ("damping_scale", 3.0, {}),
        ("friction", 0.2, {"track_joint_forces": True}),
        ("tilt", 0.1, {"plant": "rigid_body"}),
    ],
)
def test_changed_is_as_if_the_state_had_it(name, value, arguments):
    steps = 2 if "plant" in arguments else 30
    changed, other = (begun(**arguments) for _ in range(2))
    before = walk(begun(**arguments), steps)
    state = other.get_state()
    state["record"]["parameters"][name] = value
    changed.set_parameters(**{name: value})
    other.set_state(state)
    assert same(without_info(changed.get_state()), without_info(other.get_state()))
    walked = walk(changed, steps)
    np.testing.assert_array_equal(walked, walk(other, steps))
    assert not np.array_equal(walked, before)
    assert changed.parameters[[*state["record"]["parameters"]].index(name)] == value
    changed.reset(seed=2)  # and so it stays
    assert changed.get_state()["record"]["parameters"][name] == value


@pytest.mark.parametrize("change", [{"motor": Motor(torque_limit=3.0)}, FEET, {"payload": 1.0}])
def test_a_state_has_the_robot_that_was_changed(change):
    """Another environment goes on from it, and a state from before brings back what was."""
    changed, other = begun(), begun()
    before = changed.get_state()
    robot = changed.robot
    changed.set_parameters(**change)
    other.set_state(changed.get_state())
    np.testing.assert_array_equal(walk(changed), walk(other))
    assert other.robot == changed.robot != robot
    changed.set_state(before)
    other.set_state(before)
    assert changed.robot == other.robot == robot
    np.testing.assert_array_equal(walk(changed), walk(other))


@pytest.mark.parametrize(
    ("arguments", "change", "message"),
    [
        ({}, {"tilt": 9.0}, "tilt must be.*got 9.0"),
        ({}, {"motor_strength": 0.0}, "motor_strength must be .*, got 0.0"),
        (
            {"plant": "rigid_body"},
            {"pad_compliance": Compliance(1e9)},
            "time_step must be .* 0.00025",
        ),
        (
            {},
            {"rotor_inertia_scale": 2.0},
            "a key of changes must be .* an effect here, .*, got 'rotor_inertia_scale'",
        ),
        (
            {"robot": "built", "randomize": {"rotor_inertia_scale": (0.5, 2.0)}},
            {"motor": Motor()},
            "a key of randomize must be .* an effect here, .*, got 'rotor_inertia_scale'",
        ),
        (FEET, {"restitution": 0.5}, r"restitution must be .*, got 0\.5"),
        ({"robot": "built"}, {"payload": 1e6}, "stiffness must be at least.*got .*"),
        (FEET, {"pad_compliance": Compliance(100.0, 20.0)}, "stiffness must be at least.*got .*"),
        (FEET, {**SOFT, "payload": 8.0}, "stiffness must be at least.*got .*"),
        ({**FEET, "randomize": HEAVY}, SOFT, "stiffness must be at least.*got .*"),
        ({**FEET, "randomize": HEAVY}, {"payload": 100.0}, "stiffness must be at least.*got .*"),
    ],
)
def test_refused(arguments, change, message):
    """Nothing changes; feet must bear this episode and those to come."""
    env = begun(**arguments)
    before = repr(env.get_state()), env.robot
    with pytest.raises(ValueError, match=message):
        env.set_parameters(**change, friction=0.1)
    assert (repr(env.get_state()), env.robot) == before
    for seed in range(5):
        env.reset(seed=seed)


def test_energies_of_steps_are_closed_whatever_changes_between_them():
    for change in ({"payload": 3.0}, {"tilt": 0.2}, {"mass_scale": 2.0}, {"restitution": 0.5}):
        env = begun()
        env.set_parameters(**change)
        for _ in range(30):
            energy = env.step(np.array([0.3], np.float32))[4]["energy"]
            assert abs(energy["residual"]) < 1e-3, change  # J; 3 kg weigh 30 N


@pytest.mark.parametrize("push", [None, Push(2.0, interval=0.3)])
def test_a_push_begins_at_once_beside_the_others(push):
    """One push by hand and one of a schedule may come at the same time; a state amid a push
    continues.
    """
    env, other = begun(push=push), begun(push=push)
    if push is None:
        scheduled = gym.make("JansenWalker-v0", speed_command=0.3).unwrapped
        scheduled.reset(seed=1, options={"pushes": [(0.2, 1.5, 0.5)]})
        walk(scheduled, 10)
    without = walk(begun(push=push))
    env.push((1.5, 0.5))
    first = walk(env, 2)
    other.set_state(env.get_state())
    rest = walk(env, 38)
    pushed = np.concatenate([first, rest])
    np.testing.assert_array_equal(rest, walk(other, 38))
    velocity = env.task.columns["crank_axis_x_velocity"]
    assert np.abs(pushed[:, velocity] - without[:, velocity]).max() > 0.05  # m/s
    if push is None:
        np.testing.assert_array_equal(pushed, walk(scheduled))
    else:
        assert env.get_state()["record"]["random_pushes"]


@pytest.mark.slow
def test_pushes_that_are_over_make_room():
    env = begun()
    for _ in range(60):
        env.push((0.01, 0.0))
        walk(env, 1)
    assert len(env.get_state()["record"]["schedule"]) <= 6
    with pytest.raises(ValueError, match="must have at most 1000 pushes that are not over"):
        for _ in range(1001):
            env.push((0.0, 0.0))


@pytest.mark.parametrize("mode", AutoresetMode)
def test_a_robot_is_pushed_whatever_the_others_do(mode):
    """Only its own episode counts, in which a push is felt as it is alone."""
    envs = together(2, mode, limit=[2, 20]).unwrapped
    with pytest.raises(gym.error.ResetNeeded, match="must be reset"):
        envs.push(1, (1.5, 0.0))
    envs.reset(seed=1)
    for _ in range(2):
        envs.step(np.zeros((2, 1), np.float32))  # which ends the first one's episode
    envs.push(1, (1.5, 0.0))
    if mode == AutoresetMode.DISABLED:
        with pytest.raises(gym.error.ResetNeeded, match=r"robot 0 must be reset before push\(\)"):
            envs.push(0, (1.5, 0.0))
        envs.reset(options={"reset_mask": np.array([True, False])})
    elif mode == AutoresetMode.NEXT_STEP:
        envs.push(0, (1.5, 0.0))  # of no effect
    work = [envs.step(np.zeros((2, 1), np.float32))[4]["energy"]["push_work"] for _ in range(2)]
    assert [of_step[0] for of_step in work] == [0.0, 0.0] and work[1][1] != 0.0
