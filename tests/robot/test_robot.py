"""The machine and its motor: the paper's numbers, and designs that are refused."""

import math
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from jansen_env import (
    Bar,
    Compliance,
    Leg,
    LinkageError,
    Motor,
    Payload,
    Robot,
    Terrain,
    Triangle,
    built_robot,
    paper_robot,
    phased_legs,
)
from jansen_env.robot import JANSEN, ROBOTS, Plate, named_robot
from jansen_env.robot.kinematics import check_closure
from jansen_env.terrain import make_terrain

TRIANGLE = Robot().body("foot")

REFUSED = [
    (lambda: Bar(0.0), "Bar.length must be .*, got 0.0"),
    (lambda: Bar(1.0, mass=-0.1), "Bar.mass must be .*, got -0.1"),
    (lambda: replace(TRIANGLE, alpha=0.0), "Triangle.alpha must be .*, got 0.0"),
    (lambda: replace(TRIANGLE, gamma=5.0), "sum of alpha, gamma must be .* got 6.57408"),
    (
        lambda: Triangle.from_sides(1.0, 2.0, 3.5),
        r"sides must form a triangle, got \(1\.0, 2\.0, 3\.5\) m",
    ),
    (lambda: Triangle.from_sides(1.0, -2.0, 1.0), "second_third must be .*, got -2.0"),
    (lambda: Leg("left"), "Leg.side must be .*, got 'left'"),
    (lambda: Payload(position=(1.0,)), r"Payload.position must be .*, got \(1.0,\)"),
    (lambda: phased_legs(0), "phases must be .*, got 0"),
    (lambda: paper_robot(101), "phases must be .* from 1 to 100, got 101"),
    (lambda: Robot(pad_radius=0.0), "Robot.pad_radius must be .*, got 0.0"),
    (lambda: Robot(material="steel"), "Robot.material must be .*, got 'steel'"),
    (
        lambda: Robot(damping=(0.1,) * 9),
        "Robot.damping must have 10 entries, the same number as linkage.damped, got 9",
    ),
    (lambda: Robot(damping=(-0.1,) * 10), "Robot.damping must be .*, got -0.1"),
    (
        lambda: Robot(bearing_friction=(0.1,)),
        "bearing_friction must have 10 entries, the same number as linkage.bearings, got 1",
    ),
    (lambda: Robot().with_bodies(rocker=0.25), "rocker must be a Bar or a Plate.*got 0.25"),
    (lambda: Robot().with_bodies(foot=Bar(0.25)), r"Robot\.bodies: foot must be a Triangle or a"),
    (lambda: Bar(1e308), r"Bar.length must be .* lengths are in metres, got 1e\+308"),
    (lambda: Plate(((0, 0), (240, 2400))), r"Plate.points must be .* in metres, got 2400"),
    (lambda: Robot(legs=()), "Robot.legs must have 1 or more entries, got 0"),
    (
        lambda: Robot(legs=(Leg("fore"),) * 201),
        "legs must have at most .*, got 201 legs of 6 pads each",
    ),
    (lambda: Robot(legs=(Leg("fore", 0.5),)), r"legs\[0\].phase must be .*, got 0.5"),
    (lambda: Compliance(0.0), "Compliance.stiffness must be .*, got 0.0"),
    (lambda: Compliance(1e4, -1.0), "Compliance.damping must be .*, got -1.0"),
    (lambda: Compliance(damping=1.0), "stiffness must be finite with a damping of 1, got inf"),
    (lambda: Compliance(1e4, 0.0, math.inf), "tangential_stiffness must be .*, got inf"),
    (lambda: Compliance(np.zeros(0), 1.0), r"stiffness must be a finite.*got array\(\[\].*"),
    (lambda: Motor(no_load_speed=5.0), "stall_torque must be .*, got inf"),
    (
        lambda: Motor(gear_ratio=1e5, rotor_inertia=1.0),
        "gear_ratio, rotor_inertia must be between 0 and",
    ),
    (lambda: Motor(efficiency=1.1), "efficiency"),
    (
        lambda: Motor(stall_torque=np.array([math.inf])),
        "stall_torque must be a finite.*got array.*",
    ),
    (lambda: Terrain(((0.0, 0.0),)), r"Terrain.points must be .*, got the shape \(1, 2\)"),
    (lambda: Terrain(((0, 0), (2, 0), (1, 0))), "must increase .*, got point 2 at 1.0 after 2.0"),
    (lambda: Terrain.flat(friction=-0.1), "Terrain.friction must be .*, got -0.1"),
    (
        lambda: Terrain(((0.0, 0.0), (1e7, 0.0))),
        r"Terrain\.points must be within 1e\+06 m of the.*, got a coordinate of 1e\+07 m",
    ),
    (lambda: make_terrain("slope:up"), "terrain must be .*, got 'slope:up'"),
]


