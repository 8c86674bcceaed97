"""The table of parameters: each row on both plants, its limits, its line in the documentation."""

from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from jansen_env import Compliance, Motor, Payload, Robot
from jansen_env.plants import parameters
from jansen_env.plants.parameters import PARAMETERS, TABLE

ROOT = Path(__file__).parents[2]
MACHINE = {
    "payload": Payload(0.5, 0.01, (0.05, 0.1)),
    "motor": Motor(12.0, 8.0, 6.0, 20.0, 1e-4, 0.1),
}
FEET = Compliance(2e4, 60.0)
PLANTS = ("projection", "rigid_body")


def walked(plant, row, value, feet):
    """All that is observed of a short walk in which one parameter has a value."""
    env = gym.make(
        "JansenWalker-v0",
        plant=plant,
        terrain="rough",
        noise={},
        delay=(0.0, 1.0),
        push={"duration": 0.02, "interval": 0.04},
        height_scan=(0.5, 1.5, 9),
        robot=Robot(**MACHINE, **({"pad_compliance": FEET} if feet else {})),
    )
    observation, info = env.reset(seed=1, options={"delay": 0.0, row.name: value})
    assert info["parameters"][row.name] == value
    seen = [observation]
    steps = 7 if row.name in ("delay", "restitution") else 3
    seen += [env.step(np.full(1, 0.7, np.float32))[0] for _ in range(steps)]
    return np.array(seen)


@pytest.mark.slow
@pytest.mark.parametrize("plant", PLANTS)
@pytest.mark.parametrize("row", TABLE, ids=lambda row: row.name)
def test_every_parameter_changes_the_walk_on_both_plants(row, plant):
    """All parameters of the table are tried: one that a backend ignored would be found here."""
    feet = row.is_idle(Robot(**MACHINE))
    low, high = max(row.least, -0.5), min(row.most, 2.0)
    values = [low + 0.1 * (high - low), low + 0.6 * (high - low)]
    if row.whole:
        values = [round(row.least), round(row.most)]
    first, second = (walked(plant, row, value, feet) for value in values)
    assert np.abs(first - second).max() > 1e-7


def test_limits_hold_everywhere():
    """At a reset, in a range, in a state: the message has name, value and limits."""
    env = gym.make("JansenWalker-v0", robot="built", noise={}, push={}, terrain="rough").unwrapped
    env.reset(seed=0)
    for row in TABLE:
        if row.is_idle(env.robot):
            continue
        beyond = 2.0 * row.most + 1.0
        for refused in (
            lambda: env.reset(options={row.name: beyond}),  # noqa: B023
            lambda: gym.make("JansenWalker-v0", randomize={row.name: (row.least, beyond)}),  # noqa: B023
        ):
            message = rf"\['{row.name}'\] must be between .*{beyond}"
            with pytest.raises(ValueError, match=message):
                refused()
    with pytest.raises(ValueError, match=r"a key of randomize must be one of .*, got 'gravity'"):
        gym.make("JansenWalker-v0", randomize={"gravity": 1.0})


def test_nothing_goes_by_position():
    """Types and information have the table's names; the documentation has its rows."""
    assert parameters.EPISODE.names == tuple(PARAMETERS)
    rows = np.arange(2.0 * len(TABLE)).view(parameters.EPISODE)
    assert parameters.plain(rows[::2]).tolist() == [[float(i) for i in range(len(TABLE))]]
    page = (ROOT / "docs" / "worlds.md").read_text(encoding="utf-8")
    for row in TABLE:
        limits = f"{row.least:g} to {row.most:g}"
        assert f"| `{row.name}` | {row.unit} | {limits} | {row.meaning} | {row.idle} |" in page
