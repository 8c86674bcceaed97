"""Joint forces of a walk: each time step's trace balances, landings are impulses, not forces."""

from dataclasses import replace

import numpy as np
import pytest
from motions import HOLD, governor, placed

from jansen_env import Payload, Robot, Terrain
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.plants.trace import pads_in_contact, trace_forces
from jansen_env.tasks.walking import JansenWalkerEnv

LADEN = replace(Robot(), payload=Payload(1.0, 0.1, (0.1, 0.2)))


def standing(robot=None, terrain=None, crank_angle=1.0, time_step=1e-3, **settings):
    """A traced plant, set down at rest."""
    return placed(robot, terrain, crank_angle, tracing=True, time_step=time_step, **settings)


def walk(plant, duration):
    """Hold the crank near 1 rad/s; trace and landings of all time steps."""
    rows = []
    landed = []
    for _ in range(round(duration / HOLD)):
        plant.step(governor(plant), HOLD)
        rows.append(plant.batch.trace)
        landed.append(plant.batch.touchdowns)
    return np.concatenate(rows), np.concatenate(landed)


def dropped(time_step, height=0.05, duration=0.15):
    """From a height onto one fore toe: 0.1 s of free fall, then the landing."""
    plant = standing(crank_angle=0.3, time_step=time_step)
    plant.reset(0.0, 0.3, pitch=0.2)
    plant.state = plant.state + height * np.eye(8)[1]
    plant.step(0.0, duration)
    return plant


@pytest.mark.parametrize(
    "robot, terrain",
    [(Robot(), Terrain.flat()), (LADEN, Terrain.slope(0.1))],
    ids=["paper", "laden, slope"],
)
def test_every_time_step_balances(robot, terrain):
    """In every step of a walk the forces' torque is the motor's, and the frames carry the load.

    Torque and moment, as well as two passes over the speed-dependent terms, solve the step to h^2.
    """
    typical = []
    for time_step in (1e-3, 5e-4):
        plant = standing(robot, terrain, time_step=time_step)
        trace, landed = walk(plant, 1.0)
        forces = trace_forces(plant.tables, trace, time_step)
        a = forces.q_ddot
        load = robot.payload
        speed = 0.5 * (trace["velocity_before"] + trace["velocity_after"])[:, 2]  # of the pitch
        arm = complex(*load.position) * np.exp(1j * trace["pose"][:, 2])
        carried = a[:, 0] + 1j * a[:, 1] + (1j * a[:, 2] - speed**2) * arm + 1j * GRAVITY
        carried *= load.mass
        x, y, moment = -forces.frame.sum(axis=1).T
        assert np.abs(x + 1j * y - carried).max() <= 1e-9
        moment -= trace["torque"] + load.inertia * a[:, 2] + (arm.conjugate() * carried).imag
        miss = np.abs([forces.torque - trace["torque"], moment])
        assert miss.max() <= 1e-5 and landed.sum() > 2
        assert miss[:, ~landed].max() <= 1e-6
        typical.append(np.median(miss, axis=1))
    assert (typical[0] <= 1e-8).all() and (typical[0] / typical[1] > 3.0).all()


def test_traced_impulses_are_the_results():
    """Impulses on the toes add up to the step's mean contact force, on a slope too, to rounding."""
    angle = 0.1
    plant = standing(terrain=Terrain.slope(angle))
    for _ in range(50):
        result = plant.step(5.0, HOLD)
        impulse = plant.batch.trace["impulses"].sum(axis=0)[:4, :2]
        tangent = np.array([np.cos(angle), np.sin(angle)])
        along = impulse @ np.column_stack([tangent, [-tangent[1], tangent[0]]])
        assert along == pytest.approx(HOLD * result.contact_force, abs=1e-12)


