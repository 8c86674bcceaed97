"""Scores over friction and foot stiffness: ``jansen-env evaluate --robustness``.

All policies have the same starts and the same commands, drawn from the environment's range, under
every condition. Policies and baselines are those of the environment as it is: none is tuned again.
"""

from __future__ import annotations

import math
from contextlib import closing
from dataclasses import astuple
from typing import Any

import numpy as np

from jansen_env.baselines.policy import Policy
from jansen_env.commands.plots import Sweeps
from jansen_env.robot import RIGID, Compliance, Robot, built_robot
from jansen_env.scoring.evaluation import evaluate
from jansen_env.scoring.metrics import interval_text, screen_table
from jansen_env.scoring.rollout import make_env

FRICTIONS = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
STIFFNESSES = (10, 20, 50, 100, 200, 500, math.inf)  # kN/m
FRICTION, FEET = "friction", "foot stiffness (kN/m)"  # names of the sweeps
METRICS = ("return", "steady_slip_per_metre", "steady_speed_error", "falls")  # of the figure
FEWER = {"rigid_body": 10}  # by plant: a 10 s episode takes it some 15 s


def feet(robot: Robot, stiffness: float) -> Compliance:
    """Return feet of a stiffness, N/m: the robot's scaled, or the built one's if those are rigid.

    An infinite one is rigid. Damping is scaled by the root, as of a rubber of the same loss factor
    at the lower frequency (:func:`jansen_env.robot.buildable.foot_damping`).
    """
    if stiffness == math.inf:
        return RIGID
    nominal = (built_robot() if robot.pad_compliance.rigid else robot).pad_compliance
    powers = np.array((1.0, 0.5, 1.0, 0.5))  # of stiffness and damping, normal and tangential
    scale = (stiffness / nominal.stiffness) ** powers
    return Compliance(*(np.array(astuple(nominal)) * scale).tolist())


def score(
    policies: dict[str, Policy], env_id: str, env_kwargs: dict[str, Any], episodes: int, seed: int
) -> Sweeps:
    """Score policies under each condition on so many episodes, fewer on a plant in :data:`FEWER`.

    Raises:
        ValueError: an argument out of range, or feet that give and a restitution above 0.
    """
    count = math.ceil(episodes / FEWER.get(env_kwargs.get("plant", ""), 1))
    with closing(make_env(env_id, env_kwargs)) as env:
        robot = env.unwrapped.robot  # type: ignore[attr-defined]
    sweeps: Sweeps = {FRICTION: {}, FEET: {}}

    def add(sweep: str, value: float, changes: dict[str, Any], **options: Any) -> None:
        scores = evaluate(policies, env_id, {**env_kwargs, **changes}, None, count, seed,
                          drawn=True, options=options)  # fmt: skip
        sweeps[sweep]["rigid" if value == math.inf else f"{value:g}"] = dict(scores)

    for value in FRICTIONS:  # set at the reset, as the environment may draw its own
        add(FRICTION, value, {}, friction=np.full(count, value))
    for value in STIFFNESSES:
        add(FEET, value, {"pad_compliance": feet(robot, 1e3 * value)})
    return sweeps


def by_condition(sweeps: Sweeps) -> dict[str, dict[str, Any]]:
    """Return sweeps as scores by condition and policy, such as "friction 0.3, pid"."""
    return {
        f"{sweep} {condition}, {policy}": summary
        for sweep, conditions in sweeps.items()
        for condition, policies in conditions.items()
        for policy, summary in policies.items()
    }


def return_table(sweeps: Sweeps) -> str:
    """Return the return under each condition, a column per policy."""
    cells = [
        [f"{sweep} {condition}",
         *(interval_text(summary["overall"]["return"][:1]) for summary in policies.values())]
        for sweep, conditions in sweeps.items() for condition, policies in conditions.items()
    ]  # fmt: skip
    return screen_table([["return", *next(iter(sweeps[FRICTION].values()))], *cells])
