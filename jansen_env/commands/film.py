"""Watching a policy: an episode step by step, and its frames as GIF or MP4."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain, zip_longest
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jansen_env.baselines.policy import Policy
from jansen_env.files import write_whole
from jansen_env.rendering import GROUND, GROUND_TEXT, SLIP
from jansen_env.scoring.benchmarks import find_benchmark

FRAME_TIME = {".gif": 0.08, ".mp4": 0.02}  # s from one frame to the next
GIF_WIDTH, GIF_COLOURS = 480, 32
TITLE_LEFT, TITLE_HEIGHT = 24, 42  # pixels, from the lower left corner
TITLE_SIZE, TITLE_WIDTH, TITLE_GAP = 30, 190, 30  # pixels: letters; least of a title; behind it

Picture = NDArray[np.uint8]


class Progress(NamedTuple):
    """Steps and return of an episode so far, and whether it ended early; of a walker also the
    distance walked and the slip of all toes together, m."""

    steps: int
    returned: float
    failed: bool
    walked: float | None = None
    slipped: float | None = None


def play(policy: Policy, env: Any, command: float, seed: int) -> Iterator[Progress]:
    """Play an episode of one robot with a command; yield its start and each step."""
    observation, _ = env.reset(seed=seed, options=find_benchmark(env.spec.id).options(command))
    moment, state, truncated = Progress(0, 0.0, False), None, False
    yield moment
    while not (moment.failed or truncated):
        starts = np.array([moment.steps == 0])
        actions, state = policy.predict(observation[None], state, starts, True)
        observation, reward, terminated, truncated, info = env.step(actions[0])
        slipped = (moment.slipped or 0.0) + info["slip"].sum() if "slip" in info else None
        moment = Progress(moment.steps + 1, moment.returned + reward, terminated,
                          info.get("x_position"), slipped)  # fmt: skip
        yield moment


def film(
    env: Any, moments: Iterable[Progress], every: int, title: str | None = None
) -> Iterator[Picture]:
    """Give a frame of one in ``every`` moments, and of a failure, with a title if there is one."""
    for moment in moments:
        if moment.steps % every == 0 or moment.failed:
            yield env.render() if title is None else _titled(env.render(), title, moment)


def _titled(frame: Picture, title: str, moment: Progress) -> Picture:
    """A frame with a title, and with how far a walker has come and its toes have slid."""
    from PIL import Image, ImageDraw, ImageFont

    image = Image.fromarray(frame)
    draw, y, text = ImageDraw.Draw(image), image.height - TITLE_HEIGHT, ""
    if moment.slipped is not None and moment.walked is not None:
        end = "then fell" if moment.failed else f"toes slid {1e3 * moment.slipped:.0f} mm"
        text = f"{moment.walked:.2f} m walked, {end}"
    font = ImageFont.load_default(TITLE_SIZE)
    room = image.width - 2 * TITLE_LEFT - TITLE_GAP - draw.textlength(text, font)
    share = min(1.0, room / draw.textlength(title, font))  # letters of a long title are smaller
    title_font = ImageFont.load_default(TITLE_SIZE * share)
    draw.rectangle((0, y + 2, *image.size), GROUND)  # over the marks of the ground
    draw.text((TITLE_LEFT, y), title, GROUND_TEXT, title_font)
    behind = max(TITLE_WIDTH, round(draw.textlength(title, title_font)) + TITLE_GAP)
    draw.text((TITLE_LEFT + behind, y), text, SLIP, font)
    return np.asarray(image)


def stack(films: Sequence[Iterable[Picture]]) -> Iterator[Picture]:
    """Put films one above the other; the last frame of one that ends stays until all have ended."""
    shown: list[Any] = [None] * len(films)
    for frames in zip_longest(*films):
        shown = [before if new is None else new for new, before in zip(frames, shown, strict=True)]
        yield np.concatenate(shown)


def check_suffix(path: str | Path) -> str:
    """Return the suffix of a video's file; a ValueError where no video has it."""
    if (suffix := Path(path).suffix) not in FRAME_TIME:
        raise ValueError(f"{path} ends in {suffix!r}, must end in one of {list(FRAME_TIME)}")
    return suffix


def save_video(frames: Iterable[Picture], path: str | Path, frame_time: float) -> None:
    """Write frames (height, width, 3), of one even size, as they come, as an endless .gif or .mp4.

    Raises:
        ValueError: no frames, or another suffix.
    """
    write = _write_mp4 if check_suffix(path) == ".mp4" else _write_gif
    first = next(frames := iter(frames), None)
    if first is None:
        raise ValueError(f"{path} has 0 frames, must have some")
    write_whole(path, lambda name: write(chain([first], frames), name, frame_time))


def _write_mp4(frames: Iterable[Picture], name: str, frame_time: float) -> None:
    import imageio.v2 as imageio

    options: dict[str, Any] = {"format": "FFMPEG", "fps": 1.0 / frame_time, "macro_block_size": 2}
    writer: Any
    with imageio.get_writer(name, **options) as writer:
        for frame in frames:
            writer.append_data(frame)


def _write_gif(frames: Iterable[Picture], name: str, frame_time: float) -> None:
    from PIL import Image

    def small(frame: Picture) -> Image.Image:
        size = GIF_WIDTH, round(GIF_WIDTH * frame.shape[0] / frame.shape[1])
        return Image.fromarray(frame).resize(size, Image.Resampling.LANCZOS)

    first = small(next(frames := iter(frames)))
    # One palette for all keeps still parts from flickering; this one keeps a toe's few red pixels.
    palette = first.quantize(GIF_COLOURS, Image.Quantize.MAXCOVERAGE, kmeans=3)
    pictures = (
        image.quantize(palette=palette, dither=Image.Dither.NONE)
        for image in chain([first], map(small, frames))
    )
    next(pictures).save(
        name, save_all=True, append_images=pictures, duration=1e3 * frame_time, loop=0
    )
