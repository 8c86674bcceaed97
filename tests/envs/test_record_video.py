"""Gymnasium's and Stable-Baselines3's recorders through all APIs: the film is what was rendered."""

import gymnasium as gym
import imageio.v3 as iio
import numpy as np
import pytest
from gymnasium.wrappers.vector import RecordVideo as RecordVectorVideo
from stable_baselines3.common.vec_env import VecVideoRecorder

from jansen_env.sb3 import make_vec_env

pytest.importorskip("moviepy", reason="moviepy, which the recorders need, is not installed")
STEPS = 5


def film(folder):
    """The frames of the one film in a folder, and how many there are per second."""
    (path,) = folder.glob("*.mp4")
    return iio.imread(path), iio.immeta(path)["fps"]


def check(folder, pictures, fps):
    frames, rate = film(folder)
    assert (rate, frames.shape) == (fps, np.shape(pictures))
    assert np.abs(frames.astype(int) - pictures).mean() < 3.0  # of 255; the codec loses some


def test_of_many_robots(tmp_path):
    envs = gym.make_vec("JansenWalker-v0", num_envs=2, render_mode="rgb_array")
    envs = RecordVectorVideo(envs, str(tmp_path / "films"), video_aspect_ratio=(1, 2))
    envs.reset(seed=0)
    for _ in range(STEPS):
        envs.step(np.ones((2, 1), np.float32))
    pictures = envs.unwrapped.render()
    envs.close()
    frames, fps = film(tmp_path / "films")
    assert fps == 50 and len(frames) >= STEPS
    height, width = pictures[0].shape[:2]
    assert frames.shape[1] * frames.shape[2] >= 2 * height * width
    assert np.abs(frames[-1].astype(int) - frames[0]).mean() > 0.1


def test_of_the_vec_env(tmp_path):
    venv = make_vec_env("JansenWalker-v0", 2, env_kwargs={"render_mode": "rgb_array"})
    venv = VecVideoRecorder(venv, str(tmp_path), lambda step: step == 0, video_length=STEPS)
    venv.seed(0)
    venv.reset()
    pictures = [venv.render()]
    for _ in range(STEPS - 1):
        venv.step(np.ones((2, 1), np.float32))
        pictures.append(venv.render())
    venv.close()
    check(tmp_path, pictures, 50)
