"""Show a policy in a window, or record a video as GIF or MP4: ``jansen-env enjoy``."""

import argparse
import os
import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, closing
from importlib import import_module
from itertools import chain, zip_longest
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jansen_env.checks import MAX_STEPS
from jansen_env.cli.flags import (
    episode_count,
    parse_policies,
    path_flag,
    policy_parser,
    positive_int,
)
from jansen_env.cli.named_policies import default_policy, label, load_all
from jansen_env.cli.progress import progress
from jansen_env.files import write_whole
from jansen_env.policies.policy import Policy
from jansen_env.scoring.benchmarks import find_benchmark
from jansen_env.scoring.metrics import Env
from jansen_env.scoring.rollout import Advance, make_env
from jansen_env.world.rendering import GROUND, GROUND_TEXT, RED, Picture

INVISIBLE = ("dummy", "offscreen")  # SDL drivers whose windows are invisible
FRAME_TIME = {".gif": 0.08, ".mp4": 0.02}  # time between frames, in s
GIF_WIDTH = 480
GIF_COLOURS = 32
TITLE_SIZE = 30  # font size of a title, in pixels
TITLE_MARGIN = 24  # margin at the sides of a title, in pixels
TITLE_HEIGHT = 42  # height of the line of a title, in pixels
WRITERS = {".gif": ("PIL",), ".mp4": ("PIL", "imageio_ffmpeg")}  # packages that write each format


class Progress(NamedTuple):
    """Progress of an episode.

    Attributes:
        steps: Number of steps so far.
        returned: Return so far.
        failed: Whether the episode has been terminated.
        walked: Distance walked, in m; None for a robot that does not walk.
        slipped: Total slip of all toes, in m; None for a robot that does not walk.
    """

    steps: int
    returned: float
    failed: bool
    walked: float | None = None
    slipped: float | None = None


def play(policy: Policy, env: Env, command: float, seed: int) -> Iterator[Progress]:
    """Run an episode of one robot.

    Args:
        policy: Policy that acts.
        env: Environment of one robot.
        command: Command for the robot, such as a speed.
        seed: Seed of the episode.

    Yields:
        Progress after the reset and after each step.
    """
    benchmark = find_benchmark(env.get_wrapper_attr("spec").id)
    observation, _ = env.reset(seed=seed, options=benchmark.options(command))
    moment = Progress(0, 0.0, False)
    state = None
    truncated = False
    yield moment
    while not (moment.failed or truncated):
        starts = np.array([moment.steps == 0])
        actions, state = policy.predict(observation[None], state, starts, True)
        observation, reward, terminated, truncated, info = env.step(actions[0])
        slipped = (moment.slipped or 0.0) + info["slip"].sum() if "slip" in info else None
        moment = Progress(
            moment.steps + 1,
            moment.returned + float(reward),
            terminated,
            info.get("x_position"),
            slipped,
        )
        yield moment


def film(
    env: Env, moments: Iterable[Progress], every: int, title: str | None = None
) -> Iterator[Picture]:
    """Render frames of an episode.

    Args:
        env: Environment that renders the frames.
        moments: Progress of the episode, from :func:`play`.
        every: Number of steps per frame.
        title: Title that is drawn into the frames; None for no title.

    Yields:
        A frame every ``every`` steps, and a frame at a failure.
    """
    for moment in moments:
        if moment.steps % every == 0 or moment.failed:
            frame = np.asarray(env.render())
            yield frame if title is None else _titled(frame, title, moment)


def _titled(frame: Picture, title: str, moment: Progress) -> Picture:
    """Draw a title into a frame, and for a walker the distance walked and the slip of its toes."""
    from PIL import Image, ImageDraw, ImageFont

    image = Image.fromarray(frame)
    draw = ImageDraw.Draw(image)
    font = ImageFont.load_default(TITLE_SIZE)
    y = image.height - TITLE_HEIGHT
    draw.rectangle((0, y + 2, *image.size), GROUND)  # covers the marks on the ground
    draw.text((TITLE_MARGIN, y), title, GROUND_TEXT, font)
    if moment.slipped is not None and moment.walked is not None:
        end = "then fell" if moment.failed else f"toes slid {1e3 * moment.slipped:.0f} mm"
        text = f"{moment.walked:.2f} m walked, {end}"
        right = image.width - TITLE_MARGIN
        draw.text((right, y), text, RED, font, anchor="ra")
    return np.asarray(image)


