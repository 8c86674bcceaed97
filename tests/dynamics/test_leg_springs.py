"""Springs of the legs: three implementations against each other, and against closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest
from motions import FLIGHT, SPRINGS, pinned, placed, shift, walked

from jansen_env import ROBOTS, Motor, Robot, Terrain, built_robot, paper_robot
from jansen_env.dynamics import projection as pr
from jansen_env.dynamics import reduced as rd
from jansen_env.dynamics.inverse import crank_torque
from jansen_env.dynamics.joint_forces import joint_forces, pin_signs
from jansen_env.plants.plant import ProjectionPlant, RigidBodyPlant
from jansen_env.robot import JANSEN, Spring, TorsionSpring
from jansen_env.robot.kinematics import coordinates, joint_positions
from jansen_env.robot.robot_file import read_robot, robot_from_json, robot_to_json, write_robot

KLANN = replace(
    ROBOTS["klann"](),
    springs=(
        Spring("E", "C", stiffness=60.0, rest_length=0.2),
        Spring("F", anchor=(0.1, 0.3), stiffness=30.0),
        TorsionSpring("rod", "lower_rocker", stiffness=0.3, rest_angle=3.0),
    ),
)
SPRUNG = {"jansen": replace(paper_robot(), springs=SPRINGS), "klann": KLANN}
robots = pytest.mark.parametrize("robot", SPRUNG.values(), ids=SPRUNG.keys())


def potential(robot, psi):
    """Energy of all springs from the positions of the joints and the angles of the links, J."""
    energy = 0.0
    for leg in robot.legs:
        angle = psi + leg.phase
        mirror = 1.0 if leg.side == "fore" else -1.0
        joints = joint_positions(robot, leg.side, angle) @ [1.0, 1.0j]
        for spring in robot.springs:
            if isinstance(spring, Spring):
                start, end = (
                    joints[robot.linkage.joints.index(joint)]
                    if joint
                    else mirror * spring.anchor[0] + 1j * spring.anchor[1]
                    for joint in (spring.start, spring.end)
                )
                stretch = abs(end - start) - spring.rest_length
            else:
                turn = angle + np.linspace(0.0, 2.0 * math.pi, 400)
                turns = np.unwrap(coordinates(robot, leg.side, turn)[:, ::3], axis=0)
                first, second = map(robot.linkage.names.index, (spring.first, spring.second))
                stretch = mirror * (turns[:, second] - turns[:, first]) - spring.rest_angle
                stretch = stretch[0] - 2.0 * math.pi * round(stretch[:-1].mean() / (2.0 * math.pi))
            energy += 0.5 * spring.stiffness * stretch**2
    return energy


@robots
def test_the_table_is_the_energy_of_the_springs(robot, rng):
    tables = rd.compile_robot(robot)
    assert tables.tail < 1e-12
    for psi in rng.uniform(-10.0, 10.0, 10):
        sums = rd.body_sums(tables, psi)
        slope = (potential(robot, psi + 1e-5) - potential(robot, psi - 1e-5)) / 2e-5
        assert pytest.approx(potential(robot, psi), rel=1e-12) == sums.V
        assert sums.dV == pytest.approx(slope, rel=1e-6, abs=1e-6)


@robots
def test_reduced_and_dense_equations_agree(robot, random_state):
    """Accelerations of the tables, of the paper's equations and of the joint forces: 1e-10."""
    tables = rd.compile_robot(robot)
    for _ in range(10):
        q, v = np.split(random_state(), 2)
        forces = rd.generalised_forces(tables, q, v, 2.0) - rd.velocity_terms(tables, q, v)
        reduced = np.linalg.solve(rd.mass_matrix(tables, q), forces)
        assert joint_forces(robot, q, v, 2.0).q_ddot == pytest.approx(reduced, abs=1e-9, rel=1e-10)
        dense = pr.project(robot, q, v, 2.0)
        ours = pr.times(pr.tangent_matrix(robot, q)[0], reduced)
        ours += pr.tangent_bias(robot, q, v)[0]
        assert dense.acceleration() == pytest.approx(ours, abs=1e-9, rel=1e-10)


