"""Pictures of strange robots: clipped to the canvas, so that time and memory are bounded."""

import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pygame
import pytest

from jansen_env import ROBOTS, Payload, Robot
from jansen_env.robot.lengths import lengths, with_lengths
from jansen_env.terrain import Terrain
from jansen_env.world.rendering import (
    CLIP,
    HEIGHT,
    ROUND,
    SIZE,
    WIDTH,
    Frame,
    Renderer,
    circle,
    clip_lines,
    clip_polygon,
)

LONGEST = 1.0  # s of CPU a picture may take; a common one takes 0.03 s
MEMORY = 1_000  # MB that pictures may take on top of what is imported
FUZZED = 150


def picture(robot, terrain=None, **values):
    """A robot's picture in a frame with some other values, and the CPU time it took, s."""
    toes = len(robot.toes)
    frame = Frame(
        q=np.zeros(4),
        contact=np.ones(toes, int),
        contact_point=np.zeros((toes, 2)),
        contact_force=np.ones((toes, 2)),
        weight=30.0,
        command=0.3,
        speed=0.2,
        torque=1.0,
        torque_limit=20.0,
        time=1.0,
    )
    renderer = Renderer(robot, terrain, "rgb_array", 50.0)
    begin = time.process_time()
    drawn = renderer.draw(replace(frame, **values))
    taken = time.process_time() - begin
    renderer.close()
    assert drawn.shape == (SIZE[1], SIZE[0], 3)
    return drawn, taken


def scaled(factor, robot):
    """A robot of other sizes; its links have no inertia, which would be too large."""
    robot = replace(robot, bodies=tuple(replace(body, inertia=0.0) for body in robot.bodies))
    sizes = {name: factor * value for name, value in lengths(robot).items()}
    return with_lengths(robot, {**sizes, "frame_angle": robot.frame_angle})


@pytest.mark.parametrize(
    "robot, values",
    [
        (replace(Robot(), pad_radius=10.0), {}),
        (replace(Robot(), pad_radius=1e3), {"contact": np.array([0, 1, 2, 0])}),
        (replace(Robot(), payload=Payload(1.0, 0.0, (0.0, 1e6))), {}),
        (scaled(1 / 500, Robot()), {"contact_force": np.full((4, 2), 30.0)}),
        (replace(scaled(1 / 500, Robot()), payload=Payload(1e6)), {}),
        (scaled(1e3, Robot()), {}),
        (Robot(), {"q": np.array([0.0, 1e6, 0.3, 0.0])}),
        (Robot(), {"q": np.array([-1e12, -1e12, 1e12, 1e12])}),
        (Robot(), {"goal": 1e12}),
        (Robot(), {"speed": 1e300, "torque": -1e300, "time": 1e300, "command": 1e300}),
    ],
)
def test_strange_robots_and_states_are_painted_in_time(robot, values):
    _, taken = picture(robot, Terrain.flat().polyline, **values)
    assert taken < LONGEST


def test_a_ground_of_many_points_is_painted_in_time():
    """A million of them are in sight."""
    x = np.linspace(-2.0, 2.0, 10**6)
    _, taken = picture(Robot(), np.stack([x, 0.01 * np.sin(1e4 * x)], axis=-1))
    assert taken < LONGEST


