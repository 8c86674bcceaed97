"""The robot that could be built: masses from dimensions, its list of parts, what it carries."""

import math
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from motions import PLANTS
from walks import walk

from agents.design.measures import loads_of_walk
from jansen_env import ROBOTS, Terrain, built_robot
from jansen_env.dynamics.reduced import compile_robot
from jansen_env.plants.plant import ProjectionPlant, RigidBodyPlant
from jansen_env.plants.trace import trace_forces
from jansen_env.policies import pretrained
from jansen_env.policies.pid import PID
from jansen_env.policies.policy import PAPER_PID
from jansen_env.robot import BEARING_LOADS, JANSEN
from jansen_env.robot import buildable as built
from jansen_env.robot.motor import MOTORS
from jansen_workshop.drawings.convex import Round
from jansen_workshop.drawings.materials import about_origin, bill_of_materials

PAGE = Path(__file__).parents[2] / "docs" / "built_robot.md"
ID = "JansenWalkerBuilt-v0"
FINE_STEP = 2.5e-4  # s, that resolves touchdowns
SMALL = PID(0.3, 0.2, 0.05)  # of the weekend robot


def test_a_flat_bar_is_a_rectangle_with_round_ends():
    """Mass and inertia are those of a polygon to 1e-3; end masses add m and m L^2 / 4 each."""
    length, width = 0.2, 0.04
    area, _, polar = about_origin(Round((-0.5 * length, 0.5 * length), 0.5 * width)).real
    areal = built.DENSITY * built.BAR_THICKNESS
    bare = built.flat_bar(length, width, 0.0)
    assert bare == pytest.approx((areal * area, areal * polar), rel=1e-3)
    loaded = built.flat_bar(length, width, 0.3)
    assert loaded.mass - bare.mass == pytest.approx(0.6)
    assert loaded.inertia - bare.inertia == pytest.approx(2.0 * 0.3 * 0.1**2)


@pytest.mark.parametrize("third", [0.02, 0.05])
def test_a_plate_is_a_triangle_with_a_hole(third):
    """Mass and inertia are those of polygons.

    A heavier third corner draws the hole to it, so that the centre of mass stays.
    """
    corners = np.array([0.0, 0.3, 0.1 + 0.2j])
    corners -= corners.mean()
    masses = np.array([0.02, 0.02, third])
    areal = built.DENSITY * built.PLATE_THICKNESS
    shift = (third - 0.02) / (areal * built.WINDOW**2 * 0.03) * corners[2]
    outline = built.OUTLINE * corners
    hole = built.WINDOW * corners + shift
    sheet = areal * (about_origin(Round((*outline,))) - about_origin(Round((*hole,))))
    points = [masses.sum(), masses @ corners, masses @ abs(corners) ** 2]
    mass, moment, inertia = sheet + points
    sides = tuple(abs(np.roll(corners, -1) - corners))
    plate = built.triangular_plate(sides, 0.02, third)
    assert (plate.mass, plate.inertia) == pytest.approx((mass.real, inertia.real), rel=1e-12)
    assert abs(moment) < 1e-12
    assert built.triangular_plate(sides, 0.02) == built.triangular_plate(sides, 0.02, 0.02)


def test_the_page_has_the_bill_of_materials():
    lines = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line[:1] == "|"]
    cells = [[cell.strip() for cell in line.split("|")[1:7]] for line in lines]
    for p in bill_of_materials(built_robot()):
        masses = f"{1e3 * p.each:.1f}", f"{1e3 * p.mass:.0f}"
        assert [p.name, p.material, p.dimensions, str(p.number), *masses] in cells


def test_the_masses_of_parts_are_those_of_their_volumes():
    """Tubes, plates, shafts and hubs agree within 1 g; steel has 7850 kg/m^3."""

    def round_bar(outer, inner, length, density):
        return 0.25 * math.pi * (outer**2 - inner**2) * length * density

    hubs = 4.0 * round_bar(25e-3, 12e-3, 10e-3, built.DENSITY)
    shaft = round_bar(12e-3, 0.0, 160e-3, 7850.0)
    assert pytest.approx(shaft + hubs, abs=1e-3) == built.CRANKSHAFT_MASS
    tube = round_bar(20e-3, 16e-3, 200e-3, built.DENSITY)
    assert pytest.approx(tube, abs=1e-3) == built.CROSS_MEMBER_MASS
    plate = 0.1**2 * 4e-3 * built.DENSITY - round_bar(60e-3, 0.0, 4e-3, built.DENSITY)
    assert pytest.approx(plate, abs=1e-3) == built.MOTOR_PLATE_MASS
    shoe = 40e-3 * 30e-3 * 3e-3 * built.DENSITY
    assert shoe < built.SHOE_MASS < shoe + 5e-3


