"""Co-design: search link lengths and score every design by a policy that is trained on it.

The example has two modes:

    python examples/codesign.py train STEPS PARENT ROBOT ...
    python examples/codesign.py search STEPS PARENT ROBOT DESIGNS

`train` trains a policy for each robot and writes scores.json and scores.png. `search` runs CMA-ES
on the link lengths, starting from ROBOT, under the geometric limits of the plan `cost`. The search
ends when DESIGNS designs have been trained. The score of a design is the cost of transport of its
policy at 0.3 m/s.

STEPS is the number of training steps per policy. PARENT is a model with whose weights the training
begins, or `new`. In a search, later trainings begin with the weights of the best policy so far.
"""

import json
import math
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from agents.design.design_plan import read_plan
from agents.design.measures import GROUPS
from agents.design.search import Cma, candidates, make_walker, measure
from agents.training.callbacks import NormalizerUpdate
from agents.training.config import new_config
from agents.training.train_model import prepare
from jansen_env.robot.robot_file import write_robot
from jansen_env.scoring.evaluation import evaluate
from jansen_env.terrain.ground import one_step

SHAPE, PLANES = GROUPS["shape"], GROUPS["planes"]
ENV = "JansenWalkerBuilt-v0"
HEIGHTS = np.round(np.arange(0.02, 0.321, 0.02), 2).tolist()  # heights of steps, in m


def train(robot, steps, parent, seed=0):
    """Train a model on a robot, starting with the weights of a parent, and return it."""
    model = prepare(new_config(env_id=ENV, env_kwargs={"robot": robot}, timesteps=steps, seed=seed))
    if parent != "new":
        model.set_parameters(parent)
    model.learn(steps, callback=NormalizerUpdate())
    model.get_env().close()
    return model


def score(model, robot):
    """Return the cost, slip, speed error and falls at 0.3 m/s, and the return over all speeds."""
    at = evaluate({"": model}, ENV, {"robot": robot}, [0.3], episodes=16)[""]["overall"]
    every = evaluate({"": model}, ENV, {"robot": robot}, episodes=4)[""]["overall"]
    names = "steady_cost_of_transport", "steady_slip_per_metre", "steady_speed_error", "falls"
    return {**{name: at[name][0] for name in names}, "return": every["return"][0]}


def climbed(model, robot):
    """Return the highest step that the robot climbs in half of 16 attempts at 0.4 m/s.

    The links collide with the step.
    """
    highest = 0.0
    for height in HEIGHTS:
        world = {"robot": robot, "terrain": one_step(1.0, height), "links_collide": True}
        raw = evaluate({"": model}, ENV, world, [0.4], episodes=16)[""]["raw"]
        over = np.greater(raw["distance"], 3.2) & ~np.array(raw["fell"], bool)
        if over.mean() < 0.5:
            break
        highest = height
    return highest


def train_all(steps, parent, robots):
    """Train a policy for each robot that has no scores yet, and write the scores and a figure."""
    path = Path("scores.json")
    scores = json.loads(path.read_text()) if path.exists() else {}
    for robot in robots:
        if robot not in scores:
            model = train(robot, steps, parent)
            model.save(f"{robot.replace('/', '_')}.zip")
            scores[robot] = {**score(model, robot), "step": climbed(model, robot)}
            print(robot, scores[robot], flush=True)
            path.write_text(json.dumps(scores, indent=1))
    figure = Figure((7.0, 4.4), layout="constrained")
    axis = figure.subplots()
    # The cost is NaN for a robot that does not walk.
    places = {
        Path(robot).stem: (score_["step"], score_["steady_cost_of_transport"] or math.nan)
        for robot, score_ in scores.items()
    }
    for k, (name, place) in enumerate(sorted(places.items(), key=lambda item: item[1][1])):
        axis.plot(*place, "C0o")
        axis.annotate(name, place, (4, -9 if k % 2 else 3), textcoords="offset points", fontsize=8)
    axis.margins(x=0.12)
    axis.set(xlabel="step climbed (m)", ylabel="cost of transport at 0.3 m/s")
    figure.savefig("scores.png", dpi=110)


def search(steps, parent, robot, designs):
    """Search the link lengths whose trained policy has the lowest cost; print all scores."""
    plan = read_plan("cost")
    limits = {name: ends for name, ends in plan.limits.items() if name in {**SHAPE, **PLANES}}
    plan = replace(
        plan,
        robot=robot,
        variables={"lengths": 0.3},
        population=8,
        objectives={"mass": "min"},
        limits=limits,
    )
    space, walker, least, trained = plan.space(), make_walker(plan), math.inf, 0
    cma = Cma(space.start, plan.population, 0)
    while trained < designs:
        unit, weights = cma.ask(), parent
        made = candidates(space, unit)
        _, violation = measure(plan, walker, made)
        costs = np.full((len(unit), 1), math.inf)
        for k in np.flatnonzero(violation == 0.0):
            path, trained = f"design_{trained}.json", trained + 1
            write_robot(path, made[k].robot)
            model = train(path, steps, weights)
            scores = score(model, path)
            costs[k] = scores["steady_cost_of_transport"] or math.inf
            if costs[k] < least:
                least, parent = costs[k, 0], model.get_parameters()
            print(f"{time.process_time():.0f} s", path, scores, flush=True)
        cma.tell(costs, violation)


if __name__ == "__main__":
    mode, steps, parent, *rest = sys.argv[1:]
    if mode == "train":
        train_all(int(steps), parent, rest)
    else:
        search(int(steps), parent, rest[0], int(rest[1]))