def test_pins_balance_the_springs_of_a_robot_at_rest():
    """Without weight, pins and springs leave no force or moment on a body: 1e-9 of the springs."""
    robot = SPRUNG["jansen"]
    q, linkage = np.array([0.2, 1.0, 0.3, 0.9]), robot.linkage
    forces = joint_forces(robot, q, np.zeros(4), q_ddot=np.zeros(4), gravity=0.0)
    turn = np.exp(1j * q[2])
    for i, leg in enumerate(robot.legs):
        mirror = 1.0 if leg.side == "fore" else -1.0
        joints = forces.joints[i] @ [1.0, 1.0j]
        centres = forces.centres[i] @ [1.0, 1.0j]
        corner = (pin_signs(linkage) @ forces.pin[i]) @ [1.0, 1.0j]
        total, moment = np.zeros(8, complex), np.zeros(8)

        def push(body, place, force, total=total, moment=moment, centres=centres):
            total[body] += force
            moment[body] += (np.conj(place - centres[body]) * force).imag

        for force, (body, joint) in zip(corner, linkage.corners, strict=True):
            push(body - 1, joints[linkage.joints.index(joint)], force)
        angles = coordinates(robot, leg.side, q[3] + leg.phase)[::3]
        x, y = SPRINGS[0].anchor
        anchor = q[0] + 1j * q[1] + turn * (mirror * x + 1j * y)
        at = dict(zip(linkage.joints, joints, strict=True))
        # E and C belong to the foot (7), D to the coupler (6).
        for spring, first, second in ((SPRINGS[0], (7, at["E"]), (0, anchor)),
                                      (SPRINGS[1], (6, at["D"]), (7, at["C"]))):  # fmt: skip
            way = second[1] - first[1]
            pull = spring.stiffness * (abs(way) - spring.rest_length) * way / abs(way)
            push(*first, pull)
            push(*second, -pull)
        for spring in SPRINGS[2:]:
            a, b = linkage.names.index(spring.first), linkage.names.index(spring.second)
            deflection = mirror * (angles[b] - angles[a]) - spring.rest_angle
            deflection = mirror * math.remainder(deflection, 2.0 * math.pi)
            moment[a] += spring.stiffness * deflection
            moment[b] -= spring.stiffness * deflection
        assert np.abs(total[2:]).max() < 1e-10
        assert np.abs(moment[2:]).max() < 1e-10
        assert abs(corner).max() > 1.0


def test_a_driven_crank_needs_the_torque_of_the_springs():
    """Held chassis, constant speed: the plant's mean torque over 5 ms is that of the inverse."""
    robot = SPRUNG["jansen"]
    plant, bare = pinned(robot, speed=2.0), pinned(Robot(), speed=2.0)
    largest = 0.0
    for each in (plant, bare):
        each.prescribed_crank_speed = True
    for _ in range(100):
        psi = plant.state[3]
        result, other = plant.step(0.0, 5e-3), bare.step(0.0, 5e-3)
        angles = psi + 0.01 * (np.arange(5) + 0.5) / 5.0
        expected = crank_torque(robot, angles, 2.0).total.mean()
        assert result.motor_work / 0.01 == pytest.approx(expected, abs=1e-9)
        largest = max(largest, abs(result.motor_work - other.motor_work) / 0.01)
    assert largest > 0.5  # N m


@robots
def test_both_plants_agree(robot):
    """0.2 s in the air and on the ground; the energy is that of the tables; accounts close."""
    tables, flying = rd.compile_robot(robot), FLIGHT
    plants = [RigidBodyPlant(robot, Terrain.flat()), placed(robot)]
    for plant in plants:
        plant.state = flying
    assert plants[1].energy() == pytest.approx(rd.energy(tables, *np.split(flying, 2)), rel=1e-12)
    # The energy of pymunk's springs is that in the middle of the next time step.
    step = plants[0].time_step
    later = rd.body_sums(tables, flying[3] + 0.5 * step * flying[7]).V
    expected = rd.energy(tables, *np.split(flying, 2)) + later - rd.body_sums(tables, flying[3]).V
    assert plants[0].energy() == pytest.approx(expected, rel=1e-6)
    for plant in plants:
        plant.step(1.0, 0.2)
    moved = np.abs(plants[1].state - flying)[2:4].max()
    assert np.abs(plants[0].state - plants[1].state)[2:4].max() < 1e-3 * moved
    bare = placed(replace(robot, springs=()), state=flying)
    bare.step(1.0, 0.2)
    assert abs(bare.state[3] - plants[1].state[3]) > 0.05  # the springs matter
    plants = [make(robot, Terrain.flat(friction=0.3)) for make in (RigidBodyPlant, ProjectionPlant)]
    for plant in plants:
        plant.reset(crank_angle=0.7)
        plant.step(3.0, 0.2)
    np.testing.assert_allclose(plants[0].state[:2], plants[1].state[:2], atol=5e-4)
    np.testing.assert_allclose(plants[0].state[2:4], plants[1].state[2:4], atol=4e-3)
    for plant in plants:
        plant.reset(crank_angle=0.7)
        results = walked(plant, 1.0, 0.4)
        turned = sum(abs(result.motor_work) + abs(result.energy_change) for result in results)
        assert abs(sum(result.energy_residual for result in results)) < 1e-3 * turned


