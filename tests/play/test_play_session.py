"""A robot in somebody's hands: what drives it, what is changed, how time passes, and the score."""

import gymnasium as gym
import numpy as np
import pytest

import jansen_env
from jansen_env.play.session import BY_HAND, LARGEST_PUSH, PACES, SLIDERS, STEADY, Choices, Session
from jansen_env.policies import pretrained
from jansen_env.robot.lengths import lengths
from jansen_env.scoring.metrics import point_estimates
from jansen_env.scoring.rollout import run_episodes
from jansen_env.tasks.walking.walker_benchmark import WALKER

DT = 0.02


def walk(session, seconds):
    """Let time pass as a window does that draws 100 pictures a second."""
    return sum(session.advance(0.01) for _ in range(round(100 * seconds)))


@pytest.fixture
def session():
    made = Session("JansenWalker-v0")  # whose rigid feet can bounce
    yield made
    made.close()


def refused(session, match, action, *arguments):
    """Check that an action is refused with a text."""
    with pytest.raises(ValueError, match=match):
        getattr(session, action)(*arguments)


def test_a_key_lets_the_torque_grow_and_go_back(session):
    session.hold(1)
    walk(session, 0.1)
    assert session.input == pytest.approx(0.3)
    walk(session, 1.0)
    assert session.input == 1.0
    session.hold(-1)
    walk(session, 0.1)
    assert session.input == pytest.approx(-0.3)
    session.hold(0)
    walk(session, 0.5)
    assert session.input == 0.0
    session.steer(0.2)  # a slider stays where it is
    walk(session, 0.5)
    assert session.input == 0.2


def test_the_input_is_a_policys_command():
    session = Session(control="ppo")
    assert session.top_speed == 0.8
    session.steer(0.5)
    walk(session, 5.0)
    assert session.env.get_state()["speed_command"] == pytest.approx(0.4)
    assert session.score().distance == pytest.approx(0.4 * 5.0, abs=0.15)
    session.hold(1)
    walk(session, 0.2)
    session.hold(0)
    walk(session, 0.2)
    assert session.command == pytest.approx(0.48)
    session.choose("control", BY_HAND)
    assert session.command is None and session.input == 0.0


def test_the_score_is_that_of_the_evaluation():
    env_id, seed, command = "JansenWalker-v0", 3, 0.4
    session = Session(env_id, control="ppo", seed=seed)
    session.steer(command / session.top_speed)
    session.reset()
    assert walk(session, 10.0) == 500
    env = gym.make(env_id)
    commands, seeds = np.array([session.command]), np.array([seed])
    run = run_episodes(pretrained.load(env_id).on(env), env_id, {}, commands, seeds)
    expected = point_estimates(WALKER.metrics, run, env)
    score = session.score()
    assert score.distance == pytest.approx(run["distance"][0], rel=1e-9)
    assert score.slip_per_metre == pytest.approx(expected["slip_per_metre"], rel=1e-9)
    assert score.cost_of_transport == pytest.approx(expected["cost_of_transport"], rel=1e-9)
    assert score.time == pytest.approx(run["duration"][0])


def test_a_walk_backwards_has_a_distance_unless_it_was_to_go_forwards():
    session = Session(control="ppo")
    session.steer(0.5)
    session.reset()
    walk(session, 4.0)
    assert session.score().distance > 1.0
    before, x = session.score().distance, session.frame().q[0]
    session.steer(-0.5)  # what has been walked counts as it was commanded
    walk(session, 1.0)
    back = x - session.frame().q[0]
    assert session.score().distance == pytest.approx(before + back, abs=0.02)
    session.choose("control", BY_HAND)
    assert session.score().distance > 1.0
    session.choose("control", "ppo")
    session.reset()
    session.steer(0.5)
    session.push(-LARGEST_PUSH, 0.0)
    walk(session, 0.4)
    assert session.frame().q[0] < 0.0
    assert (session.score().distance, session.score().slip_per_metre) == (0.0, None)


def test_sliders_change_the_environment(session):
    for name, slider in SLIDERS.items():
        refused(session, "must be between", "set", name, slider.high + 0.01)
        session.set(name, slider.high)
        session.set(name, slider.low)
        assert session.env.get_state()["parameters"][name] == slider.low
    session.choose("terrain", "stairs")
    session.another()  # and so they stay on another ground
    assert session.values() == {name: slider.low for name, slider in SLIDERS.items()}


def test_ground_and_robot_by_name():
    session = Session(seed=4)
    session.choose("terrain", "stairs")
    session.choose("level", 7)
    steep = session.env.scene()["terrain_points"]
    expected = gym.make("JansenWalker-v0", terrain="stairs", terrain_level=7)
    expected.reset(seed=4)
    np.testing.assert_array_equal(steep, expected.unwrapped.scene()["terrain_points"])
    session.reset()
    np.testing.assert_array_equal(steep, session.env.scene()["terrain_points"])
    session.another()
    assert not np.array_equal(steep, session.env.scene()["terrain_points"])
    session.choose("robot", "holy")
    assert session.env.robot == jansen_env.holy_numbers_robot()
    session.choose("terrain", "flat")
    session.choose("terrain", "stairs")
    assert session.choices == Choices("holy", "stairs", 7, BY_HAND)


