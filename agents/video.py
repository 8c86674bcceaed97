"""Videos of a policy: an episode's frames, written as GIF or MP4."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import imageio.v3 as iio
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from agents.policy import Policy
from agents.rollout import make_env
from jansen_env.files import write_whole

FRAME_TIME = {".gif": 0.06, ".mp4": 0.02}  # s from one frame to the next
GIF_WIDTH, GIF_COLOURS = 480, 64


def record_video(policy: Policy, env_id: str, env_kwargs: dict[str, Any], command: float, seed: int,
                 path: str | Path, seconds: float = 6.0) -> None:  # fmt: skip
    """A video of one episode at a commanded speed, to a .gif or .mp4 file."""
    env: Any = make_env(env_id, env_kwargs, render_mode="rgb_array")
    dt = env.unwrapped.control_dt
    every = max(1, round(FRAME_TIME[Path(path).suffix] / dt))
    observation, _ = env.reset(seed=seed, options={"speed_command": command})
    frames, state = [], None
    for step in range(round(seconds / dt)):
        if step % every == 0:
            frames.append(env.render())
        actions, state = policy.predict(observation[None], state, np.array([step == 0]), True)
        observation, _, terminated, truncated, _ = env.step(actions[0])
        if terminated or truncated:
            break
    env.close()
    save_video(frames, path, every * dt)


def save_video(frames: Sequence[NDArray[np.uint8]], path: str | Path, frame_time: float) -> None:
    """Write frames atomically as an endlessly repeating .gif (delays in whole 10 ms), or as .mp4.

    Args:
        frames: (height, width, 3) uint8, of one even size, at least one.
        path: file to write or replace. frame_time: s from one to the next.

    Raises:
        ValueError: no frames, or another suffix.
    """
    suffix = Path(path).suffix
    if suffix not in FRAME_TIME or len(frames) == 0:
        raise ValueError(f"{path} with {len(frames)} frames, must be {list(FRAME_TIME)} with some")
    if suffix == ".mp4":
        write_whole(
            path,
            lambda name: iio.imwrite(
                name, np.stack(frames), plugin="FFMPEG", fps=1.0 / frame_time, macro_block_size=2
            ),
        )
        return
    height, width = frames[0].shape[:2]
    size = (GIF_WIDTH, round(height * GIF_WIDTH / width))
    images = [Image.fromarray(frame).resize(size, Image.Resampling.LANCZOS) for frame in frames]
    # One palette for all, or still parts would flicker; an octree keeps a toe's few red pixels.
    palette = images[0].quantize(GIF_COLOURS, Image.Quantize.FASTOCTREE)
    first, *others = (im.quantize(palette=palette, dither=Image.Dither.NONE) for im in images)
    write_whole(
        path,
        lambda name: first.save(
            name, save_all=True, append_images=others, duration=1e3 * frame_time, loop=0
        ),
    )