# Young's modulus of the tread by Gent's relation (1958), Pa.
MODULUS = 1e6 * 0.0981 * (56.0 + 7.62336 * built.RUBBER_HARDNESS)
MODULUS /= 0.137505 * (254.0 - 2.54 * built.RUBBER_HARDNESS)
COMPRESSION = 0.275  # of the radius, what a rubber spring bears a million times
SHEAR = 0.28 * built.FOOT_RADIUS * built.FOOT_STIFFNESS[1]  # N, as a rubber buffer of 30 x 30 mm
HOLE = 160e6 * built.BAR_THICKNESS * (built.WIDTH - 2.0 * (built.PIN_RADIUS + 1e-3))
"""Pull at which a bar yields beside a pin's hole, N; its proof strength is 160 MPa."""


def tread_load(strain):
    """Load (N) on a rubber cylinder between two plates, of which the tread is one half.

    Lindley (1967).
    """
    size = MODULUS * built.FOOT_WIDTH * 2.0 * built.FOOT_RADIUS
    return size * (1.25 * strain**1.5 + 50.0 * strain**6)


def test_the_feets_numbers_belong_to_one_part():
    """Radius, width and hardness give the stiffness, as a secant, and the load that it bears.

    Along the ground the tread is a short cantilever: shear and bending (Timoshenko).
    """
    normal, tangential = built.FOOT_STIFFNESS
    assert pytest.approx(3.605e6, rel=1e-3) == MODULUS
    assert built_robot().pad_radius == built.FOOT_RADIUS
    at = 530.0 / normal
    assert tread_load(at / built.FOOT_RADIUS) == pytest.approx(530.0, rel=0.05)
    for strain in (0.155, COMPRESSION):
        secant = tread_load(strain) / (strain * built.FOOT_RADIUS)
        assert secant == pytest.approx(normal, rel=0.25)
    top = 1.0 - at / built.FOOT_RADIUS
    u = top * (np.arange(10_000) + 0.5) / 10_000
    shear = 3.0 * 1.2 * (0.5 / np.sqrt(1.0 - u * u)).mean() * top
    bending = 1.5 * ((top - u) ** 2 / (1.0 - u * u) ** 1.5).mean() * top
    cantilever = MODULUS * built.FOOT_WIDTH / (shear + bending)
    assert tangential == pytest.approx(cantilever, rel=0.1)


def walk_at_2_rad_s(robot, start):
    """The walk, largest shear and load of a foot (N), and joint forces; two half turns.

    Forces are of every second time step: their peaks are within 0.5 % of all steps'.
    """
    plant = ProjectionPlant(robot, Terrain.flat(), FINE_STEP)
    rows = []
    batch = plant.batch
    batch.tracing = True
    walked = walk(plant, 2.0, 3.2, start, watch=lambda _: rows.append(batch.trace.copy()))
    trace = np.concatenate(rows)
    contact = np.abs(trace["impulses"][:, : plant.toes]).max(axis=(0, 1)) / FINE_STEP
    return walked, contact, trace_forces(plant.tables, trace[::2], FINE_STEP)


def rod_pushes(forces):
    """Name and largest push along it, N, of each rod."""
    axial = forces.link_loads()[..., 0]
    for name in ("upper_rod", "rocker", "lower_rod", "coupler"):
        body = JANSEN.names.index(name) + 1
        ends = [k for k, (b, _) in enumerate(JANSEN.corners) if b == body]
        yield name, -axial[..., ends].mean(axis=-1).min()


@pytest.fixture(scope="module", params=["built", "economy", "stroller"])
def loads(request):
    """The name of a robot, and its walks from two starts."""
    robot = ROBOTS[request.param]()
    return request.param, [walk_at_2_rad_s(robot, start) for start in (0.0, 0.5 * math.pi)]


