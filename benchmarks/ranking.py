"""Whether the reward of ``JansenWalker-v0`` ranks controllers as the score table does.

    python -m benchmarks.ranking [--episodes 10] [--out logs/ranking] [--quick]

Controllers from good to useless, the shipped policy among them, are scored on the same episodes and
ranked twice: by their mean return, and by the table, that is by the mean, over the commands, of
their ranks in speed error, slip per metre, cost of transport, falls and RMS torque. One that does
not cover half of the commanded distance walks nowhere: at that command it comes after all that do,
by its speed error. Prints both and Spearman's rank correlation, and writes them to ``ranking.md``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.stats import rankdata, spearmanr

from agents.evaluate import load_named
from benchmarks import measure
from jansen_env.baselines.columns import columns
from jansen_env.baselines.pid import PID
from jansen_env.baselines.policy import Array, Policy, TorquePolicy
from jansen_env.baselines.walker_baselines import BASELINES, measured_setting, walking_pid
from jansen_env.robot import Robot
from jansen_env.scoring.benchmarks import WALKER
from jansen_env.scoring.metrics import Episodes, point_estimates
from jansen_env.scoring.rollout import make_env, run_episodes

ENV = "JansenWalker-v0"
FIRST_SEED = 50_000  # of the episodes, apart from all others
TABLE = ("speed_error", "slip_per_metre", "cost_of_transport", "falls", "rms_torque")
WALKS = 0.5  # share of the commanded distance from which a controller counts as walking
NOWHERE = 1e6  # more than any number of the table
BANG, NOISE = 12.0, 10.0  # N m: of bang-bang control, and at most of noise
SHIPPED = "PPO, shipped"


def speed_control(gain: float) -> Callable[[Any], Policy]:
    """Proportional control of the crank speed (gain: N m s/rad), and a mean torque with it."""

    def load(env: Any) -> Policy:
        setting = measured_setting("pid", Robot())
        command, rate = columns(env, "speed_command", "crank_speed")

        def controller(seen: Array, *_: Any) -> tuple[Array, None]:
            wanted = setting(seen[:, command])
            return gain * (wanted - seen[:, rate]) + 1.5 * wanted, None

        return TorquePolicy(controller, env.torque_limit)

    return load


def pid_with(pid: PID, pace: float = 1.0) -> Callable[[Any], Policy]:
    """The PID with other gains, or with ``pace`` times the measured crank speed."""
    setting = measured_setting("pid", Robot())
    return lambda env: walking_pid(lambda command: pace * setting(command), env, pid)


class Changed:
    """A policy whose actions are changed."""

    def __init__(self, policy: Policy, change: Callable[[Array], Array]) -> None:
        self.policy, self.change = policy, change

    def predict(self, *arguments: Any) -> tuple[Any, Any]:
        actions, state = self.policy.predict(*arguments)
        return self.change(actions).astype(np.float32), state


def torque(function: Callable[[int], Array]) -> Callable[[Any], Policy]:
    """Torques (n,), N m, of n robots, whatever they observe."""
    return lambda env: TorquePolicy(lambda seen, *_: (function(len(seen)), None), env.torque_limit)


def noisy(env: Any) -> Policy:
    """The PID, and as much noise."""
    rng = np.random.default_rng(0)
    limit = NOISE / env.torque_limit
    return Changed(
        BASELINES["pid"](env), lambda a: np.clip(a + rng.uniform(-limit, limit, a.shape), -1, 1)
    )


def bang_bang(env: Any) -> Policy:
    """The PID's sign."""
    return Changed(BASELINES["pid"](env), lambda a: np.sign(a) * BANG / env.torque_limit)


def random_torque(env: Any) -> Policy:
    """Uniform over the whole range, at each step."""
    rng = np.random.default_rng(1)
    return torque(lambda n: env.torque_limit * rng.uniform(-1.0, 1.0, n))(env)