def fuzz(seed):
    """Robots, grounds and frames of extreme but finite numbers; ends with the longest time."""

    def anything(low, high, *shape):
        return rng.choice((-1.0, 1.0), shape) * 10.0 ** rng.uniform(low, high, shape)

    rng = np.random.default_rng(seed)
    longest = 0.0
    names = [*ROBOTS]
    for _ in range(FUZZED):
        robot = ROBOTS[names[rng.integers(len(names))]](int(rng.integers(1, 4)))
        robot = replace(
            scaled(abs(anything(-4.0, 2.5)), robot),
            pad_radius=abs(anything(-6.0, 2.9)),
            payload=Payload(abs(anything(-3.0, 6.0)), 0.0, tuple(anything(-6.0, 6.0, 2))),
        )
        toes = len(robot.toes)
        count = int(rng.integers(2, 5_000))
        x = abs(anything(-3.0, 3.0)) * (np.arange(count) - 0.5 * count)
        ground = np.stack([x, anything(-6.0, 6.0) * rng.standard_normal(count)], axis=-1)
        q = anything(-3.0, 12.0, 4) * rng.integers(2, size=4)
        near = q[:2] if rng.random() < 0.7 else 0.0
        _, taken = picture(
            robot,
            ground if rng.random() < 0.9 else None,
            q=q,
            contact=rng.integers(3, size=toes),
            contact_point=near + anything(-6.0, 12.0, toes, 2),
            contact_force=anything(-6.0, 300.0, toes, 2),
            weight=abs(anything(-9.0, 9.0)),
            speed=anything(-3.0, 300.0),
            torque=anything(-3.0, 300.0),
            time=anything(-3.0, 300.0),
            torque_limit=abs(anything(-38.0, 38.0)),
            command=anything(-3.0, 300.0),
            goal=float(anything(-3.0, 300.0)) if rng.random() < 0.5 else None,
        )
        longest = max(longest, taken)
    print(longest)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="memory is limited by Linux")
def test_anything_finite_is_painted_in_bounded_time_and_memory():
    program = (
        "import resource, sys, warnings; sys.path[:0] = sys.argv[1:]\n"
        "import test_rendering\n"
        "pages = int(open('/proc/self/statm').read().split()[0])\n"
        f"most = pages * resource.getpagesize() + {MEMORY} * 2**20\n"
        "resource.setrlimit(resource.RLIMIT_AS, (most, most))\n"
        "test_rendering.fuzz(1)\n"
    )
    command = [sys.executable, "-W", "error", "-c", program, str(Path(__file__).parent)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr[-2000:]
    assert float(done.stdout) < LONGEST


def painted(draw, shape):
    surface = pygame.Surface((WIDTH, HEIGHT), 0, 32)
    draw(surface, shape)
    return pygame.surfarray.array2d(surface) != 0


@pytest.mark.slow
def test_what_is_seen_of_a_polygon_stays_as_it_is():
    """Random triangles of up to ten canvases agree in all but pixels at edges."""
    rng = np.random.default_rng(0)
    for _ in range(30):
        points = rng.uniform(-5.0, 5.0, (3, 2)) * (WIDTH, HEIGHT)
        seen = clip_polygon(points, *CLIP)
        assert (seen >= CLIP[0] - 1e-6).all() and (seen <= CLIP[1] + 1e-6).all()

        def fill(surface, corners):
            if len(corners) > 2:
                pygame.draw.polygon(surface, (255, 255, 255), corners)

        difference = painted(fill, points) != painted(fill, seen)
        assert difference.sum() < 2 * (WIDTH + HEIGHT)


def test_what_is_seen_of_lines_stays_as_it_is():
    points = np.array([[-9e9, 100.0], [9e9, 100.0], [50.0, 50.0], [50.0, 1e12], [1e9, 1e9]])
    (low, _), (high, bottom) = CLIP
    lines = clip_lines(points, *CLIP)
    assert lines[0] == pytest.approx(np.array([[low, 100.0], [high, 100.0]]), abs=1e-3)
    assert lines[-1] == pytest.approx(np.array([[50.0, 50.0], [50.0, bottom]]), abs=1e-3)
    assert len(lines) == 3 and not len(clip_lines(points[3:], *CLIP))


def test_a_large_disc_is_as_round_as_a_small_one():
    radius = 1e9
    edge = circle(np.array([100.0 + radius, 50.0]), radius)
    assert edge[:, 0].min() == pytest.approx(
        100.0, abs=6.0
    )  # to the columns in which it is sampled
    filled = painted(
        lambda surface, _: pygame.draw.polygon(surface, (255, 255, 255), clip_polygon(edge, *CLIP)),
        None,
    )
    assert filled[110:].all() and not filled[:95].any()
    small = circle(np.array([0.0, 0.0]), float(ROUND))
    assert np.hypot(*small.T) == pytest.approx(np.full(len(small), ROUND))
