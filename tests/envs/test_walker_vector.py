"""Gymnasium's vector interface: threads, masks, information, attributes, refusals, divergence."""

from threading import Thread

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from side_by_side import compare, same, side_by_side, together

from jansen_env.tasks.walking import JansenWalkerVectorEnv

MODES = [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP]


def test_threads_do_not_change_a_bit():
    """Half of many robots start again while the others move, on ever more threads."""
    runs = []
    for threads in (1, 2, 6, 6, 6):
        env = together(192, threads=threads, limit=[2 + i % 2 for i in range(192)])
        env.reset(seed=1)
        rng = np.random.default_rng(2)
        steps = [env.step(rng.uniform(-1, 1, (192, 1)).astype(np.float32)) for _ in range(60)]
        runs.append(np.concatenate([np.append(step[0], step[1]) for step in steps]))
        env.close()
    assert all(np.array_equal(run, runs[0]) for run in runs)


def test_threads_that_share_an_environment_take_turns():
    """Otherwise the process would end: kernels run without Python's lock."""
    arguments = {"terminate_when_fallen": False, "threads": 2}
    envs, twins = (gym.make_vec("JansenWalkerRough-v0", 32, **arguments) for _ in range(2))
    action = np.full((32, 1), 0.4, np.float32)
    for batch in (envs, twins):
        batch.reset(seed=1)
    threads = [Thread(target=lambda: [envs.step(action) for _ in range(20)]) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for _ in range(60):
        twins.step(action)
    assert (envs.step(action)[0] == twins.step(action)[0]).all()


def test_a_thread_that_changes_robots_waits_for_steps():
    """Otherwise robots would be moved while they are half changed, and diverge."""
    arguments = {"terminate_when_fallen": False, "threads": 2}
    envs = gym.make_vec("JansenWalkerRough-v0", 32, **arguments).unwrapped
    diverged = []
    envs.reset(seed=1)

    def steps():
        action = np.full((32, 1), 0.4, np.float32)
        diverged.extend(envs.step(action)[4]["diverged"].any() for _ in range(200))

    thread = Thread(target=steps)
    thread.start()
    k = 0
    while thread.is_alive():
        k = (k + 1) % 32
        envs.set_parameters(k, payload=float(k % 3))
        envs.set_state(k, envs.get_state(k))
    assert len(diverged) == 200 and not any(diverged)


def test_a_mask_resets_some():
    """The other robots continue bit for bit.

    A mask must have one flag for each robot, with at least one set.
    """
    ours = together(4, AutoresetMode.DISABLED)
    theirs = side_by_side(4, AutoresetMode.DISABLED)
    rng = np.random.default_rng(0)
    ours.reset(seed=3), theirs.reset(seed=3)
    for _ in range(10):
        action = rng.uniform(-1.0, 1.0, (4, 1)).astype(np.float32)
        ours.step(action), theirs.step(action)
    mask = np.array([True, False, False, True])
    seeds = [11, None, None, 14]
    options = {"speed_command": 0.3}
    a, info_a = ours.reset(seed=seeds, options={"reset_mask": mask.copy(), **options})
    b, info_b = theirs.reset(seed=seeds, options={"reset_mask": mask.copy(), **options})
    assert np.array_equal(a, b)
    same(info_a, info_b)
    for _ in range(10):
        action = rng.uniform(-1.0, 1.0, (4, 1)).astype(np.float32)
        assert np.array_equal(ours.step(action)[0], theirs.step(action)[0])
    for bad, error in (([True] * 4, TypeError), (np.ones(4), TypeError), (np.zeros(4, bool), None)):
        with pytest.raises(error or ValueError, match="reset_mask"):
            ours.reset(options={"reset_mask": bad})


def test_an_action_that_is_ignored_may_be_anything():
    env = together(2, limit=1)
    env.reset(seed=0)
    env.step(np.full((2, 1), 0.2, np.float32))
    env.step(np.full((2, 1), np.nan))
    before = [env.get_state(i)["record"]["action"] for i in range(2)]
    with pytest.raises(ValueError, match=r"actions\[1\] must be finite, got nan"):
        env.step(np.array([[1.0], [np.nan]]))
    assert [env.get_state(i)["record"]["action"] for i in range(2)] == before  # as all of the state


@pytest.mark.parametrize("mode", MODES)
def test_information_on_request(mode):
    """With ``info_keys`` infos have these keys and no others; all else is the same bit for bit."""
    keys = ("slip", "energy", "reward/slip", "fallen")
    ours, whole, silent = (together(4, mode, 5, info_keys=wanted) for wanted in (keys, None, ()))
    at_ends = {"final_obs", "_final_obs", "final_info", "_final_info"}
    for seed in (1, 2):
        infos = [env.reset(seed=seed)[1] for env in (ours, whole, silent)]
        assert not infos[2] and set(infos[0]) == {*keys, *(f"_{key}" for key in keys)}
        for _ in range(12):
            steps = [env.step(np.full((4, 1), 0.3, np.float32)) for env in (ours, whole, silent)]
            for a, b, c in zip(*(step[:4] for step in steps), strict=True):
                assert np.array_equal(a, b) and np.array_equal(a, c)
            asked, full, none = (step[4] for step in steps)
            given = set(asked) - at_ends
            assert set(none) <= at_ends and given <= {*keys, *(f"_{key}" for key in keys)}
            same(*({key: info[key] for key in sorted(given)} for info in (asked, full)))


def test_members_can_be_asked_and_told():
    """A value that is set holds from the next reset on, as if the environment had been made with
    it.
    """
    env = together(3, friction=0.5, limit=7, reset_noise_scale=[0.1, 0.2, 0.3])
    assert env.get_attr("max_episode_steps") == (7.0,) * 3
    assert env.get_attr("reset_noise_scale") == (0.1, 0.2, 0.3)
    assert together(2, torque_limit=np.array([8.0, 5.0])).get_attr("torque_limit") == (8.0, 5.0)
    assert env.get_attr("np_random")[0] is env.np_random[0] and env.call("friction") == (0.5,) * 3
    with pytest.raises(AttributeError, match="reset"):
        env.call("reset")
    changes = {"friction": [0.1, 0.2, 0.3], "payload": 2.0, "speed_command": 0.4}
    for name, value in changes.items():
        env.set_attr(name, value)
    assert env.get_attr("friction") == (0.1, 0.2, 0.3)
    with pytest.raises(TypeError, match="terrain"):
        env.set_attr("terrain", "flat")
    for name, value in (
        ("friction", -1.0),
        ("payload", None),
        ("friction", [0.1]),
        ("friction", [0.5, 0.5, -1]),
    ):
        with pytest.raises(ValueError, match=f"{name}|entries"):
            env.set_attr(name, value)
    assert env.get_attr("friction") == (0.1, 0.2, 0.3)
    compare(env, together(3, limit=7, reset_noise_scale=[0.1, 0.2, 0.3], **changes), 20)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"friction": np.ones(3)}, "friction"),
        ({"payload": [1.0]}, "payload"),
        ({"terrain": ["flat", "flat", "flat"]}, "terrain"),
        ({"speed_command": np.ones(3)}, "speed_command"),
        ({"plant": "rigid_body"}, "vectorization_mode='sync'"),
        ({"joint_play": 3e-4}, "joint_play must be .*vectorization_mode='sync'"),
        ({"track_joint_forces": True}, "track_joint_forces"),
        ({"render_mode": "human"}, "render_mode"),
        ({"autoreset_mode": "never"}, "autoreset_mode must be .*, got 'never'"),
        ({"friction": [[0.1], 0.2]}, "friction"),
    ],
)
def test_bad_arguments(arguments, named):
    with pytest.raises(ValueError, match=named):
        JansenWalkerVectorEnv(**{"num_envs": 2, **arguments})