CONTROLLERS: dict[str, Callable[[Any], Policy]] = {
    "profile": BASELINES["profile"],
    "PID, the paper's": BASELINES["pid"],
    "PID, stiff": pid_with(PID(100.0, 10.0, 10.0)),
    "PID, soft": pid_with(PID(3.0, 0.3, 0.3)),
    "PID, 0.6 of the speed": pid_with(PID(), 0.6),
    "PID, 1.4 of the speed": pid_with(PID(), 1.4),
    "PID and noise": noisy,
    "PID, bang-bang": bang_bang,
    "crank speed, stiff": speed_control(30.0),
    "crank speed, soft": speed_control(5.0),
    "constant torque": BASELINES["constant"],
    "random torque": random_torque,
    "standing": torque(np.zeros),
}
"""Each is made for an unwrapped environment."""


def score(policy: Policy, env: Any, commands: Array, seeds: Any) -> list[dict[str, float]]:
    """The table's numbers over all commands, then at each; nan where there is none."""
    run: Episodes = run_episodes(policy, ENV, {}, commands, seeds)
    horizon = env.spec.max_episode_steps * env.unwrapped.control_dt
    rows = []
    for command in (None, *np.unique(commands)):
        part = slice(None) if command is None else run["command"] == command
        own = {name: values[part] for name, values in run.items()}
        found = point_estimates(WALKER.metrics, own, env)
        row = {name: np.nan if value is None else value for name, value in found.items()}
        row["share"] = float((own["distance"] / own["command"]).mean() / horizon)  # of the way
        rows.append(row)
    return rows


def table_ranks(at_command: list[dict[str, float]]) -> Array:
    """Mean ranks of controllers at a command, over the table's columns; 1 is the best."""
    walks = np.array([row["share"] >= WALKS for row in at_command])
    last = NOWHERE + np.array([row["speed_error"] for row in at_command])
    columns = [np.where(walks, [row[name] for row in at_command], last) for name in TABLE]
    ranks: Array = np.mean([rankdata(column) for column in columns], axis=0)
    return ranks


def rank(rows: dict[str, list[dict[str, float]]]) -> tuple[str, float]:
    """A Markdown table, the best by return first, and Spearman's correlation of the two ranks."""
    names, scores = list(rows), [own[0] for own in rows.values()]
    mean = np.mean([table_ranks(list(at)) for at in zip(*rows.values(), strict=True)][1:], axis=0)
    by_return, by_table = rankdata([-row["return"] for row in scores]), rankdata(mean)
    correlation = float(spearmanr(by_return, by_table)[0])
    columns = ("return", *TABLE)
    lines = [
        [names[i], *(f"{scores[i][name]:.3g}" for name in columns), f"{mean[i]:.1f}",
         f"{by_return[i]:g}", f"{by_table[i]:g}"]
        for i in np.argsort(by_return)
    ]  # fmt: skip
    headings = [WALKER.metrics[name].heading for name in columns]
    headers = ["controller", *headings, "mean rank", "rank by return", "rank by table"]
    return measure.table(headers, lines), correlation


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    found = measure.chosen(measure.options(__doc__, "logs/ranking", episodes=10), arguments)
    grid, episodes = ((0.3,), 1) if found.quick else (WALKER.commands, found.episodes)
    commands = np.repeat(grid, episodes)
    seeds = FIRST_SEED + np.arange(len(commands))
    env = make_env(ENV, {})
    policies = {SHIPPED: load_named("pretrained", env)}
    policies |= {name: load(env.unwrapped) for name, load in CONTROLLERS.items()}
    table, correlation = rank(
        {name: score(policy, env, commands, seeds) for name, policy in policies.items()}
    )
    env.close()
    conclusion = f"Spearman's rank correlation: {correlation:.3f}"
    measure.report(found.out / "ranking.md", table, conclusion)


if __name__ == "__main__":
    main()