def test_a_robot_of_other_lengths_walks_and_is_recorded():
    """At a constant speed of its crank, on other terrain as well, until another robot is chosen."""
    session = Session()
    session.build("klann", {"rod_AD": 0.47})
    walk(session, 4.0)
    assert session.score().distance == pytest.approx(4.0 * session.command, rel=0.2)
    assert len(session.recording().time) == 4.0 / DT + 1
    session.choose("terrain", "waves")
    assert session.lengths == {"rod_AD": 0.47}
    robot, before = session.env.robot, session.choices
    assert lengths(robot)["rod_AD"] == 0.47 and session.choices.control == STEADY
    for changed, message in (
        ({"rod_AD": 0.1}, "joint D does not close at crank angle"),
        ({"rod_AD": -0.1}, "must be above 0"),
        ({"wheel": 1.0}, "lengths has 'wheel', must be of"),
    ):
        refused(session, message, "build", "klann", changed)
        assert session.env.robot is robot
    assert session.choices == before
    session.choose("robot", "holy")
    assert session.lengths == {} and session.env.robot == jansen_env.holy_numbers_robot()


def test_of_a_long_walk_the_first_minute_is_recorded(monkeypatch):
    """It goes on meanwhile; a new start is recorded from its beginning."""
    monkeypatch.setattr("jansen_env.play.session.LONGEST_REPLAY", 0.5)
    session = Session(control=STEADY)
    walk(session, 1.0)
    assert len(session.recording().time) == 0.5 / DT + 1 and session.score().time == 1.0
    session.reset()
    with pytest.raises(ValueError, match="no walk yet"):
        session.recording()
    walk(session, 0.2)
    assert len(session.recording().time) == 0.2 / DT + 1


def test_what_cannot_be_is_refused_and_changes_nothing(session):
    session.set("restitution", 0.5)
    env, version = session.env, session.version
    refused(session, "restitution", "choose", "robot", "built")  # its feet give
    for name, value in (
        ("robot", "wooden"), ("terrain", "swamp"), ("level", 3), ("level", 10), ("level", "1"),
        ("control", "sac"), ("shoes", 1),
    ):  # fmt: skip
        refused(session, "must be", "choose", name, value)
    for action, *arguments in (
        ("steer", 1.1), ("hold", 2), ("slow", 0.3), ("push", LARGEST_PUSH, 0.1),
        ("push", np.nan, 0.0), ("pause", 1), ("set", "gravity", 1.0),
    ):  # fmt: skip
        refused(session, "must be", action, *arguments)
    assert session.env is env and session.choices.robot == "paper"
    assert session.input == 0.0 and session.version == version
    session.say("a message")
    walk(session, 7.0)
    assert session.message == ""


def test_a_push_moves_the_robot(session):
    other = Session("JansenWalker-v0")
    session.push(3.0, 0.0)
    walk(session, 0.2), walk(other, 0.2)
    assert session.frame().q[0] > other.frame().q[0] + 0.01
    for _ in range(1100):  # more than may be kept at once
        session.push(0.01, 0.0)
        session.advance(DT)


@pytest.mark.parametrize("pace", [PACES[0], PACES[-1]])
def test_slow_motion_takes_the_same_steps_smoothly(session, pace):
    session.steer(0.3)
    session.slow(pace)
    times, steps = [session.frame().time], 0
    for _ in range(100):
        steps += session.advance(0.01)
        times.append(session.frame().time)
    assert steps == pytest.approx(50 * pace, abs=1)
    np.testing.assert_allclose(np.diff(times)[-50:], 0.01 * pace, atol=1e-9)
    other = Session("JansenWalker-v0")
    other.steer(0.3)
    for _ in range(steps):
        other.advance(DT)
    assert session.score() == other.score()


def test_time_stands_still(session):
    session.pause(True)
    assert walk(session, 1.0) == 0
    session.pause(False)
    assert session.advance(60.0) <= 13  # and does not run after a program that was stopped


def test_a_fall_is_reported_and_ends_the_score():
    session = Session(seed=1)
    session.steer(1.0)
    walk(session, 5.0)
    assert session.fallen and "fallen" in session.message
    before, x = session.score(), session.frame().q[0]
    walk(session, 0.4)
    assert session.score() == before and session.frame().q[0] != x  # and the robot goes on
    session.reset()
    assert not session.fallen and session.message == "" and session.score().time == 0.0
    assert session.input == 0.0


def test_a_simulation_that_diverges_waits_for_a_reset(session, monkeypatch):
    walk(session, 0.1)
    *results, _, info = session._env.step(np.zeros(1, np.float32))
    monkeypatch.setattr(session._env, "step", lambda action: (*results, True, info))
    assert session.advance(0.1) == 5
    assert session.stuck and "diverged" in session.message and not session.fallen
    assert session.advance(0.1) == 0
    monkeypatch.undo()
    session.reset()
    assert session.advance(0.1) == 5 and session.message == ""
