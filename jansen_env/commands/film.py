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
TITLE_PLACE, TITLE_COLOUR = (24, 42), GROUND_TEXT  # pixels from the lower left corner
TITLE_SIZE, TITLE_WIDTH, TITLE_GAP = 30, 190, 30  # pixels: letters; a title, at least; behind it

Picture = NDArray[np.uint8]


class Progress(NamedTuple):
    """Steps and return of an episode so far, and whether it ended early.

    Of a walker also the distance walked and the slip of all toes together, m.
    """

    steps: int
    returned: float
    failed: bool
    walked: float | None = None
    slipped: float | None = None


def play(policy: Policy, env: Any, command: float, seed: int) -> Iterator[Progress]:
    """Play an episode of one robot with a command; yield its start and each step."""
    observation, _ = env.reset(seed=seed, options={find_benchmark(env.spec.id).option: command})
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
    """Give a frame of one in ``every`` moments, and of a failure; a title is written into it, with
    how far a walker has come and its toes have slid."""
    for moment in moments:
        if moment.steps % every == 0 or moment.failed:
            yield env.render() if title is None else _titled(env.render(), title, moment)


def _titled(frame: Picture, title: str, moment: Progress) -> Picture:
    from PIL import Image, ImageDraw, ImageFont

    image = Image.fromarray(frame)
    draw, (x, y) = ImageDraw.Draw(image), (TITLE_PLACE[0], frame.shape[0] - TITLE_PLACE[1])
    font, text = ImageFont.load_default(TITLE_SIZE), ""
    if moment.slipped is not None and moment.walked is not None:
        end = "then fell" if moment.failed else f"toes slid {1e3 * moment.slipped:.0f} mm"
        text = f"{moment.walked:.2f} m walked, {end}"
    room = frame.shape[1] - 2 * x - TITLE_GAP - draw.textlength(text, font)
    share = min(1.0, room / draw.textlength(title, font))  # of a long title's letters
    title_font = ImageFont.load_default(TITLE_SIZE * share)
    draw.rectangle((0, y + 2, *frame.shape[1::-1]), GROUND)  # over the marks of the ground
    draw.text((x, y), title, TITLE_COLOUR, title_font)
    behind = max(TITLE_WIDTH, round(draw.textlength(title, title_font)) + TITLE_GAP)
    draw.text((x + behind, y), text, SLIP, font)
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


def steps_per_frame(path: str | Path, env: Any) -> int:
    """Return how many control steps a file's kind of video has from one frame to the next."""
    return max(1, round(FRAME_TIME[Path(path).suffix] / env.unwrapped.control_dt))


def save_video(frames: Iterable[Picture], path: str | Path, frame_time: float) -> None:
    """Write frames (height, width, 3), of one even size, as they come, as an endless .gif or .mp4.

    Raises:
        ValueError: no frames, or another suffix.
    """
    suffix = check_suffix(path)
    first = next(frames := iter(frames), None)
    if first is None:
        raise ValueError(f"{path} with 0 frames, must be {list(FRAME_TIME)} with some")
    write = _write_mp4 if suffix == ".mp4" else _write_gif
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

    small = (
        Image.fromarray(frame).resize(
            (GIF_WIDTH, round(GIF_WIDTH * frame.shape[0] / frame.shape[1])),
            Image.Resampling.LANCZOS,
        )
        for frame in frames
    )
    first: Image.Image = next(small)
    # One palette for all, or still parts would flicker; this one keeps a toe's few red pixels.
    palette = first.quantize(GIF_COLOURS, Image.Quantize.MAXCOVERAGE, kmeans=3)
    first, *others = (
        image.quantize(palette=palette, dither=Image.Dither.NONE) for image in chain([first], small)
    )
    first.save(name, save_all=True, append_images=others, duration=1e3 * frame_time, loop=0)