def stack(films: Sequence[Iterable[Picture]]) -> Iterator[Picture]:
    """Combine videos into one, one above the other.

    If a video ends, its last frame remains until all videos have ended.

    Args:
        films: Frames of each video. All frames have the same width.
    """
    last: list[Picture] = []
    for frames in zip_longest(*films):
        last = [last[i] if frame is None else frame for i, frame in enumerate(frames)]
        yield np.concatenate(last)


def check_suffix(path: str | Path) -> str:
    """Return the suffix of the file of a video.

    Args:
        path: Path of the file.

    Raises:
        ValueError: If the suffix is not one of :data:`FRAME_TIME`.
    """
    if (suffix := Path(path).suffix) not in FRAME_TIME:
        raise ValueError(f"the video must end in one of {list(FRAME_TIME)}, got {path}")
    return suffix


def save_video(frames: Iterable[Picture], path: str | Path, frame_time: float) -> None:
    """Write frames to a ``.gif``, which repeats endlessly, or to an ``.mp4`` file.

    Args:
        frames: Frames of shape (height, width, 3). All have the same size, and height and width are
            even. Each frame is written as soon as it is available.
        path: Path of the file.
        frame_time: Time between frames, in s.

    Raises:
        ValueError: If the path has another suffix.
    """
    write = _write_mp4 if check_suffix(path) == ".mp4" else _write_gif
    write_whole(path, lambda name: write(iter(frames), name, frame_time))


def _write_mp4(frames: Iterator[Picture], name: str, frame_time: float) -> None:
    """Write frames to an MP4 file."""
    import imageio_ffmpeg

    first = next(frames)
    height, width, _ = first.shape
    size = (width, height)
    rate = 1.0 / frame_time
    with closing(imageio_ffmpeg.write_frames(name, size, fps=rate, macro_block_size=2)) as writer:
        writer.send(None)  # starts the writer
        for frame in chain([first], frames):
            writer.send(np.ascontiguousarray(frame))


def _write_gif(frames: Iterator[Picture], name: str, frame_time: float) -> None:
    """Write frames to a GIF file, scaled to the width :data:`GIF_WIDTH`."""
    from PIL import Image

    def small(frame: Picture) -> Image.Image:
        size = GIF_WIDTH, round(GIF_WIDTH * frame.shape[0] / frame.shape[1])
        return Image.fromarray(frame).resize(size, Image.Resampling.LANCZOS)

    first = small(next(frames))
    # A common palette prevents flicker. MAXCOVERAGE preserves the few red pixels of a toe.
    palette = first.quantize(GIF_COLOURS, Image.Quantize.MAXCOVERAGE, kmeans=3)
    pictures = (
        image.quantize(palette=palette, dither=Image.Dither.NONE)
        for image in chain([first], map(small, frames))
    )
    next(pictures).save(
        name, save_all=True, append_images=pictures, duration=1e3 * frame_time, loop=0
    )


def display() -> bool:
    """Return whether a visible display is available, according to the environment variables."""
    if os.environ.get("SDL_VIDEODRIVER") in INVISIBLE:
        return False
    return sys.platform != "linux" or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY")))


def episode(
    policy: Policy, env: Env, args: argparse.Namespace, number: int, title: str | None = None
) -> Iterator[Progress]:
    """Run one episode and print its outcome.

    Args:
        policy: Policy that acts.
        env: Environment of one robot.
        args: Parsed command line.
        number: Index of the episode, which selects its command and seed.
        title: Title that is printed before the outcome; None for no title.

    Yields:
        Progress after the reset and after each step.
    """
    command = args.command[number % len(args.command)]
    for moment in play(policy, env, command, args.seed + number):
        yield moment
        if moment.steps == args.steps or env.get_wrapper_attr("window_closed"):
            break
    how = "failed" if moment.failed else "ended"
    seconds = moment.steps * env.get_wrapper_attr("control_dt")
    unit = find_benchmark(args.env).command_unit
    print(
        f"{title + ': ' if title else ''}command {command:g} {unit}: return "
        f"{moment.returned:.1f}, {how} after {seconds:.2f} s"
    )


