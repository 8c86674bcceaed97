"""Films: pictures written as one GIF with one palette."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from jansen_env.checks import positive, positive_integer, within
from jansen_env.files import write_whole

Picture = NDArray[np.uint8]


def _palette(pixels: Picture, colors: int) -> Picture:
    """At most ``colors`` (n, 3) of the colours of ``pixels`` (m, 3): frequent ones, far apart.

    Averaging methods such as median cut would turn a small red toe among orange cranks orange.
    """
    shades, counts = np.unique(pixels, axis=0, return_counts=True)
    ordered = shades[np.argsort(-counts)].astype(int)
    chosen: list[NDArray[np.int_]] = []
    for distance in (64, 48, 32, 24, 16, 12, 8, 4, 0):  # the widest that fills the palette
        chosen, left = [], ordered
        while len(left) and len(chosen) < colors:
            chosen.append(left[0])
            left = left[((left - left[0]) ** 2).sum(axis=1) > distance**2]
        if len(chosen) == colors:
            break
    return np.array(chosen, dtype=np.uint8)


def save_gif(
    frames: Sequence[Picture],
    path: str | Path,
    fps: float,
    width: int | None = None,
    colors: int = 128,
) -> None:
    """Write an endlessly repeating GIF, whole or not at all, with one palette for all its frames.

    Args:
        frames: (height, width, 3) uint8 pictures of one size, at least one.
        path: file to write or replace.
        fps: pictures per second, at most 50 (viewers slow faster files down).
        width: of the file's pictures, pixels; None keeps the frames' own.
        colors: size of the palette, 2 to 256.

    Raises:
        ValueError: an argument out of range.
    """
    if len(frames) == 0:
        raise ValueError("frames is empty, must have at least one picture")
    within("fps", positive("fps", fps), 0.0, 50.0)
    within("colors", positive_integer("colors", colors), 2, 256)
    rows, columns = frames[0].shape[:2]
    across = columns if width is None else positive_integer("width", width)
    size = (across, max(1, round(rows * across / columns)))
    images = [Image.fromarray(frame).resize(size, Image.Resampling.LANCZOS) for frame in frames]
    palette = Image.new("P", (1, 1))
    some = images[:: max(1, len(images) // 8)]
    pixels = np.concatenate([np.asarray(image).reshape(-1, 3) for image in some])
    palette.putpalette(_palette(pixels, colors).tobytes())
    indexed = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images]
    # Delays are whole centiseconds: rounding their running sum keeps the film's length right.
    ticks = np.round(np.arange(len(indexed) + 1) * 100.0 / fps).astype(int)
    delays = [10 * int(shown) for shown in np.diff(ticks)]
    options: dict[str, Any] = {"save_all": True, "append_images": indexed[1:], "loop": 0}
    write_whole(path, lambda name: indexed[0].save(name, "GIF", duration=delays, **options))
