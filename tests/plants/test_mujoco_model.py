"""The exported robots move in MuJoCo as on the projection plant."""

from dataclasses import replace

import numpy as np
import pytest

mujoco = pytest.importorskip("mujoco")

import mujoco_witness  # noqa: E402
from motions import SPRINGS  # noqa: E402
from mujoco_backend import MujocoPlant  # noqa: E402

from jansen_env.cli.mjcf import main  # noqa: E402
from jansen_env.plants.mujoco_model import to_mjcf  # noqa: E402
from jansen_env.plants.plant import ProjectionPlant, RigidBodyPlant  # noqa: E402
from jansen_env.robot import ROBOTS, Payload, paper_robot  # noqa: E402
from jansen_env.terrain import Terrain  # noqa: E402


@pytest.mark.slow
@pytest.mark.parametrize("name", ["paper", "klann", "chebyshev", "trotbot", "strider"])
def test_a_turn_in_the_air(name):
    assert max(mujoco_witness.in_the_air(name, 2e-4, 3e6)) < 1e-6


def test_the_first_half_second_on_the_ground():
    """Without friction only the time step differs; with friction MuJoCo's is convex."""
    smooth = [mujoco_witness.half_second("paper", 0.0, 60.0, h) for h in (2e-4, 1e-4)]
    assert smooth[0] < 1e-4
    assert smooth[1] < 0.6 * smooth[0]
    rough = [mujoco_witness.half_second("klann", 0.3, damping, 1e-4) for damping in (60.0, 6.0)]
    assert rough[0] < 6e-4
    assert rough[1] < 0.5 * rough[0]


def test_flight_with_rotor_and_payload():
    """The rotor is coupled to the chassis, and the payload is off its axis."""
    robot = ROBOTS["built"]()
    smooth = {"motor": replace(robot.motor, friction=0.0), "bearing_friction": (0.0,) * 10}
    robot = replace(robot, payload=Payload(2.0, 0.1, (0.2, 0.1)), **smooth)
    ours = ProjectionPlant(robot, Terrain.flat(), 1e-4)
    theirs = MujocoPlant(robot, Terrain.flat(), 1e-4, loop_stiffness=1e7)
    theirs.model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    ours.reset()
    ours.state = ours.state + 5.0 * np.eye(8)[1]
    theirs.reset()
    theirs.data.qpos[1] += 5.0
    for _ in range(30):
        ours.step(1.5, 0.01)
        theirs.step(1.5, 0.01)
    assert ours.state[3] > 1.0
    np.testing.assert_allclose(theirs.state, ours.state, atol=2e-4)
    np.testing.assert_allclose(theirs.state[:4], ours.state[:4], atol=1e-5)


def test_three_witnesses_agree_on_springs():
    """A sprung robot in the air: both plants and MuJoCo, after 0.3 s under 1 N m."""
    robot = replace(ROBOTS["paper_slender"](), springs=SPRINGS)
    ours = ProjectionPlant(robot, Terrain.flat(), 1e-4)
    rigid = RigidBodyPlant(robot, Terrain.flat(), 1e-4)
    theirs = MujocoPlant(robot, Terrain.flat(), 1e-4, loop_stiffness=1e7)
    theirs.model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    ours.reset(crank_angle=0.5)
    theirs.reset(crank_angle=0.5)
    ours.state = ours.state + 5.0 * np.eye(8)[1]
    theirs.data.qpos[1] += 5.0
    rigid.state = ours.state
    bare = ProjectionPlant(replace(robot, springs=()), Terrain.flat(), 1e-4)
    bare.state = start = ours.state
    for plant in (ours, rigid, theirs, bare):
        for _ in range(30):
            plant.step(1.0, 0.01)
    turned = abs(ours.state[3] - start[3])
    assert turned > 0.5
    assert abs(bare.state[3] - ours.state[3]) > 0.1  # the springs matter
    np.testing.assert_allclose(theirs.state[:4], ours.state[:4], atol=1e-6)
    np.testing.assert_allclose(rigid.state[:4], ours.state[:4], atol=1e-3 * turned)


def test_dry_friction_holds():
    robot = replace(paper_robot(), bearing_friction=(0.5,) * 10)
    model = mujoco.MjModel.from_xml_string(to_mjcf(robot, gravity=0.0))
    data = mujoco.MjData(model)
    data.ctrl[0] = 1.0  # of some 20 N m
    mujoco.mj_step(model, data, 1000)
    assert abs(data.qpos[0]) < 1e-4


@pytest.mark.parametrize("name", ROBOTS)
def test_every_robot_stands_on_a_slope(name):
    model = mujoco.MjModel.from_xml_string(to_mjcf(ROBOTS[name](3), Terrain.slope(0.1)))
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 200)
    assert data.ncon > 0
    assert np.abs(data.qvel).max() < 2.0
    assert model.body_mass.sum() == pytest.approx(ROBOTS[name](3).mass)


def test_what_cannot_be_exported_is_refused(tmp_path, capsys):
    with pytest.raises(ValueError, match="must have one"):
        to_mjcf(paper_robot(), Terrain(((-1.0, 0.0), (0.0, 0.0), (1.0, 1.0))))
    with pytest.raises(SystemExit):
        main(["nobody"])
    main(["klann", "--out", str(tmp_path / "klann.xml")])
    main(["klann"])
    text = (tmp_path / "klann.xml").read_text(encoding="utf-8")
    assert text == capsys.readouterr().out
    assert mujoco.MjModel.from_xml_string(text).nu == 1