def show(policy: Policy, env: Env, args: argparse.Namespace) -> bool:
    """Show episodes in a window until the user closes it.

    Args:
        policy: Policy that acts.
        env: Environment of one robot that shows a window.
        args: Parsed command line.

    Returns:
        False if no window could be opened, True otherwise.
    """
    for number in range(args.episodes):
        for moment in episode(policy, env, args, number):
            if number == moment.steps == 0:
                if env.get_wrapper_attr("window_closed"):
                    return False
                title = label(args.policy[0])
                print(f"{title} on {args.env} in a window; close it to end", flush=True)
        if env.get_wrapper_attr("window_closed"):
            break
    return True


def watched(moments: Iterable[Progress], most: int, advance: Advance) -> Iterator[Progress]:
    """Pass on the progress of an episode, and report the fraction that is done.

    Args:
        moments: Progress of the episode, from :func:`play`.
        most: Largest number of steps of the episode.
        advance: Function that is called with the fraction of the episode done since its last call.

    Yields:
        The progress, unchanged.
    """
    left = 1.0
    for moment in moments:
        yield moment
        advance(1.0 / most)
        left -= 1.0 / most
    advance(left)


def record(policies: dict[str, Policy], args: argparse.Namespace, path: Path) -> None:
    """Record a video of the episodes.

    Several policies are shown one above the other, from the same initial states.

    Args:
        policies: Policies by title.
        args: Parsed command line.
        path: Path of the video.
    """
    titles = policies if len(policies) > 1 else [None]
    with ExitStack() as opened:
        made = (make_env(args.env, args.env_kwargs, render_mode="rgb_array") for _ in policies)
        envs = [opened.enter_context(closing(env)) for env in made]
        dt = envs[0].get_wrapper_attr("control_dt")
        every = max(1, round(FRAME_TIME[path.suffix] / dt))
        shown = [*zip(envs, policies.values(), titles, strict=True)]
        each = min(args.steps or MAX_STEPS, envs[0].get_wrapper_attr("spec").max_episode_steps)
        with progress("recording", len(shown) * args.episodes) as advance:
            films = (
                stack(
                    [
                        film(
                            env,
                            watched(episode(policy, env, args, number, title), each, advance),
                            every,
                            title,
                        )
                        for env, policy, title in shown
                    ]
                )
                for number in range(args.episodes)
            )
            save_video(chain.from_iterable(films), path, every * dt)
    print(f"written: {path}")


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    """Parse the command line.

    Args:
        arguments: Arguments of the command. None selects those of the process.
    """
    parser = policy_parser(
        "jansen-env enjoy",
        "Show a policy in a window, or record a video of policies, one above the other.",
        "jansen-env enjoy --env JansenWalkerRough-v0",
        "jansen-env enjoy --policy pretrained --policy pid --video both.mp4",
    )
    add = parser.add_argument
    add(
        "--command",
        type=float,
        nargs="+",
        metavar="V",
        help="commanded speeds or goals, which the episodes use in turn; default: the middle of "
        "the benchmark's grid",
    )
    add("--episodes", type=episode_count, help="number of episodes; default: one per command")
    add(
        "--steps",
        type=positive_int,
        help="largest number of steps of an episode; default: the time limit of the environment",
    )
    add(
        "--video",
        type=path_flag,
        metavar="FILE",
        help="write a video (.gif or .mp4) instead of opening a window",
    )
    args = parse_policies(parser, arguments, "--command")
    args.command = args.command or [find_benchmark(args.env).middle]
    args.episodes = args.episodes or len(args.command)
    args.policy = args.policy or [default_policy(args.env)]
    return args


def main(arguments: list[str] | None = None) -> None:
    """Show a policy in a window, or record a video of it.

    Args:
        arguments: Arguments of the command. None selects those of the process.
    """
    args = parse(arguments)
    window = args.video is None and len(args.policy) == 1 and display()
    with args.parser.refusing():
        suffix = check_suffix(args.video or "film.mp4")
        if not window:
            for package in WRITERS[suffix]:
                import_module(package)
        ((policies, _),) = load_all(args, args.command)
    if window:
        with closing(make_env(args.env, args.env_kwargs, render_mode="human")) as env:
            if show(next(iter(policies.values())), env, args):
                return
    path = Path(args.video or f"{args.env}_{re.sub('[/ :]', '_', '_'.join(policies))}.mp4")
    if not args.video and len(policies) == 1:
        print("there is no display for a window, so a video is recorded instead")
    print(f"recording {' and '.join(policies)} on {args.env} to {path} ...", flush=True)
    with args.parser.refusing():
        record(policies, args, path)
