"""The check of every robot that is loaded: it closes, it stands, its units are SI."""

import math
import warnings
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from agents.design.measures import geometry_measures
from jansen_env import ROBOTS, Leg, LinkageError, Payload, Robot, holy_numbers_robot
from jansen_env.robot.lengths import lengths, with_lengths
from jansen_env.robot.robot_file import robot_to_json, write_robot
from jansen_env.robot.soundness import check_loaded
from jansen_env.scoring.rollout import make_env
from jansen_env.world.settings import load_robot
from jansen_workshop.commands import drawings

WALKER = "JansenWalker-v0"
CRANK = "JansenCrank-v0"
CANNOT = "robot cannot stand: its lowest toe must lie below the crank axis over the whole turn"


def other_side(joint, name="paper"):
    """A robot with the dyad of a joint assembled on its other side."""
    robot = ROBOTS[name]()
    dyads = (
        dyad._replace(branch=-dyad.branch) if dyad.joint == joint else dyad
        for dyad in robot.linkage.dyads
    )
    return replace(robot, linkage=replace(robot.linkage, dyads=tuple(dyads)))


def scaled(factor, name="paper"):
    robot = ROBOTS[name]()
    return with_lengths(
        robot, {k: v if k == "frame_angle" else factor * v for k, v in lengths(robot).items()}
    )


@pytest.mark.parametrize("phases", [1, 2, 3, 5])
@pytest.mark.parametrize("name", ROBOTS)
def test_built_in_designs_load_without_a_warning(name, phases):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        robot = ROBOTS[name](phases)
        assert check_loaded("robot", robot) is robot


@pytest.mark.parametrize(
    "joint, name, cause",
    [
        ("C", "paper", "branch of joint C (the crank axis is then 0.612 m above the ground)"),
        ("C", "holy", "branch of joint C (the crank axis is then 0.661 m above the ground)"),
        ("T", "trotbot", "branch of joint T (the crank axis is then 0.612 m above the ground)"),
        ("J", "chebyshev", "joint B (the crank axis is then 1.78 m above the ground) or joint J"),
    ],
)
def test_the_error_names_the_dyad_on_its_other_side(joint, name, cause):
    with pytest.raises(LinkageError, match=f"^robot: {CANNOT}") as error:
        load_robot("robot", other_side(joint, name))
    assert cause in str(error.value)


def test_a_robot_that_cannot_stand_is_refused_whatever_it_is_for(tmp_path, capsys):
    """It is refused by environments of each kind, options of a reset, states, files and
    drawings.
    """
    robot = other_side("C")
    path = write_robot(tmp_path / "mine.json", robot)
    for value in (robot, path, str(path)):
        with pytest.raises(LinkageError, match=CANNOT):
            gym.make(WALKER, robot=value)
    with pytest.raises(LinkageError, match=CANNOT):
        gym.make_vec(WALKER, 2, robot=["paper", robot])
    env = gym.make(WALKER).unwrapped
    before, _ = env.reset(seed=1)
    for options in ({"robot": robot}, {"lengths": {"frame_angle": 3.3}}):
        with pytest.raises(LinkageError, match=CANNOT):
            env.reset(options=options)
    state = env.get_state()
    with pytest.raises(LinkageError, match=CANNOT):
        env.set_state({**state, "robot": robot_to_json(robot)})
    assert np.array_equal(env.reset(seed=1)[0], before)
    with pytest.raises(SystemExit):
        drawings.main([str(path), "--out", str(tmp_path / "cut")])
    assert CANNOT in capsys.readouterr().err and not (tmp_path / "cut").exists()
    assert geometry_measures(robot)["closure"] == -1.0


def test_drawn_lengths_give_robots_that_stand():
    """Frame angles from 0 to 90 times the own one, beyond a turn or upside down, are
    sampled again.
    """
    env = gym.make(WALKER, randomize={"lengths": {"frame_angle": (0.01, 90.0)}}).unwrapped
    for seed in range(8):
        env.reset(seed=seed)
        check_loaded("robot", env.robot)


def test_a_held_robot_need_not_stand_but_there_is_a_warning():
    with pytest.warns(UserWarning, match=f"{CANNOT}.*the chassis is held in the air"):
        env = gym.make(CRANK, robot=other_side("C"))
    env.reset(seed=0)
    assert np.isfinite(env.step(np.array([0.5]))[0]).all()
    with pytest.raises(LinkageError, match="robot: joint C does not close"):
        gym.make(CRANK, robot=with_lengths(Robot(), {"rocker": 0.05}))


@pytest.mark.parametrize(
    "make, message",
    [
        (
            lambda: replace(Robot(), frame_angle=11.6),
            "Robot.frame_angle .* 11.6 degrees are 0.2025",
        ),
        (lambda: Leg("fore", 180), "Leg.phase must be between -2 pi and 2 pi rad, got 180"),
        (lambda: Leg("fore", math.nan), "Leg.phase"),
    ],
)
def test_angles_beyond_a_turn_are_refused_in_radians(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize(
    "robot, message",
    [
        (scaled(150.0), "91.8 m above the ground, .* multiply lengths in millimetres by 0.001"),
        (scaled(39.37), "multiply lengths in inches by 0.0254"),
        (scaled(0.05), "its crank axis is 0.0306 m above the ground, expected 0.05 to 5 m"),
        (replace(Robot(), pad_radius=10.0), "pad_radius is 10 m, while the crank axis is 0.612 m"),
        (
            Robot().with_bodies(rocker=replace(Robot().body("rocker"), mass=1000.0)),
            "masses are in kg: if these are in g, multiply them by 0.001",
        ),
        (
            Robot(bodies=tuple(replace(body, mass=1e-4) for body in Robot().bodies)),
            "if these are in tonnes, multiply them by 1000",
        ),
        (Robot(payload=Payload(1.0, 0.0, (0.0, 300.0))), "payload.position is"),
    ],
)
def test_sizes_and_masses_far_from_human_scale_cause_a_warning_with_their_unit(robot, message):
    with pytest.warns(UserWarning, match=message):
        assert load_robot("robot", robot) == robot


@pytest.mark.slow
def test_the_holy_numbers_walk_with_a_level_frame():
    """Their C comes within 0.087 rad of a dead point. Both plants agree to 1 % in 1.5 s."""
    frame = holy_numbers_robot().body("crank").length / 15.0 * 38.0
    robot = with_lengths(holy_numbers_robot(), {"frame": frame, "frame_angle": 0.0})
    turned = {}
    for plant in ("projection", "rigid_body"):
        kwargs = {"plant": plant, "time_step": 0.00025, "reset_noise_scale": 0.0}
        env = make_env(WALKER, {"robot": robot, **kwargs})
        env.reset(seed=0, options={"crank_angle": 1.0})
        for _ in range(75):
            _, _, over, _, info = env.step(np.array([0.3]))
            assert not over
            if plant == "projection":
                assert abs(info["energy"]["residual"]) < 1e-4
        turned[plant] = info["crank_angle"] - 1.0
    assert turned["projection"] == pytest.approx(turned["rigid_body"], rel=0.01)
