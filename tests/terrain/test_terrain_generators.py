"""Terrains by name: their shapes, what their parameters mean, and drawing them by level."""

import math
import pickle
from functools import partial
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from jansen_env import Terrain
from jansen_env.engine.ground_lines import REACH, RISER_SLOPE, START
from jansen_env.plants.plant import PLANTS
from jansen_env.tasks.walking.profile import Profile
from jansen_env.terrain.generators import (
    GENERATORS,
    HIGHEST,
    LEVELS,
    MIXTURE,
    at_level,
    make_generator,
)
from jansen_env.terrain.ground import profile

HILLS = Terrain(((-2.0, 0.5), (-1.0, 0.0), (0.0, 0.2), (1.0, 0.1), (2.0, 0.6)))
FACE = math.tan(RISER_SLOPE)


def level_runs(terrain):
    """(left end, right end, height) of the level pieces."""
    points = np.array(terrain.points)
    flat = np.flatnonzero(np.diff(points[:, 1]) == 0.0)
    return np.stack([points[flat, 0], points[flat + 1, 0], points[flat, 1]], axis=1)


def faces(terrain):
    """Heights and slopes of what is not level."""
    run, rise = np.diff(np.array(terrain.points), axis=0).T
    return rise[rise != 0.0], np.abs(rise / run)[rise != 0.0]


def test_stairs():
    """Every tread and rise is as asked, up to +x and down to -x, and the faces are as steep as they
    say.
    """
    terrain = Terrain.stairs(rise=0.04, tread=0.3)
    rises, slopes = faces(terrain)
    assert rises == pytest.approx(0.04) and slopes == pytest.approx(FACE)
    assert len(rises) == 2 * int((REACH - START) / 0.3)
    middles = level_runs(terrain)[:, :2].mean(axis=1)[1:-1]  # but for the level ends
    apart = np.diff(middles)
    assert apart[apart < 0.5] == pytest.approx(0.3)
    assert terrain.height([0.0, 1.0, -1.0]) == pytest.approx([0.0, 0.04, -0.04])
    down = Terrain.stairs(rise=-0.04, tread=0.3)
    x = np.linspace(-12.0, 12.0, 500)
    assert down.height(x) == pytest.approx(terrain.height(-x), abs=1e-12)


@pytest.mark.parametrize("name", LEVELS)
@pytest.mark.parametrize("level", [0, 4, HIGHEST])
def test_each_ground_has_what_a_robot_needs(name, level, rng):
    """It is level below the robot and at the ends, with 8 m of ground on both sides, and has few
    vertices.
    """
    generator = make_generator(name)
    for _ in range(20):
        terrain = generator(rng, level)
        assert len(terrain.points) <= 150
        if name == "slope":
            continue
        x = np.linspace(-START, START, 50)
        assert np.abs(terrain.height(x)).max() < 1e-9
        points = np.array(terrain.points)
        assert points[0, 0] < -6.0 and points[-1, 0] > 6.0
        assert points[0, 1] == points[1, 1] and points[-1, 1] == points[-2, 1]
        for side in (points[points[:, 0] > 0.0], points[points[:, 0] < 0.0]):
            assert np.ptp(side[:, 1]) > 0.0


@pytest.mark.parametrize("name", GENERATORS)
def test_a_generator_replays_and_is_plain_data(name):
    generator = make_generator(name)
    assert pickle.loads(pickle.dumps(generator)) == generator == make_generator(name)
    assert hash(generator) == hash(make_generator(name)) and str(generator) == name
    assert make_generator(generator) is generator
    drawn = [generator(np.random.default_rng(seed), 5) for seed in (0, 0, 1)]
    assert drawn[0] == drawn[1] != drawn[2] or name == "slope"
    assert {(terrain.friction, terrain.restitution) for terrain in drawn} == {(0.8, 0.0)}


def test_the_documented_levels_are_those_of_the_code():
    page = Path(__file__).parents[2] / "docs" / "terrain" / "levels.md"
    lines = page.read_text(encoding="utf-8").splitlines()
    rows = dict(line[1:-1].split("|", 1) for line in lines if line.startswith('| `"'))
    for name, parameters in LEVELS.items():
        for key, (low, high) in parameters.items():
            row = next(rows.pop(label) for label in [*rows] if f'"{name}"`, `{key}`' in label)
            shown = [float(cell) for cell in row.split("|") if cell.strip()]
            levels = range(10) if low < high else (0,)
            assert shown == pytest.approx([at_level(name, k)[key] for k in levels], rel=5e-3)
    assert not rows


def test_each_generator_is_documented():
    page = (Path(__file__).parents[2] / "docs" / "terrain.md").read_text(encoding="utf-8")
    for name in GENERATORS:
        assert f'| `"{name}"` |' in page


@pytest.mark.parametrize("name", LEVELS)
def test_each_kind_has_vertices_of_its_own(name):
    """A kind that the engine did not distinguish would look like another one."""
    values = np.array([*at_level(name, HIGHEST).values(), 1.0, 1.0])[:3]
    own = profile(name, values, rng=np.random.default_rng(0))
    for other in {*LEVELS} - {name}:
        assert profile(other, values, rng=np.random.default_rng(0)) != own


