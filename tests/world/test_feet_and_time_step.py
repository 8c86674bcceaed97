"""Time steps that are too long for compliant feet are refused wherever feet or time step change."""

import gymnasium as gym
import numpy as np
import pytest
from motions import DESIGNS, ODD

from jansen_env import ROBOTS, Compliance
from jansen_env.dynamics.pads import pad_layout
from jansen_env.dynamics.reduced import lightest_mass
from jansen_env.plants.rigid import bodies

REFUSED = "time_step must be at most .* s for feet of .* N/m and .* N s/m, .* got "
STIFF = Compliance(1e7, 100.0)


@pytest.mark.parametrize(
    "arguments",
    [
        {"time_step": 0.01},
        {"pad_compliance": STIFF},
        {"pad_compliance": Compliance(1e5, 2e3)},
        {"pad_compliance": Compliance(1e5, 10.0, 1e7)},
        {"time_step": 0.005, "randomize": {"foot_stiffness_scale": (0.5, 9.0)}},
        {"time_step": 0.005, "randomize": {"mass_scale": (0.1, 1.0)}},
    ],
)
@pytest.mark.parametrize("env_id", ["JansenWalkerBuilt-v0", "JansenGoal-v0"])
def test_refused_at_construction(env_id, arguments):
    """One robot or many are refused, whatever makes the feet too stiff: a range may not reach that
    far.
    """
    with pytest.raises(ValueError, match=REFUSED):
        gym.make(env_id, **{"robot": "built", **arguments})
    with pytest.raises(ValueError, match=REFUSED):
        gym.make_vec(env_id, 2, **{"robot": "built", **arguments})


@pytest.mark.parametrize(
    "change", [{"pad_compliance": STIFF}, {"foot_stiffness_scale": 9.0}, {"mass_scale": 0.1}]
)
def test_refused_later(change):
    """`set_parameters` and options of a reset refuse them, and nothing has changed then."""
    env = gym.make("JansenWalkerBuilt-v0", time_step=0.005)
    env.reset(seed=0)
    before = repr(env.unwrapped.get_state())
    with pytest.raises(ValueError, match=REFUSED + "0.005"):
        env.unwrapped.set_parameters(**change)
    if "pad_compliance" not in change:
        with pytest.raises(ValueError, match=REFUSED + "0.005"):
            env.reset(options=change)
    assert repr(env.unwrapped.get_state()) == before


def test_what_is_not_refused():
    """Rigid feet have no limit, a held chassis has no ground; the packaged robots walk at 1 ms."""
    gym.make("JansenWalker-v0", time_step=0.01).reset(seed=0)
    gym.make("JansenCrank-v0", robot="built", time_step=0.01).reset(seed=0)
    for name in ROBOTS:
        gym.make("JansenWalkerRough-v0", robot=name).reset(seed=0)


@pytest.mark.parametrize("time_step", [2e-3, 5e-3, 6.7e-3])
def test_the_longest_time_steps_walk(time_step):
    """Just below the limit nothing explodes, and the energy is accounted for."""
    control_dt = 4.0 * time_step
    env = gym.make("JansenWalkerBuilt-v0", time_step=time_step, control_dt=control_dt)
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    speed = missed = 0.0
    for _ in range(300):
        action = rng.uniform(-1.0, 1.0, 1).astype(np.float32)
        _, _, terminated, truncated, info = env.step(action)
        speed = max(speed, abs(info["x_velocity"]))
        missed = max(missed, abs(info["energy"]["residual"]))
        if terminated or truncated:
            env.reset()
    assert speed < 5.0 and missed < 0.5


@pytest.mark.parametrize("name", ["built", "weekend", "klann", "trotbot", "odd"])
def test_lightest_mass_is_that_of_the_bodies(name):
    """The bodies of the rigid-body backend, by their mass matrix, agree within 3 %."""
    robot = ODD if name == "odd" else DESIGNS[name]
    owners = bodies.pad_bodies(robot, pad_layout(robot))
    least = np.inf
    for motion in bodies.turn_motions(robot):
        x, y = (motion.pads - motion.poses[owners, 1:]).T[..., None]
        spin, vx, vy = motion.rates[:, owners].T
        J = np.stack([vx - spin * y + spin * robot.pad_radius, vy + spin * x], axis=1)
        W = J @ np.linalg.inv(motion.mass_matrix) @ J.swapaxes(1, 2)
        least = min(least, 1.0 / np.linalg.eigvalsh(W)[:, -1].max())
    assert lightest_mass(robot) == pytest.approx(least, rel=0.03)
