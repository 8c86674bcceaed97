"""Does a policy depend on details of the simulation on which it was trained?

Run the experiment as follows. It takes about 35 minutes on one core, most of them for the two other
simulation backends.

    python experiments/transfer.py [--episodes 32] [--quick]

Every pretrained policy for level ground is tested, unchanged, with other time steps, feet and
friction, in the rigid-body backend and in MuJoCo. The policies for rough terrain are tested with
other time steps, feet and friction. The script writes ``docs/transfer/transfer.json`` and the
tables of docs/transfer.md.
"""

from contextlib import nullcontext
from typing import Any

from mujoco_backend import environments_in_mujoco
from pages import options, publish, rounded, table
from scipy.stats import spearmanr

from jansen_env import Compliance, evaluate
from jansen_env.policies import pretrained
from jansen_env.tasks.walking.presets import HARDCORE, ROUGH

DATA, PAGE = "transfer/transfer.json", "transfer.md"
ENVS = ("JansenWalker-v0", "JansenWalkerBuilt-v0")
COMMANDS = {"onboard": (0.1, 0.2, 0.3), "weekend": (0.04, 0.08, 0.12)}
"""Commands of policies that were trained for low speeds, in m/s."""
USUAL_COMMANDS = (0.1, 0.3, 0.5)
METRICS = {
    "return": 0,
    "steady_slip_per_metre": 2,
    "steady_cost_of_transport": 2,
    "unsupported": 2,
    "load": 1,
}
"""Metrics, and the number of decimals in the tables."""
NOMINAL, NOMINAL_SHORT = "as trained", "as trained, 5 s"
CONDITIONS: dict[str, dict[str, Any]] = {
    NOMINAL: {},
    "step 0.5 ms": {"time_step": 5e-4},
    "step 2 ms": {"time_step": 2e-3},
    "soft feet": {"randomize": {"foot_stiffness_scale": (0.5, 0.5)}},
    "stiff feet": {"randomize": {"foot_stiffness_scale": (2.0, 2.0)}},
    "rigid feet": {"pad_compliance": Compliance()},
    "friction 0.5": {"friction": 0.5},
    "friction 1": {"friction": 1.0},
}
"""Arguments of the environments in which each policy walks for 10 s."""
BACKENDS: dict[str, dict[str, Any]] = {
    NOMINAL_SHORT: {},
    "rigid body": {"plant": "rigid_body"},
    "MuJoCo": {"plant": "rigid_body", "time_step": 2e-4},
}
"""Arguments of the environments in which each policy walks for 5 s from the same few starts."""
TERRAIN_ENVS = {"JansenWalkerRough-v0": ROUGH, "JansenWalkerHardcore-v0": HARDCORE}
"""Environments with terrain, and their default arguments."""
TERRAIN_METRICS = {"success": 2, "return": 0, "falls": 2, "unsupported": 2, "load": 1}
"""Metrics on terrain, and the number of decimals in the tables."""
LEFT_OUT = "MuJoCo", "rigid feet"
"""Conditions that a second computation of the correlation leaves out."""
SHORT = 250  # number of steps of an episode on the other backends
SEED = 3

Scores = dict[str, dict[str, list[float | None]]]
"""Value and ends of the 95 % interval of each metric, by condition and metric."""


def title(env_id: str, name: str) -> str:
    """Return the name of a policy in the tables."""
    return f"{env_id.removesuffix('-v0')}: {name}"


def measure(env_id: str, name: str, episodes: int, few: int, short: int) -> Scores:
    """Score a policy under all conditions.

    Args:
        env_id: Id of its environment.
        name: Name of the policy.
        episodes: Number of episodes per command.
        few: Number of episodes per command on the other backends.
        short: Number of steps of these episodes.
    """
    policy = pretrained.load(env_id, name)
    commands = COMMANDS.get(name, USUAL_COMMANDS)
    limit = {"max_episode_steps": short}
    runs = [(condition, kwargs, episodes) for condition, kwargs in CONDITIONS.items()]
    runs += [(condition, {**kwargs, **limit}, few) for condition, kwargs in BACKENDS.items()]
    scores: Scores = {}
    for condition, kwargs, count in runs:
        together = {**policy.env_kwargs, **kwargs}
        try:
            with environments_in_mujoco() if condition == "MuJoCo" else nullcontext():
                found = evaluate(
                    {name: policy}, env_id, together, commands=commands, episodes=count, seed=SEED
                )[name]
        except ValueError as error:  # rigid feet have no stiffness; stiff feet need short steps
            print(f"{name}, {condition}: {error}", flush=True)
            continue
        overall = found["overall"]
        scores[condition] = {metric: overall[metric] for metric in (*METRICS, "falls")}
        print(f"{name}, {condition}: {overall['return']}", flush=True)
    return scores