def test_bad_calls():
    """Steps before a reset, after an end, or with bad actions are refused, and so are seeds and
    options for too few robots.
    """
    env = together(2, AutoresetMode.DISABLED, limit=1)
    action = np.zeros((2, 1), np.float32)
    with pytest.raises(gym.error.ResetNeeded):
        env.step(action)
    env.reset(seed=0)
    for bad in (np.zeros(2), np.full((2, 1), np.nan), np.zeros((3, 1)), "ab"):
        with pytest.raises(ValueError, match="actions"):
            env.step(bad)
    env.step(action)
    with pytest.raises(gym.error.ResetNeeded):
        env.step(action)
    for arguments, named in (
        ({"seed": [1]}, "seed"),
        ({"seed": 1.0}, "seed must be .*, got 1.0"),
        ({"options": {"speed_command": [0.1]}}, "speed_command"),
        ({"options": {"speed": 0.1}}, "speed"),
    ):
        with pytest.raises(ValueError, match=named):
            env.reset(**arguments)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.filterwarnings("ignore:.*the episode:UserWarning")
def test_a_robot_that_diverges_ends_its_own_episode_only(mode):
    """Robot 1 gets an absurd torque now and then.

    The others continue as each does alone, bit for bit.
    """
    arguments = {"torque_limit": 1e8, "reset_noise_scale": 1.0}
    ours, theirs = together(4, mode, limit=30, **arguments), side_by_side(4, mode, 30, **arguments)
    rng = np.random.default_rng(0)
    diverged = np.zeros(4, int)
    ours.reset(seed=3)
    theirs.reset(seed=3)
    for k in range(50):
        action = rng.uniform(-1e-7, 1e-7, (4, 1)).astype(np.float32)
        action[1] = 1.0 if k % 9 == 5 else action[1]
        *a, info_a = ours.step(action)
        *b, info_b = theirs.step(action)
        for x, y in zip(a, b, strict=True):
            assert np.array_equal(x, y) and np.isfinite(x).all()
        same(info_a, info_b)
        now = info_a["final_info"]["diverged"] if "final_info" in info_a else info_a["diverged"]
        assert not (now & ~(a[2] | a[3])).any()
        diverged += now
    assert diverged[1] >= 5 and not diverged[[0, 2, 3]].any()
    ours.close()
    theirs.close()
