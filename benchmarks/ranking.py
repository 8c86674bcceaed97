"""Rank controllers of ``JansenWalker-v0`` by the reward and by the score table.

    python -m benchmarks.ranking [--episodes 10] [--out logs/ranking] [--quick]

By the table: by the mean, over the commands, of their ranks in :data:`TABLE`. One that does not
cover half of the commanded distance comes after all that do at that command, by its speed error.
Writes both and Spearman's rank correlation to ``ranking.md``.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TypeAlias, cast

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata, spearmanr

from benchmarks import measure
from jansen_env.baselines.pid import PID
from jansen_env.baselines.policy import Array, Bools, Policy, TorquePolicy, columns
from jansen_env.commands.named_policies import load_named
from jansen_env.robot import Robot
from jansen_env.scoring.metrics import Episodes, point_estimates
from jansen_env.scoring.rollout import make_env, run_episodes
from jansen_env.tasks.walking import JansenWalkerEnv
from jansen_env.tasks.walking.walker_baselines import BASELINES, measured_setting, walking_pid
from jansen_env.tasks.walking.walker_benchmark import WALKER

ENV = "JansenWalker-v0"
HORIZON = 10.0  # s, of an episode
FIRST_SEED = 50_000  # of the episodes, apart from all others
TABLE = ("speed_error", "slip_per_metre", "cost_of_transport", "falls", "rms_torque")
WALKS = 0.5  # share of the commanded distance from which a controller counts as walking
NOWHERE = 1e6  # more than any number of the table
BANG, NOISE = 12.0, 10.0  # N m: of bang-bang control, and at most of noise
SHIPPED = "PPO, shipped"

Loader: TypeAlias = Callable[[JansenWalkerEnv], Policy]
"""Makes a policy for an environment."""


def speed_control(gain: float) -> Loader:
    """Proportional control of the crank speed (gain: N m s/rad), and a mean torque with it."""

    def load(env: JansenWalkerEnv) -> Policy:
        setting = measured_setting("pid", Robot())
        command, rate = columns(env, "speed_command", "crank_speed")

        def controller(seen: Array, *_: object) -> tuple[Array, None]:
            wanted = setting(seen[:, command])
            return gain * (wanted - seen[:, rate]) + 1.5 * wanted, None

        return TorquePolicy(controller, env.torque_limit)

    return load


def pid_with(pid: PID, pace: float = 1.0) -> Loader:
    """The PID with other gains, or with ``pace`` times the measured crank speed."""
    setting = measured_setting("pid", Robot())
    return lambda env: walking_pid(lambda command: pace * setting(command), env, pid)


def changed_pid(change: Callable[[Array, np.random.Generator], Array]) -> Loader:
    """The PID with its torques (n,), N m, changed."""

    def load(env: JansenWalkerEnv) -> Policy:
        pid, rng = BASELINES["pid"](env), np.random.default_rng(0)

        def controller(seen: Array, memory: object, starts: Bools) -> tuple[Array, object]:
            actions, memory = pid.predict(seen, memory, starts)
            return change(env.torque_limit * actions[:, 0], rng), memory

        return TorquePolicy(controller, env.torque_limit)

    return load


def random_torque(env: JansenWalkerEnv, size: float = 1.0) -> Policy:
    """Uniform over a share of the whole range, at each step."""
    rng, limit = np.random.default_rng(1), env.torque_limit
    return TorquePolicy(
        lambda seen, *_: (size * limit * rng.uniform(-1.0, 1.0, len(seen)), None), limit
    )


CONTROLLERS: dict[str, Loader] = {
    "profile": BASELINES["profile"],
    "PID, the paper's": BASELINES["pid"],
    "PID, stiff": pid_with(PID(100.0, 10.0, 10.0)),
    "PID, soft": pid_with(PID(3.0, 0.3, 0.3)),
    "PID, 0.6 of the speed": pid_with(PID(), 0.6),
    "PID, 1.4 of the speed": pid_with(PID(), 1.4),
    "PID and noise": changed_pid(lambda t, rng: t + rng.uniform(-NOISE, NOISE, t.shape)),
    "PID, bang-bang": changed_pid(lambda t, _: BANG * np.sign(t)),
    "crank speed, stiff": speed_control(30.0),
    "crank speed, soft": speed_control(5.0),
    "constant torque": BASELINES["constant"],
    "random torque": random_torque,
    "standing": partial(random_torque, size=0.0),
}


def score(
    policy: Policy, env: gym.Env[Array, Array], commands: Array, seeds: NDArray[np.int64]
) -> list[dict[str, float]]:
    """The table's numbers over all commands, then at each; nan where there is none."""
    run: Episodes = run_episodes(policy, ENV, {}, commands, seeds)
    rows = []
    for command in (None, *np.unique(commands)):
        part = slice(None) if command is None else run["command"] == command
        episodes = {name: values[part] for name, values in run.items()}
        estimates = point_estimates(WALKER.metrics, episodes, env)
        row = {name: np.nan if value is None else value for name, value in estimates.items()}
        row["share"] = float(
            (episodes["distance"] / episodes["command"]).mean() / HORIZON
        )  # of the way
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
    names, scores = list(rows), [row[0] for row in rows.values()]
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
    args = measure.parse(measure.options(__doc__, "logs/ranking", episodes=10), arguments)
    grid, episodes = ((0.3,), 1) if args.quick else (WALKER.commands, args.episodes)
    commands = np.repeat(grid, episodes)
    seeds = FIRST_SEED + np.arange(len(commands))
    env = make_env(ENV, {})
    policies = {SHIPPED: load_named("pretrained", env)}
    unwrapped = cast(JansenWalkerEnv, env.unwrapped)
    policies |= {name: load(unwrapped) for name, load in CONTROLLERS.items()}
    table, correlation = rank(
        {name: score(policy, env, commands, seeds) for name, policy in policies.items()}
    )
    env.close()
    conclusion = f"Spearman's rank correlation: {correlation:.3f}"
    measure.report(args.out / "ranking.md", table, conclusion)


if __name__ == "__main__":
    main()