def test_landing_impulse_of_a_drop_does_not_depend_on_the_time_step():
    """A drop by 5 cm onto one toe agrees to 1 % with half the time step; before it, the robot falls
    free of force.
    """
    plants = [dropped(h) for h in (1e-3, 5e-4)]
    loads = [plant.batch.peak_loads() for plant in plants]
    assert loads[0][1] == pytest.approx(loads[1][1], rel=0.01)
    assert loads[0][0] == pytest.approx(loads[1][0], rel=0.01)
    for plant in plants:
        assert plant.batch.touchdowns.sum() == 1
        steps = slice(0, np.flatnonzero(plant.batch.touchdowns)[0])
        forces = trace_forces(plant.tables, plant.batch.trace, plant.time_step)
        assert np.abs(forces.magnitude[steps]).max() <= 1e-9


def test_landings_across_steps():
    """A toe in contact at the end of one :meth:`step` does not land at the beginning of the next.

    After a state was set, what is pressed counts as landing, unless it is said what was pressed.
    """
    plant = dropped(1e-3, duration=0.1)
    assert not plant.batch.touchdowns.any()
    seen = []
    for _ in range(5):
        plant.batch.joint_forces()
        plant.step(0.0, 1e-3)
        seen.append(plant.batch.touchdowns.tolist())
    assert seen.count([True]) == 1
    down = plant.state
    plant.state = down + np.eye(8)[1]
    plant.step(0.0, 1e-3)
    assert not pads_in_contact(plant.batch.trace).any()
    plant.state = down
    plant.step(0.0, 1e-3)
    assert pads_in_contact(plant.batch.trace).any() and plant.batch.touchdowns.all()
    in_contact = plant.batch.in_contact.copy()
    plant.state = down
    plant.batch.in_contact = in_contact
    plant.step(0.0, 1e-3)
    assert not plant.batch.touchdowns.any()


def test_joint_forces_leave_the_trace_alone():
    """Trace, landings and state of the last step stay, also where the look ahead fails."""
    plant = standing()
    walk(plant, 0.5)
    batch = plant.batch

    def kept():
        arrays = (array.tobytes() for array in (batch.trace, batch.touchdowns, batch.states))
        return *arrays, batch.peak_loads(), batch.tracing

    before = kept()
    batch.joint_forces(3.0)
    with pytest.raises(FloatingPointError):
        batch.joint_forces(1e9)
    assert kept() == before


def test_a_restored_walker_reports_the_same_loads():
    """A state is taken amid landings: ``info`` continues with the same numbers."""
    envs = [JansenWalkerEnv(track_joint_forces=True) for _ in range(2)]
    envs[0].reset(seed=0, options={"crank_angle": 1.0})
    envs[1].reset(seed=1)
    for k in range(60):
        envs[1].set_state(envs[0].get_state())
        first, second = (env.step(np.array([0.6]))[-1] for env in envs)
        for key in ("joint_force_max", "joint_impulse_max"):
            assert first[key] == second[key], k


def test_walker_info_has_the_largest_loads_when_asked():
    """They are the backend's, in every step; by default there are none, and observations and
    rewards are the same bits.
    """
    envs = [JansenWalkerEnv(track_joint_forces=on) for on in (True, False)]
    assert not JansenWalkerEnv().plant.batch.tracing
    keys = {"joint_force_max", "joint_impulse_max"}
    impulses = []
    for env in envs:
        env.reset(seed=0, options={"crank_angle": 1.0})
    for _ in range(40):
        obs, reward, *_, info = envs[0].step(np.array([0.25]))
        other, paid, *_, bare = envs[1].step(np.array([0.25]))
        assert obs.tobytes() == other.tobytes() and reward == paid
        assert info.keys() - bare.keys() == keys
        plant = envs[0].plant.batch
        forces = trace_forces(plant.tables_in_force(0), plant.trace, plant.time_step).bearing
        largest = forces[~plant.touchdowns].max(), forces[plant.touchdowns].max(initial=0.0)
        expected = largest[0], largest[1] * plant.time_step
        assert (info["joint_force_max"], info["joint_impulse_max"]) == expected
        assert 1.0 < info["joint_force_max"] < 1e3
        impulses.append(info["joint_impulse_max"])
        envs[0].joint_forces()
    assert 0.1 < max(impulses) < 10.0 and impulses.count(0.0) > 20
