"""Pads wedged between walls: where slope + atan(friction) reaches 90 degrees, two contacts can push
on each other with any force. Random grooves, slopes to 80 degrees, friction to 5.
"""

import math

import numpy as np
import pytest
from motions import placed

from jansen_env import ROBOTS, Terrain, paper_robot
from jansen_env.plants.batch import Batch
from jansen_env.robot.zoo import ZOO

TORQUE = 20.0  # N m
RIGID = {name: make() for name, make in ROBOTS.items() if make().pad_compliance.rigid}
DESIGNS = {**RIGID, "phases3": paper_robot(3)}


def grooves(rng: np.random.Generator) -> Terrain:
    """Grooves side by side, grooves with flats between them, or a random profile."""
    slope = math.radians(rng.uniform(0.0, 79.9))
    friction = rng.uniform(0.0, rng.choice([1.0, 5.0]))
    half = rng.choice([0.005, 0.01, 0.025, 0.05, 0.1, 0.2]) * rng.uniform(0.7, 1.3)  # m
    count = int(3.0 / half)
    x = half * np.arange(-count, count + 1)
    number = np.arange(2 * count + 1)
    deep = half * math.tan(slope)
    y = [
        np.where(number % 2, -deep, 0.0),
        np.where(number % 4 == 1, -deep, 0.0),
        rng.uniform(-deep, 0.0, 2 * count + 1),
    ][rng.integers(3)]
    restitution = rng.choice([0.0, rng.uniform(0.0, 1.0)])
    return Terrain(tuple(zip(x, np.maximum(y, -0.6), strict=True)), friction, restitution)


def walk(robot, seed: int, episodes: int, time_step: float = 1e-3):
    """Random torques for 100 control periods of 20 ms, an episode for each robot of a batch.

    Returns:
        (episodes, 4) the worst energy added and unaccounted for (J), mean force on a pad (N),
        contact residual (N s); (episodes,) whether pads can wedge or bounce there.
    """
    rng = np.random.default_rng([seed, len(robot.legs)])
    terrains = [grooves(rng) for _ in range(episodes)]
    batch = Batch([robot] * episodes, terrains, time_step)
    for i, terrain in enumerate(terrains):
        batch.set_mechanical_state(i, placed(robot, terrain, rng.uniform(0.0, 2 * math.pi)).state)
    mean, spread = rng.uniform(-1.0, 1.0, episodes), rng.uniform(0.0, 1.5, episodes)
    worst = np.zeros((episodes, 4))
    for _ in range(100):
        share = np.clip(mean + spread * rng.uniform(-1.0, 1.0, episodes), -1.0, 1.0)
        batch.step(TORQUE * share, round(0.02 / time_step))
        assert not batch.diverged.any()
        sums = batch.accumulators
        impulse = batch.records.statistics["impulse"]
        force = np.hypot(*np.moveaxis(impulse, -1, 0)).max(axis=1) / 0.02
        unaccounted = sums["motor_work"] + sums["correction_work"] - sums["energy_change"]
        for loss in ("joint_loss", "slip_loss", "impact_loss"):
            unaccounted -= sums[loss]
        figures = sums["contact_gain"], np.abs(unaccounted), force, sums["worst_residual"]
        worst = np.maximum(worst, np.stack(figures, axis=1))
    batch.close()
    wedging = [t.friction * t.steepest >= 1.0 or t.restitution > 0.0 for t in terrains]
    return worst, np.array(wedging)


def check(name: str, seeds: range, episodes: int, measured) -> None:
    runs = [walk(DESIGNS[name], seed, episodes) for seed in seeds]
    worst, strict = (np.concatenate(columns) for columns in zip(*runs, strict=True))
    where = f"{len(worst)} walks on grooves, {name}"
    assert strict.sum() > len(worst) // 2
    gain, unaccounted, force, residual = worst.T
    measured(f"{where}: energy added, wedging or bouncing", gain[strict].max(), 1e-12, "J")
    measured(f"{where}: energy added, rolling", gain.max(), 2e-4, "J")
    # The zoo's cranks are longer, so toes are faster, and wedged ones nearer to a toggle.
    most, hardest = (0.6, 3e5) if name in ZOO else (0.1, 1e5)
    measured(f"{where}: energy unaccounted for in 20 ms", unaccounted.max(), most, "J")
    measured(f"{where}: mean force on a pad over 20 ms", force.max(), hardest, "N")
    measured(f"{where}: contact law violated", residual.max(), 1e-8, "N s")


@pytest.mark.slow
@pytest.mark.parametrize("name", DESIGNS)
def test_grooves(name, measured):
    """The bounds hold in 64 walks of 2 s for every design."""
    check(name, range(1), 64, measured)


@pytest.mark.slow
@pytest.mark.parametrize("name", DESIGNS)
def test_ten_thousand_walks_on_grooves(name, measured):
    """The bounds hold in 2,048 walks of 2 s for every design, 10,240 in all."""
    check(name, range(1, 17), 128, measured)


def test_a_braced_robot_holds_little_and_stands_still(measured):
    """It is jammed in grooves of 58 degrees, then left alone for 3 s; half of the robots
    may rock.
    """
    x = 0.05 * np.arange(-40, 41)
    ground = Terrain(tuple(zip(x, np.where(np.arange(81) % 2, -0.08, 0.0), strict=True)))
    force = 0.0
    moved = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        plant = placed(ROBOTS["holy"](), ground, rng.uniform(0.0, 2.0 * math.pi))
        for _ in range(50):
            result = plant.step(rng.uniform(-TORQUE, TORQUE), 0.02)
            force = max(force, float(np.abs(result.contact_force).max()))
        plant.step(0.0, 3.0)
        before = plant.state
        plant.step(0.0, 1.0)
        moved.append(np.abs(plant.state - before)[:3].max())
    measured("wedged robot: mean force on a toe over 20 ms", force, 1e5, "N")
    measured("wedged robots left alone: motion in a second", float(np.median(moved)), 5e-5, "m")
