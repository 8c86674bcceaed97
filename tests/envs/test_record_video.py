"""Gymnasium's and Stable-Baselines3's recorders: the film of robots that move together."""

import gymnasium as gym
import imageio.v3 as iio
import numpy as np
import pytest
from gymnasium.wrappers.vector import RecordVideo
from stable_baselines3.common.vec_env import VecVideoRecorder

from jansen_env.sb3 import make_vec_env

pytest.importorskip("moviepy", reason="moviepy, which the recorders need, is not installed")
STEPS = 5


def of_gymnasium(folder):
    envs = gym.make_vec("JansenWalker-v0", num_envs=2, render_mode="rgb_array")
    return RecordVideo(envs, str(folder), video_aspect_ratio=(1, 2))


def of_stable_baselines3(folder):
    venv = make_vec_env("JansenWalker-v0", 2, env_kwargs={"render_mode": "rgb_array"})
    return VecVideoRecorder(venv, str(folder), lambda step: step == 0, video_length=STEPS)


@pytest.mark.parametrize("make", [of_gymnasium, of_stable_baselines3])
def test_the_film_is_of_both_robots_and_moves(make, tmp_path):
    envs = make(tmp_path)
    envs.reset()
    pictures = envs.unwrapped.render()
    for _ in range(STEPS):
        envs.step(np.ones((2, 1), np.float32))
    envs.close()
    (path,) = tmp_path.glob("*.mp4")
    frames = iio.imread(path)
    assert iio.immeta(path)["fps"] == 50 and len(frames) >= STEPS
    assert frames[0].size >= np.size(pictures)
    assert np.abs(frames[-1].astype(int) - frames[0]).mean() > 0.1