def test_parameters_that_are_given_stay(rng):
    """They stay at all levels, with their sign; the others come from the level as they would
    without them.
    """
    generator = make_generator("stairs:rise=0.02, tread=0.3")
    assert generator.given == (("rise", 0.02), ("tread", 0.3))
    assert str(generator) == "stairs:rise=0.02,tread=0.3"
    for level in (0, HIGHEST):
        for _ in range(10):
            assert faces(generator(rng, level))[0] == pytest.approx(0.02)
    free, fixed = make_generator("stumps"), make_generator("stumps:width=0.2")
    assert LEVELS["stumps"]["width"] == (0.2, 0.2)
    assert free(np.random.default_rng(3), 6) == fixed(np.random.default_rng(3), 6)


def test_mixed_is_another_kind_each_time(rng):
    """All kinds are sampled evenly, and each is as it is alone."""
    mixed = make_generator("mixed")
    sizes = {len(mixed(rng, 4).points) for _ in range(200)}
    alone = {len(make_generator(kind)(rng, 4).points) for kind in MIXTURE for _ in range(30)}
    assert 2 in sizes and len(sizes) >= 5 and sizes <= alone


def test_a_new_terrain_changes_no_seed_of_the_mixture(monkeypatch):
    mixed = make_generator("mixed")
    before = [mixed(np.random.default_rng(seed), 5) for seed in range(20)]
    monkeypatch.setitem(LEVELS, "another", {"height": (0.01, 0.1)})
    again = [make_generator("mixed")(np.random.default_rng(seed), 5) for seed in range(20)]
    assert again == before


REFUSED = {
    "lava": r"terrain must be 'flat'.*'slope', 'rough', 'waves', 'stairs'.*'mixed'\], got 'lava'",
    "flat2": "terrain must be .*, got 'flat2'",
    "stairs:0.02": r"must be NAME=NUMBER, with a name of \['rise', 'tread'\], got '0.02'",
    "stairs:rise=": "must be NAME=NUMBER.*, got 'rise='",
    "stairs:rize=1": r"a parameter of 'stairs' must be one of \['rise',.*, got 'rize'",
    "stairs:rise=nan": "rise of 'stairs' must be .*, got nan",
    "stairs:tread=0.001": "'stairs:tread=0.001' makes no ground at level 0: tread must be",
    "slope:angle=2": "angle must be between.*got 2.0",
    "waves:length=1e-9": "must leave room for at most 100000 repetitions",
    "mixed:rise=1": "'mixed' must have no parameters, got 'rise'; choose a single",
}


SHAPES = [
    (lambda: Terrain.stairs(rise=0.1, tread=0.02), "tread must be above 0.02679.*got 0.02"),
    (lambda: Terrain.stairs(start=9.0), r"start must be below reach \(9\), got 9"),
    (lambda: Terrain.stairs(rise=math.inf), "rise must be .*, got inf"),
    (lambda: Terrain.stumps(width=-0.1), "width must be .*, got -0.1"),
    (lambda: Terrain.stumps(width=0.3, spacing=0.3), r"spacing - width must be above 0, got 0\.0"),
    (lambda: Terrain.ramps(angle=1.5), "angle must be .*, got 1.5"),
    (lambda: Terrain.ramps(length=0.0), "length must be .*, got 0.0"),
    (lambda: Terrain.waves(height=5.0, length=0.1), "slopes of Terrain.points"),
    (lambda: Terrain.steps(3), "rng must be a Generator, got 3"),
    (lambda: Terrain.steps(np.random.default_rng(), height=-0.1), "height must be .*, got -0.1"),
    (
        lambda: Terrain.steps(np.random.default_rng(), spacing=0.0),
        "spacing / 2 must be .*, got 0.0",
    ),
]
TEXTS = [(partial(make_generator, text), message) for text, message in REFUSED.items()]


@pytest.mark.parametrize("make, message", TEXTS + SHAPES)
def test_texts_and_shapes_that_cannot_be_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_height_and_gradient():
    """They are linear between vertices, and the first and the last slope continue."""
    assert HILLS.height([-2.0, -0.5, 0.0, 0.5, 1.5, 3.0, -3.0]) == pytest.approx(
        [0.5, 0.1, 0.2, 0.15, 0.35, 1.1, 1.0], abs=1e-12
    )
    # On a stretch its own slope; at a vertex the mean of both sides'.
    assert HILLS.gradient([0.5, 1.5, 3.0]) == pytest.approx(
        (HILLS.height([0.6, 1.6, 3.1]) - HILLS.height([0.4, 1.4, 2.9])) / 0.2, abs=1e-9
    )
    ridge = Terrain(((-1.0, 0.0), (0.0, 0.3), (1.0, 0.2)))
    assert ridge.gradient(0.0) == pytest.approx(0.1, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("plant", sorted(PLANTS))
def test_walks_over_faces_do_not_diverge(plant):
    """In 5 s over stumps of 3 cm nothing is refused, joints stay closed, and the robot gets
    there.
    """
    terrain = Terrain.stumps(height=0.03, width=0.2, spacing=0.6)
    env = gym.make("JansenWalker-v0", terrain=terrain, plant=plant, speed_command=0.45)
    policy = Profile([0.45], [[5.0, 20.0, 0.0, 0.0]]).policy(env.unwrapped)  # 5 rad/s
    observation, _ = env.reset(seed=1)
    for _ in range(250):
        observation, _, terminated, _, info = env.step(policy.predict(observation)[0])
        assert not info["diverged"] and not terminated and info["joint_gap"] < 1e-3
    assert info["x_position"] > 1.6
    env.close()