def test_a_torsion_spring_knows_its_deflection_at_any_angle():
    """A rigid-body plant that is set to any state goes on as one that came there."""
    robot = SPRUNG["jansen"]
    for turns in (0.0, 2.0, -3.0):
        plant = RigidBodyPlant(robot, Terrain.flat())
        for psi in np.linspace(0.0, 2.0 * math.pi, 7):
            state = FLIGHT + shift(psi=psi + 2.0 * math.pi * turns, pitch=2.0 * math.pi * turns)
            plant.state = state
            stored = plant.batch._space.springs.energy(plant.batch._space.snapshot().motion, 0.0)
            assert stored == pytest.approx(potential(robot, state[3]), rel=1e-9)


def test_springs_are_part_of_robot_files(tmp_path):
    for robot in SPRUNG.values():
        path = write_robot(tmp_path / "sprung.json", robot)
        assert read_robot(path) == robot
    content = robot_to_json(SPRUNG["jansen"])
    assert content["springs"][3]["is"] == "TorsionSpring"
    assert "springs" not in robot_to_json(paper_robot())
    del content["springs"][0]["anchor"], content["springs"][2]["rest_angle"]
    springs = robot_from_json(content).springs
    assert springs[0].anchor == (0.0, 0.0)
    assert springs[2].rest_angle == 0.0


@pytest.mark.parametrize(
    "spring, message",
    [
        (Spring("Z", "C"), r"Robot.springs\[0\].start must be one of \['P', .*got 'Z'"),
        (Spring("D", "DE"), r"Robot.springs\[0\].end must be one of .*got 'DE'"),
        (Spring(""), r"Robot.springs\[0\].start must be one of .*got ''"),
        (Spring("P"), "must be between two points that move relative .*got Spring.start='P'"),
        (Spring("D", "B"), "joints that are not on the same link, got Spring.start='D', end='B'"),
        (TorsionSpring("frame", "arm"), r"springs\[0\].second must be one of .*got 'arm'"),
        (
            TorsionSpring("frame", "foot"),
            "two different links that share a pin, got .*first='frame', second='foot'",
        ),
        (
            TorsionSpring("foot", "foot"),
            "two different links that share a pin, got .*first='foot', second='foot'",
        ),
        (Motor(), r"Robot.springs\[0\] must be a Spring or a TorsionSpring, got Motor"),
    ],
)
def test_springs_that_do_not_fit_are_refused(spring, message):
    with pytest.raises(ValueError, match=message):
        Robot(springs=(spring,))


def test_wrong_numbers_are_refused():
    for make, message in {
        (lambda: Spring("E", stiffness=-1.0)): "Spring.stiffness must be between 0 and",
        (lambda: Spring("E", rest_length=math.inf)): "Spring.rest_length must be",
        (lambda: Spring("E", anchor=(1.0,))): "Spring.anchor must be two numbers",
        (lambda: Spring(3)): "Spring.start",
        (lambda: TorsionSpring("frame", "foot", rest_angle=7.0)): "rest_angle must be between",
    }.items():
        with pytest.raises(ValueError, match=message):
            make()


def test_a_torsion_spring_at_the_crank_is_refused():
    """The angle of a link that makes whole turns has no rest."""
    robot = Robot(springs=(*SPRINGS, TorsionSpring("crank", "upper_rod", 1.0)))
    message = r"springs\[4\] must be between two links that do not make whole turns"
    with pytest.raises(ValueError, match=message):
        rd.compile_robot(robot)


def test_other_lengths_keep_the_springs():
    robot = replace(built_robot(), springs=SPRINGS)
    assert robot.with_bodies(crank=robot.body("crank")).springs == SPRINGS
    assert {spring.start for spring in SPRINGS[:2]} <= {*JANSEN.joints}