@pytest.mark.parametrize("make, message", REFUSED)
def test_bad_values_are_refused_by_name_and_value(make, message):
    """Each raises ValueError whose message names the argument and the value it was given."""
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize(
    "change, joint, angle",
    [
        # B: the crank pin is farthest from P at psi = frame_angle.
        ({"upper_rod": Bar(0.15)}, "B", Robot().frame_angle),
        ({"lower_rod": Bar(0.15)}, "C", Robot().frame_angle),
        ({"coupler": Bar(0.6)}, "E", None),
    ],
)
def test_a_crank_that_cannot_turn_is_refused(change, joint, angle):
    """The error names the joint and the worst crank angle of a 0.5 degree search."""
    with pytest.raises(LinkageError, match=f"joint {joint} does not close at crank angle") as error:
        check_closure(Robot().with_bodies(**change))
    if angle is not None:
        named = float(str(error.value).split("crank angle ")[1].split(" rad")[0])
        assert abs(named - angle) <= 2.0 * math.pi / 720


def test_triangle_8_is_made_from_its_sides():
    """Sides (L7, L12, L8) give the paper's printed centroid data, to their last digit, 1e-5."""
    made = Triangle.from_sides(0.25342, 0.43599, 0.35948)
    printed = Robot().body("foot")
    for name in ("d", "l", "h", "alpha", "gamma"):
        assert getattr(made, name) == pytest.approx(getattr(printed, name), abs=1e-5), name
    assert printed.sides == pytest.approx((0.25342, 0.43599, 0.35948), abs=2e-6)


def test_triangle_4_is_a_little_larger_than_its_sides():
    """The paper's centroid data belong to 1.0101 (hypot(l0, h0) / l0) times (L4, L10, L5), to six
    digits.
    """
    factor = math.hypot(0.32436, 0.04632) / 0.32436
    printed = 1.0101  # in the paper
    assert factor == pytest.approx(printed, abs=5e-5)
    enlarged = factor * np.array([0.23529, 0.32338, 0.25134])
    assert Robot().body("upper_triangle").sides == pytest.approx(enlarged, rel=1e-5)


@pytest.mark.parametrize("triangle", [Robot().body("foot"), Triangle.from_sides(0.3, 0.4, 0.5)])
def test_triangle_sides_and_centroid_belong_together(triangle):
    """`sides` undoes `from_sides`; the mean of the corners is the centroid, to the 6 printed
    digits.
    """
    assert Triangle.from_sides(*triangle.sides).sides == pytest.approx(triangle.sides, abs=1e-12)
    second, third = np.exp(1j * triangle.alpha), np.exp(-1j * triangle.gamma)
    assert abs(triangle.d + triangle.l * second + triangle.h * third) < 2e-6


def test_the_paper_robot_is_the_papers():
    """Table 1 has masses of 0.1 kg, inertias of 0.1 kg m^2 and friction of 0.1 at ten pairs; 32
    bodies have 3.2 kg.
    """
    robot = Robot()
    assert {(body.mass, body.inertia) for body in robot.bodies} == {(0.1, 0.1)}
    assert len(JANSEN.damped) == 10 and set(robot.damping) == {0.1}
    assert robot.mass == pytest.approx(3.2, abs=1e-12)
    assert replace(robot, payload=Payload(1.5)).mass == pytest.approx(4.7, abs=1e-12)