@pytest.mark.slow
def test_bearings_have_the_friction_of_their_mean_load(loads):
    """The loads in the code are those of a walk, within 1.5 N; friction is mu r F, in tenths of mN
    m.
    """
    name, walks = loads
    robot = ROBOTS[name]()
    known = BEARING_LOADS[name]
    mean = np.mean([forces.magnitude.mean(axis=(0, 1)) for *_, forces in walks], axis=0)
    pins = {frozenset(pin[1:]): load for pin, load in zip(JANSEN.pins, mean, strict=True)}
    measured = [pins[frozenset(pair)] for pair in JANSEN.bearings]
    np.testing.assert_allclose(known, measured, atol=1.5)
    for torque, load in zip(robot.bearing_friction, known, strict=True):
        assert torque == pytest.approx(0.11 * 3e-3 * load, abs=5.1e-5)


@pytest.mark.slow
def test_a_walk_at_2_rad_s_is_borne(loads):
    """Feet, rods (buckling, with a factor of three), pins' holes and motor (rated at 6 N m) bear it
    from either start.
    """
    robot = ROBOTS[loads[0]]()
    walks = loads[1]
    for walked, (shear, normal, *_), forces in walks:
        assert normal < tread_load(COMPRESSION) and shear < SHEAR
        assert 10.0 * forces.magnitude.max() < HOLE
        assert walked.rms_torque < 0.5 * 6.0 and walked.peak_torque < robot.motor.torque_limit
        for name, push in rod_pushes(forces):
            buckling = built.buckling_load(robot.body(name).length, built.bar_thickness(name))
            assert buckling > 3.0 * push, name


PERMISSIBLE = {
    "aluminium": (tread_load(COMPRESSION), SHEAR, HOLE / 3.0, 6.0),
    # Rubber 2 mm thick; plywood at 31 MPa under M3, thrice; a quarter of the motor's stall.
    "weekend": (6e4 * COMPRESSION * 2e-3, 1.5e4 * 0.28 * 2e-3, 31e6 * 3e-3 * 3e-3 / 3.0, 0.17),
}
"""Of a foot's load and shear and of a pin, N; of the motor's RMS torque, N m."""
PLYWOOD_MODULUS = 8.2e9  # Pa, bending along the face grain


@pytest.mark.slow
@pytest.mark.parametrize(
    "name, command",
    [
        *(("onboard", command) for command in (0.05, 0.1, 0.15, 0.2, 0.25, 0.3)),
        *(("weekend", command) for command in (0.03, 0.06, 0.09, 0.12)),
        *(("stroller", command) for command in (0.2, 0.4)),
        *(("economy", command) for command in (0.3, 0.5)),
    ],
)
def test_the_policies_walks_are_borne(name, command):
    """Ten walks of 6 s from rest keep all ratings, of motor, feet, rods and pins' holes."""
    policy = pretrained.load(ID, name)
    load, shear, pin, rated = PERMISSIBLE["weekend" if name == "weekend" else "aluminium"]
    env = gym.make(ID, **policy.env_kwargs, time_step=FINE_STEP)
    robot = env.unwrapped.robot
    plant = env.unwrapped.plant.batch
    worst = np.zeros(5)
    plant.tracing = True
    for seed in range(10):
        seen, _ = env.reset(seed=seed, options={"speed_command": command})
        rows = []
        torques = []
        for _ in range(300):
            seen, _, fallen, _, info = env.step(policy.predict(seen)[0])
            assert not fallen
            rows.append(plant.trace.copy())
            torques.append(info["crank_torque"])
        trace = np.concatenate(rows)
        contact = np.abs(trace["impulses"][:, : plant.toes]).max(axis=(0, 1)) / FINE_STEP
        if name != "weekend":
            loads = loads_of_walk(robot, trace, FINE_STEP, 0.0)
            safety = loads["rod_safety"]
            force = loads["pin_force"]
        else:
            hardest = trace[np.argsort(np.abs(trace["impulses"]).sum(axis=(1, 2)))[-1000:]]
            forces = trace_forces(compile_robot(robot), hardest, FINE_STEP)
            safety = plywood_safety(robot, forces)
            force = forces.magnitude.max()
        rms = np.sqrt(np.mean(np.square(torques)))
        worst = np.maximum(worst, [contact[1], contact[0], force, rms, 1.0 / safety])
        assert np.max(np.abs(torques)) < robot.motor.torque_limit
    print(name, command, worst)
    assert (worst < [load, shear, pin, rated, 1.0 / 3.0]).all()


