"""Scores over friction and foot stiffness: ``jansen-env evaluate --robustness``.

All policies have the same starts and the same commands, drawn from the environment's range, under
every condition. Policies and baselines are those of the environment as it is: none is tuned again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import astuple
from pathlib import Path
from textwrap import fill
from typing import Any, TypeAlias

import numpy as np
from matplotlib.figure import Figure

from jansen_env.baselines.policy import Policy
from jansen_env.commands.plots import draw_curve, finish_panel, legend_above, save
from jansen_env.files import write_json, write_text
from jansen_env.robot import RIGID, Compliance, Robot, built_robot
from jansen_env.scoring.benchmarks import find_benchmark
from jansen_env.scoring.metrics import (
    INTERVALS,
    Metric,
    interval_text,
    pooled,
    score_table,
    screen_table,
)
from jansen_env.scoring.rollout import draw_episodes, make_env, run_episodes

FRICTIONS = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
STIFFNESSES = (10, 20, 50, 100, 200, 500, math.inf)  # kN/m
FRICTION, FEET = "friction", "foot stiffness (kN/m)"  # what is swept, as it is labelled
METRICS = ("return", "steady_slip_per_metre", "steady_speed_error", "falls")
FEWER = {"rigid_body": 10}  # by plant: a 10 s episode takes it some 15 s

Loaded: TypeAlias = Sequence[tuple[dict[str, Policy], dict[str, Any]]]
"""Policies by name, and the environment's arguments: of :func:`.named_policies.load_all`."""

Scores: TypeAlias = dict[str, dict[str, dict[str, dict[str, Any]]]]
"""Result of :func:`jansen_env.scoring.metrics.pooled` by sweep, condition and policy."""


def feet(robot: Robot, stiffness: float) -> Compliance:
    """Return feet of a stiffness, N/m: the robot's scaled, or the built one's if those are rigid.

    An infinite one is rigid. Damping is scaled by the root, as of a rubber of the same loss factor
    at the lower frequency (:func:`jansen_env.robot.buildable.foot_damping`).
    """
    if stiffness == math.inf:
        return RIGID
    own = (built_robot() if robot.pad_compliance.rigid else robot).pad_compliance
    scale = stiffness / own.stiffness
    powers = np.array((1.0, 0.5, 1.0, 0.5))  # of stiffness and damping, normal and tangential
    return Compliance(*(np.array(astuple(own)) * scale**powers).tolist())


def score(loaded: Loaded, env_id: str, episodes: int, seed: int = 0) -> Scores:
    """Score policies under each condition on so many episodes, fewer on a plant in :data:`FEWER`.

    Raises:
        ValueError: an argument out of range, or feet that give and a restitution above 0.
    """
    metrics = find_benchmark(env_id).metrics
    scores: Scores = {FRICTION: {}, FEET: {}}
    for policies, env_kwargs in loaded:
        env: Any = make_env(env_id, env_kwargs)
        count = math.ceil(episodes / FEWER.get(env_kwargs.get("plant", ""), 1))
        commands, seeds = draw_episodes(env, episodes, seed)
        conditions: list[tuple[str, str, dict[str, Any], dict[str, Any]]] = [
            # At the reset, so that it also holds where the environment draws its friction.
            *((FRICTION, f"{value:g}", {}, {"friction": np.full(count, value)})
              for value in FRICTIONS),
            *((FEET, "rigid" if value == math.inf else f"{value:g}",
               {"pad_compliance": feet(env.unwrapped.robot, 1e3 * value)}, {})
              for value in STIFFNESSES),
        ]  # fmt: skip
        for sweep, condition, changes, options in conditions:
            for name, policy in policies.items():
                given = {**env_kwargs, **changes}, commands[:count], seeds[:count]
                run = run_episodes(policy, env_id, *given, options=options)
                scores[sweep].setdefault(condition, {})[name] = pooled(metrics, run, env, seed)
        env.close()
    return scores


def table(scores: Scores, metrics: dict[str, Metric]) -> str:
    """Return a Markdown table of each sweep, a row per condition and policy."""
    return "\n\n".join(
        score_table(
            metrics,
            {f"{condition}, {name}": own
             for condition, policies in conditions.items() for name, own in policies.items()},
            f"{sweep}, policy",
        )
        for sweep, conditions in scores.items()
    )  # fmt: skip


def plot(scores: Scores, metrics: dict[str, Metric], path: Path) -> Path:
    """Draw a row per metric, a column per sweep, a line per policy; bands are 95 % intervals."""
    figure = Figure(figsize=(4.5 * max(len(scores), 1.5), 10.0), layout="constrained")
    shape = len(metrics), len(scores)
    axes: Any = figure.subplots(*shape, sharex="col", sharey="row", squeeze=False)
    for column, (sweep, conditions) in zip(axes.T, scores.items(), strict=True):
        for axis, (name, metric) in zip(column, metrics.items(), strict=True):
            for policy in next(iter(conditions.values())):
                found = [policies[policy]["overall"][name] for policies in conditions.values()]
                intervals = zip(*found, strict=True)
                draw_curve(axis, metric, range(len(found)), list(intervals), policy)
            finish_panel(axis, metric)
            axis.set_title(metric.heading, fontsize=11)
        column[-1].set_xlabel(sweep, fontsize=11)
        column[-1].set_xticks(range(len(conditions)), conditions)
    legend_above(figure, axes[0, 0])
    return save(figure, path)


def short_table(scores: Scores) -> str:
    """Return the return under each condition, a column per policy."""
    rows = [
        [f"{sweep} {condition}",
         *(interval_text(own["overall"]["return"][:1]) for own in policies.values())]
        for sweep, conditions in scores.items() for condition, policies in conditions.items()
    ]  # fmt: skip
    return screen_table([["return", *next(iter(scores[FRICTION].values()))], *rows])


def where(everything: bool, out: Path | None, name: str) -> str:
    """Return the lines below scores: how intervals are made, where all scores are."""
    intervals = f"{fill(INTERVALS, 80)}\n" if everything else ""
    files = f"all scores: {out}/{name}.md, {name}.json, {name}.png"
    return intervals + (files if out else "all scores: --all prints them, --out DIR writes them")


def report(
    loaded: Loaded, env_id: str, episodes: int, seed: int, out: Path | None, everything: bool
) -> str:
    """Score, write ``robustness.json``, ``.md`` and ``.png`` into ``out``, if any; return a table
    of the returns, or of everything."""
    scores = score(loaded, env_id, episodes, seed)
    metrics = {name: find_benchmark(env_id).metrics[name] for name in METRICS}
    text = table(scores, metrics)
    if out:
        write_json(out / "robustness.json", scores)
        write_text(out / "robustness.md", f"{text}\n\n{INTERVALS}\n")
        plot(scores, metrics, out / "robustness.png")
    slow = [plant for _, kwargs in loaded if (plant := kwargs.get("plant")) in FEWER]
    fewer = "".join(f" (on {plant} 1/{FEWER[plant]} of that)" for plant in slow)
    return (
        f"{text if everything else short_table(scores)}\n\n{episodes} episodes of {env_id} under "
        f"each condition{fewer}, commands drawn from its range, seed {seed}\n"
        f"{where(everything, out, 'robustness')}"
    )