def test_slender_inertias():
    """A rod has m L^2 / 12; a plate has m (a^2 + b^2 + c^2) / 36, as a right triangle does."""
    assert Bar(2.0, mass=0.3).slender().inertia == pytest.approx(0.1, abs=1e-15)
    plate = Triangle.from_sides(3.0, 4.0, 5.0, mass=2.0).slender()
    # Legs p, q at right angles: the plate's inertia about its centroid is m (p^2 + q^2) / 18.
    assert plate.inertia == pytest.approx(2.0 * 25.0 / 18.0, rel=1e-12)
    slender = Robot().with_slender_inertias()
    assert [b.inertia for b in slender.bodies] == [b.slender().inertia for b in Robot().bodies]


def test_holy_numbers_are_jansens():
    """They are the published lengths, in units of 1/15 of the crank, to 1e-12."""
    robot = ROBOTS["holy"]()
    unit = robot.body("crank").length / 15.0
    rods = [robot.body(name) for name in ("upper_rod", "rocker", "lower_rod", "coupler")]
    assert [rod.length / unit for rod in rods] == pytest.approx([50, 39.3, 61.9, 39.4], rel=1e-12)
    frame = robot.body("frame").length / unit * np.exp(1j * robot.frame_angle)
    assert (frame.real, frame.imag) == pytest.approx((38.0, 7.8), rel=1e-12)
    triangles = np.array([*robot.body("upper_triangle").sides, *robot.body("foot").sides]) / unit
    assert triangles == pytest.approx([41.5, 55.8, 40.1, 36.7, 65.7, 49.0], rel=1e-12)


def test_a_pad_gives_along_the_ground_as_it_does_into_it_unless_told():
    same = Compliance(2e4, 50.0)
    assert (same.tangential_stiffness, same.tangential_damping) == (2e4, 50.0)
    assert not same.rigid
    assert Compliance().rigid
    assert Compliance(2e4, 50.0, 1e4).tangential_stiffness == 1e4


REAL = Motor(8.0, 10.0, torque_limit=6.0, gear_ratio=50.0, efficiency=0.7)


def test_an_ideal_motor_gives_what_is_asked_for():
    asked = np.linspace(-30.0, 30.0, 61)
    np.testing.assert_array_equal(Motor().torque(asked, 1e6), asked)
    drawn = Motor().electrical_power([2.0, -2.0, 0.0], [3.0, 3.0, 1.0])  # mechanical, never back
    np.testing.assert_array_equal(drawn, [6.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("speed", "low", "high"),
    [
        (0.0, -6.0, 6.0),  # the limit of gear and driver
        (5.0, -6.0, 4.0),  # half way to the no-load speed
        (10.0, -6.0, 0.0),
        (12.0, -6.0, -1.6),  # overrun, the motor brakes whatever is asked for
        (-5.0, -4.0, 6.0),
        (-12.0, 1.6, 6.0),
        (30.0, -6.0, -6.0),  # but no more than driver and gear allow
    ],
)
def test_torque_lies_below_the_torque_speed_line(speed, low, high):
    assert float(REAL.torque(-100.0, speed)) == pytest.approx(low)
    assert float(REAL.torque(100.0, speed)) == pytest.approx(high)
    inside = 0.5 * (low + high)
    assert float(REAL.torque(inside, speed)) == inside


def test_electrical_power_is_the_armatures_voltage_times_current():
    # V = K n0, R = V / I_s, stall torque = eta K I_s; of any K the power is the same.
    K = 0.9
    voltage = K * 10.0
    stall_current = 8.0 / (0.7 * K)
    resistance = voltage / stall_current
    for torque, speed in ((3.0, 4.0), (8.0, 0.0), (2.0, -1.0), (-4.0, 8.0), (-6.0, 0.2)):
        inner = torque / 0.7 if torque * speed >= 0.0 else torque * 0.7
        current = inner / K
        power = (K * speed + resistance * current) * current
        assert float(REAL.electrical_power(torque, speed)) == pytest.approx(max(power, 0.0))


def test_a_name_may_have_a_number_of_legs():
    """It is the design with that many legs, everywhere where a robot has a name."""
    assert named_robot("built:12") == built_robot(6) and named_robot("built:4") == built_robot()
    env = gym.make("JansenWalker-v0", robot="klann:6")
    assert len(env.unwrapped.robot.legs) == 6
    for name in ("built:5", "built:0", "built:", "built:-2", "built:1000", "built:4:4", "built:²"):
        with pytest.raises(ValueError, match=f"robot must be .*, got '{name}'"):
            gym.make("JansenWalker-v0", robot=name)
