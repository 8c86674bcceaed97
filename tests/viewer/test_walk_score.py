"""A walk on the page is scored as by ``jansen-env evaluate``; Node.js runs the page's modules."""

import gymnasium as gym
import numpy as np
import pytest
from browser import in_node

from jansen_env.policies import pretrained
from jansen_env.policies.policy import TorquePolicy
from jansen_env.scoring.metrics import point_estimates
from jansen_env.scoring.rollout import run_episodes
from jansen_env.tasks.walking.walker_benchmark import WALKER
from jansen_env.terrain import Terrain
from jansen_env.viewer.web.walk_data import walk_data

ENV = "JansenWalkerBuilt-v0"
SCRIPT = """
import { readFileSync } from "node:fs";
import { loadEngine } from "FOLDER/engine.js";
import { Walker } from "FOLDER/walker.js";
const { data, control, seed, points } = JSON.parse(readFileSync(0, "utf8"));
const engine = await loadEngine(Buffer.from(data.engine, "base64"), data.layout);
const walker = await Walker.create(engine, data, data.robots.built, points, control);
walker.start(seed, {}, 0.4);
for (let k = 0; k < 500; k++) walker.step(1, 0.4);
console.log(JSON.stringify(walker.score));
"""


@pytest.mark.slow
@pytest.mark.parametrize(("control", "seed"), [("built policy", 3), ("hand", 1)])
def test_the_score_is_that_of_the_evaluation(control, seed):
    """Scores are those of ten seconds; by hand, with the whole torque, until the robot falls."""
    flat = Terrain.flat().points
    env = gym.make(ENV)
    score = in_node(SCRIPT, data=walk_data(), control=control, seed=seed, points=flat)
    limit = env.unwrapped.torque_limit
    policy = TorquePolicy(lambda seen, *_: (np.full(len(seen), limit), None), limit)
    if control != "hand":
        policy = pretrained.load(ENV).on(env)
    arguments = {"reset_noise_scale": 0.0, "randomize": {}}
    run = run_episodes(policy, ENV, arguments, np.array([0.4]), np.array([seed]))
    expected = point_estimates(WALKER.metrics, run, env)
    assert (run["duration"][0] < 9.0) == (control == "hand")
    assert score["time"] == pytest.approx(run["duration"][0])
    assert score["distance"] == pytest.approx(run["distance"][0], rel=1e-9)
    assert score["slip"] == pytest.approx(expected["slip_per_metre"], rel=1e-9)
    assert score["unsupported"] == pytest.approx(expected["unsupported"], rel=1e-9)
    assert score["cost"] == pytest.approx(expected["cost_of_transport"], rel=1e-9)