def plywood_safety(robot, forces):
    """Least safety of a rod of the weekend robot against buckling."""
    stiffness = PLYWOOD_MODULUS * built.PLYWOOD.width / built.STIFFNESS / built.WIDTH
    return min(
        stiffness * built.buckling_load(robot.body(name).distance(0, 1), thickness=3e-3) / push
        for name, push in rod_pushes(forces)
    )


@pytest.mark.parametrize("start", [0.0, 0.2 * math.pi])
def test_touchdowns_are_resolved(start):
    """Half the time step changes the largest loads of a first step from rest at 4 N m by less than
    5 %.
    """
    largest = []
    for step in (FINE_STEP, 0.5 * FINE_STEP):
        plant = ProjectionPlant(built_robot(), Terrain.flat(), step)
        rows = []
        plant.reset(crank_angle=start)
        plant.batch.tracing = True
        for _ in range(25):
            plant.step(4.0, 0.02)
            rows.append(plant.batch.trace.copy())
        traced = np.concatenate(rows)
        contact = np.abs(traced["impulses"][:, : plant.toes]).max(axis=(0, 1)) / step
        pins = trace_forces(plant.tables, traced, step).magnitude.max(axis=(0, 1))
        largest.append([*contact[:2], *pins])
    assert largest[0][1] > 600.0  # N, touched down
    np.testing.assert_allclose(largest[1], largest[0], rtol=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("speed", [1.0, 1.5])
def test_it_walks_under_the_papers_pid(speed):
    """The crank keeps its speed within 2 %.

    Speed, cost and slip agree within 10 % on both backends.
    """
    walks = [walk(make(built_robot(), Terrain.flat()), speed, 2.5) for make in PLANTS.values()]
    for walked in walks:
        assert not walked.fell and walked.crank_speed == pytest.approx(speed, rel=0.02)
        assert walked.speed > 0.05 * speed and walked.electrical > walked.cost_of_transport > 0.0
    for name in ("speed", "slip", "rms_torque", "cost_of_transport", "electrical"):
        assert getattr(walks[0], name) == pytest.approx(getattr(walks[1], name), rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name, speed, pid",
    [
        ("economy", 2.0, PAPER_PID),
        ("hiker", 2.0, PAPER_PID),
        ("stroller", 2.0, PAPER_PID),
        ("weekend", 4.0, SMALL),
    ],
)
def test_machines_have_three_witnesses(name, speed, pid):
    """Speed and cost agree within 1 % on both backends (weekend: 2 %), and with MuJoCo within 5.5
    %.
    """
    from mujoco_backend import MujocoPlant

    robot = ROBOTS[name]()
    ground = Terrain.flat()
    ours, rigid, theirs = (
        walk(plant, speed, 3.2, pid=pid)
        for plant in (
            ProjectionPlant(robot, ground),
            RigidBodyPlant(robot, ground),
            MujocoPlant(robot, ground),
        )
    )
    for value in ("speed", "cost_of_transport"):
        off = 0.02 if name == "weekend" else 0.01
        assert getattr(rigid, value) == pytest.approx(getattr(ours, value), rel=off)
        assert getattr(theirs, value) == pytest.approx(getattr(ours, value), rel=0.055)
    if name == "economy":  # half as dear as the built robot
        built = walk(ProjectionPlant(built_robot(), ground), speed, 3.2)
        assert ours.speed > 1.5 * built.speed
        assert ours.cost_of_transport < 0.55 * built.cost_of_transport


def test_motors_are_those_of_the_sheets():
    """Efficiency follows from stall current and no-load speed; armatures and the motor constant
    agree.
    """
    for motor, volts, amperes in (("mx_106", 12.0, 5.2), ("xm540_w270", 12.0, 4.4)):
        share = MOTORS[motor].stall_torque / amperes / (volts / MOTORS[motor].no_load_speed)
        assert MOTORS[motor].efficiency == pytest.approx(share, abs=0.002)
    for motor, speed in (("mx_106", 45.0), ("xm540_w270", 30.0)):
        assert MOTORS[motor].no_load_speed == pytest.approx(speed * np.pi / 30.0, abs=0.005)
    armature = MOTORS["mx_106"].rotor_inertia * MOTORS["mx_106"].gear_ratio ** 2
    assert armature == pytest.approx(0.0266, rel=1e-2)
    assert MOTORS["ak80_6"].winding == pytest.approx(1.0 / (6.0 * 0.2206) ** 2, rel=1e-3)