def measure_on_terrain(env_id: str, name: str, episodes: int) -> Scores:
    """Score a policy for rough terrain under all conditions, at the five commands of the benchmark.

    The levels of the terrain, the friction and other parameters are sampled as in training, except
    those that the condition sets.

    Args:
        env_id: Id of its environment.
        name: Name of the policy.
        episodes: Number of episodes per command.
    """
    policy = pretrained.load(env_id, name)
    scores: Scores = {}
    for condition, changes in CONDITIONS.items():
        together = {**policy.env_kwargs, **changes}
        if "randomize" in changes:
            sampled = TERRAIN_ENVS[env_id]["randomize"]
            together["randomize"] = {**sampled, **changes["randomize"]}
        found = evaluate({name: policy}, env_id, together, episodes=episodes, seed=SEED)[name]
        scores[condition] = {metric: found["overall"][metric] for metric in TERRAIN_METRICS}
        print(f"{name}, {condition}: {scores[condition]['success']}", flush=True)
    return scores


def kept_return(scores: Scores, condition: str) -> float | None:
    """Return the return under a condition as a fraction of the return without it."""
    if condition not in scores:
        return None
    nominal = scores[NOMINAL_SHORT if condition in BACKENDS else NOMINAL]["return"][0]
    value = scores[condition]["return"][0]
    return None if value is None or not nominal else value / nominal


def changed_conditions() -> list[str]:
    """Return the names of the conditions that differ from those of the training."""
    return [name for name in (*CONDITIONS, *BACKENDS) if name not in (NOMINAL, NOMINAL_SHORT)]


def worst(scores: Scores, conditions: list[str] | None = None) -> tuple[float, str]:
    """Return the score of a policy, which is its smallest kept return, and its condition."""
    kept = {name: kept_return(scores, name) for name in conditions or changed_conditions()}
    return min((value, name) for name, value in kept.items() if value is not None)


def rank_correlation(policies: dict[str, Scores], without: str = "") -> tuple[float, float]:
    """Return Spearman's correlation of the unsupported time with the score, and its p-value.

    Args:
        policies: Scores of each policy.
        without: Condition that does not count.
    """
    conditions = [name for name in changed_conditions() if name != without]
    hops = [scores[NOMINAL]["unsupported"][0] for scores in policies.values()]
    found = spearmanr(hops, [worst(scores, conditions)[0] for scores in policies.values()])
    return float(found.statistic), float(found.pvalue)


def value_of(scores: Scores, condition: str, metric: str, decimals: int) -> str:
    """Return a metric under a condition as text."""
    return rounded(scores[condition][metric][0] if condition in scores else None, decimals)


def tables(results: dict[str, Any]) -> dict[str, list[str]]:
    """Return the tables of the page: kept returns, correlations, then each metric."""
    policies: dict[str, Scores] = results["policies"]
    changed = changed_conditions()
    kept = [
        [
            name,
            *(rounded(kept_return(scores, condition), 2) for condition in changed),
            "{:.2f} ({})".format(*worst(scores)),
        ]
        for name, scores in policies.items()
    ]
    correlations = [
        [label, *(f"{value:.2f}" for value in rank_correlation(policies, without))]
        for label, without in (("all", ""), *((f"all but {name}", name) for name in LEFT_OUT))
    ]
    made = [
        table(["fraction of the return", *changed, "worst"], kept),
        table(["conditions", "rank correlation", "p-value"], correlations),
    ]
    conditions = (*CONDITIONS, *BACKENDS)
    for metric, decimals in METRICS.items():
        rows = [
            [policy, *(value_of(scores, name, metric, decimals) for name in conditions)]
            for policy, scores in policies.items()
        ]
        made.append(table([metric.replace("_", " "), *conditions], rows))
    for metric, decimals in TERRAIN_METRICS.items():
        rows = [
            [policy, *(value_of(scores, name, metric, decimals) for name in CONDITIONS)]
            for policy, scores in results["on_terrain"].items()
        ]
        made.append(table([f"{metric} on terrain", *CONDITIONS], rows))
    return {PAGE: made}


def main() -> None:
    """Measure, and write the data and the tables."""
    args = options(__doc__, episodes=32)
    level = [(env_id, name) for env_id in ENVS for name in pretrained.names(env_id)]
    terrain = [(env_id, name) for env_id in TERRAIN_ENVS for name in pretrained.names(env_id)]
    episodes, few, short = args.episodes, 1, SHORT
    if args.quick:
        level, terrain = [*level[:2], *level[-1:]], terrain[-1:]
        episodes, short = 1, 5
    policies = {
        title(env_id, name): measure(env_id, name, episodes, few, short) for env_id, name in level
    }
    on_terrain = {
        title(env_id, name): measure_on_terrain(env_id, name, episodes) for env_id, name in terrain
    }
    results = {
        "episodes": episodes,
        "few": few,
        "steps": short,
        "policies": policies,
        "on_terrain": on_terrain,
    }
    publish(args.out, DATA, results, tables(results))


if __name__ == "__main__":
    main()
