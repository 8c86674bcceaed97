"""Which algorithm learns to walk best with the same budget and the same number of trials?

Run the experiment as follows. It takes about four hours of one core.

    python experiments/algorithms.py [--workers 2] [--only COMPARISON] [--logs logs/algorithms]

Each of the :data:`COMPARISONS` has a track of the benchmark and a budget for each run: either 90 s
of processor time, or 200,000 steps of the environment. For each budget, every algorithm is tuned
with five trials on JansenWalkerBuilt-v0. A trial draws its hyperparameters from the ranges in
:func:`drawn`, trains for about half of the budget on one of the seeds 100 to 102, and scores its
last model by the mean return over the commands of the environment, in episodes that are not test
episodes. All algorithms have the same observations, reward and wrappers, and networks have the same
features of the observations. ARS has its linear policy, which knows no features. The comparisons on
rough terrain take the hyperparameters that were tuned on flat ground. In the comparison
``default_flat``, PPO and SAC have the hyperparameters that Stable-Baselines3 uses if none are
given, a single robot, and no features.

Each configuration trains on the seeds 1, 2 and so on, and the benchmark scores the last model of
each run. The script writes a result file ``results/ALGORITHM_COMPARISON_SEED.json`` for each run,
the hyperparameters ``agents/studies/equal/ALGORITHM_COMPARISON.yml``, and
docs/algorithms/algorithms.json with all trials and runs. Jobs whose files exist in the folder of
the runs are left out, so that the experiment can be interrupted. A finished run with other
hyperparameters is refused. To tune the algorithms again, begin with an empty folder of the runs.
"""

import argparse
import inspect
import itertools
import os
import time
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import torch
import yaml
from pages import DOCS, QUICK, ROOT, publish, table
from scipy.stats import mannwhitneyu

from agents.training.runs import FINAL, record_run
from agents.training.train_model import prepare, train
from jansen_env.cli.named_policies import load_named, policy_sha256
from jansen_env.files import write_text
from jansen_env.sb3.run_config import ALGORITHMS as CLASSES
from jansen_env.sb3.run_config import RunConfig, load_config
from jansen_env.scoring.evaluation import evaluate
from jansen_env.scoring.protocol import METRICS, TRACKS, metric_value, run_track
from jansen_env.scoring.result_files import (
    TrackResult,
    new_result,
    rounded,
    write_result,
)
from jansen_env.scoring.rollout import make_env

DATA, PAGE = "algorithms/algorithms.json", "studies.md"
ALGORITHMS = ("ppo", "sac", "tqc", "ars")
DEFAULT = "default"  # name of the budget with the hyperparameters of the library
TRIALS = 5  # per algorithm
FEATURES = {"normalize": True, "harmonics": 4, "half_turn": True}
"""Features of the observations, which all networks get."""
SCORES = [
    "algorithm",
    "runs",
    "steps",
    "updates per 1,000 steps",
    "processor time (s)",
    "return",
    "lowest",
    "highest",
    "success",
    "load (weights)",
]
PAIRS = ["track and budget", "first", "second", "probability that the first is better", "p"]


@dataclass(frozen=True)
class Comparison:
    """Runs of several algorithms with the same budget on the same track.

    Attributes:
        budget: Name of the budget in names of files.
        track: Name of the track of the benchmark.
        runs: Number of training runs of each algorithm.
        algorithms: Names of the algorithms.
        steps: Number of environment steps of a run. None if the budget is a processor time.
        seconds: Processor time of a run without a number of steps, in s.
        tuned: Whether the hyperparameters are found with trials. Otherwise, they are those of the
            comparison with the same budget on flat ground, or the defaults of the library.
    """

    budget: str
    track: str
    runs: int
    algorithms: tuple[str, ...] = ALGORITHMS
    steps: int | None = None
    seconds: float = 90.0
    tuned: bool = False

    @property
    def name(self) -> str:
        """Name of the comparison."""
        return f"{self.budget}_{self.track}"

    @property
    def amount(self) -> str:
        """Budget of a run, in words."""
        budget = f"{self.seconds:.0f} s" if self.steps is None else f"{self.steps:,} steps"
        return f"library defaults, {budget}" if self.budget == DEFAULT else budget


COMPARISONS = (
    Comparison("90s", "flat", 10, tuned=True),
    Comparison("200k", "flat", 10, ("ppo", "sac", "ars"), steps=200_000, tuned=True),
    Comparison(DEFAULT, "flat", 5, ("ppo", "sac")),
    Comparison("90s", "terrain", 5, ("ppo", "sac")),
    Comparison("90s", "robust", 5, ("ppo", "sac")),
)


def title(algo: str, comparison: Comparison) -> str:
    """Return the name of an algorithm in tables of the benchmark."""
    return f"{algo.upper()}, {comparison.amount}"


def drawn(algo: str, trial: int, few_steps: bool) -> RunConfig:
    """Return the configuration of a trial; its number of steps is not yet that of its budget.

    Args:
        algo: Name of the algorithm.
        trial: Number of the trial, which seeds the draws.
        few_steps: Whether the budget is a number of steps. Then fewer robots train side by side,
            and the networks are updated more often per step.
    """
    random = np.random.default_rng([ALGORITHMS.index(algo), int(few_steps), trial])

    def pick(*values: Any) -> Any:
        return values[random.integers(len(values))]

    def between(low: float, high: float) -> float:
        return float(f"{np.exp(random.uniform(np.log(low), np.log(high))):.2g}")

    common: dict[str, Any] = {
        "algo": algo,
        "reward_scale": pick(0.1, 0.3, 1.0),
        "fall_cost": pick(0.0, 30.0),
        "seed": 100 + trial % 3,
    }
    features = {**FEATURES, "net_arch": [64, 64]}
    hyperparameters: dict[str, Any]
    if algo == "ars":
        common["n_envs"] = 4 if few_steps else 16
        features = {"net_arch": [], "with_bias": False, "squash_output": False}
        hyperparameters = {
            "n_eval_episodes": common["n_envs"],
            "learning_rate": f"linear_{between(5e-3, 0.1)}",
            "delta_std": between(0.02, 0.3),
            "n_delta": pick(4, 8) if few_steps else pick(8, 16, 32),
        }
    elif algo == "ppo":
        common["n_envs"] = pick(8, 16, 32) if few_steps else pick(16, 32, 64, 256)
        rollouts = pick(2048, 4096) if few_steps else pick(4096, 16384)
        hyperparameters = {
            "learning_rate": f"linear_{between(3e-4, 3e-3)}",
            "n_steps": rollouts // common["n_envs"],
            "batch_size": pick(128, 256, 512) if few_steps else pick(512, 1024, 4096),
            "n_epochs": int(random.integers(3, 13)),
            "gamma": pick(0.98, 0.99, 0.995),
            "gae_lambda": pick(0.95, 0.98),
            "ent_coef": pick(0.0, 0.0005),
        }
        features["log_std_init"] = pick(0.0, -0.5, -1.0)
    else:
        common["n_envs"] = 16 if few_steps else 64
        hyperparameters = {
            "learning_rate": f"linear_{between(3e-4, 3e-3)}",
            "learning_starts": 3200,
            "buffer_size": 300_000,
            "batch_size": 256,
            "gradient_steps": pick(1, 2) if few_steps else pick(2, 4, 8),
            "gamma": pick(0.98, 0.99, 0.995),
            "tau": pick(0.005, 0.01, 0.02),
            "ent_coef": pick("auto_0.01", "auto_0.1"),
        }
    return RunConfig(**common, hyperparameters=hyperparameters, policy_kwargs=features)


def hyperparameter(config: RunConfig, name: str) -> Any:
    """Return a hyperparameter; the default of the library if the configuration has no value.

    Args:
        config: The configuration.
        name: Name of the hyperparameter.
    """
    parameters = inspect.signature(CLASSES[config.algo]).parameters
    return config.hyperparameters.get(name, parameters[name].default)


def rollout(config: RunConfig) -> int:
    """Return the number of steps between two updates of the networks."""
    if config.algo == "ars":
        # Two candidates for each direction, each with an episode of every robot.
        return 2 * hyperparameter(config, "n_delta") * config.n_envs * 500
    if config.algo == "ppo":
        return config.n_envs * hyperparameter(config, "n_steps")
    return config.n_envs


def with_budget(config: RunConfig, seconds: float) -> RunConfig:
    """Return a configuration whose number of steps takes a given time.

    The configuration is trained twice, for a short time, and its cost extrapolated. Before this, it
    is trained once without a measurement, because the first updates of a process take longer.

    Args:
        config: The configuration.
        seconds: Processor time, in s.
    """
    if config.algo in ("sac", "tqc"):
        # Updates begin after these steps, which cost less.
        start = hyperparameter(config, "learning_starts")
        short = start + 25 * config.n_envs
        longer = start + 250 * config.n_envs
    else:
        short = rollout(config)
        longer = (3 if config.algo == "ppo" else 2) * short
    learn(config, short)
    first, _ = learn(config, short)
    second, _ = learn(config, longer)
    steps = longer + (seconds - second) * (longer - short) / (second - first)
    return replace(config, timesteps=max(rollout(config), int(steps)))


def learn(config: RunConfig, steps: int, folder: Path | None = None) -> tuple[float, int]:
    """Train a configuration.

    Args:
        config: The configuration.
        steps: Number of steps.
        folder: Folder of the run. If None, the model is not saved.

    Returns:
        The processor time of the training, in s, and the number of steps that were trained. The
        training ends with a whole rollout.
    """
    config = replace(config, timesteps=steps)
    model = prepare(config)
    start = time.process_time()
    if folder is None:
        model.learn(steps)
        assert model.env is not None
        model.env.close()
    else:
        record_run(folder, config, "experiments/algorithms.py")
        train(model, config, folder, eval_every=0, save_every=0, progress=False)
    return time.process_time() - start, model.num_timesteps


def try_out(algo: str, trial: int, comparison: Comparison, logs: Path) -> dict[str, Any]:
    """Train the configuration of a trial with half of a budget, and return it with its return.

    Args:
        algo: Name of the algorithm.
        trial: Number of the trial.
        comparison: Comparison with the budget.
        logs: Folder of the runs.
    """
    torch.set_num_threads(1)
    file = logs / f"{algo}_{comparison.budget}_trial_{trial}.yml"
    if file.exists():
        return yaml.safe_load(file.read_text(encoding="utf-8"))
    config = drawn(algo, trial, few_steps=comparison.steps is not None)
    if comparison.steps is None:
        config = with_budget(config, comparison.seconds / 2.0)
    else:
        config = replace(config, timesteps=comparison.steps // 2)
    folder = logs / file.stem
    spent, trained = learn(config, config.timesteps, folder)
    found = {
        "algorithm": algo,
        "trial": trial,
        "return": mean_return(folder, config),
        "seconds": spent,
        "trained": trained,
        "config": asdict(config),
    }
    write_text(file, yaml.safe_dump(found))
    print(file.stem, f"{found['return']:.1f}", round(spent), flush=True)
    return found


def best_config(algo: str, comparison: Comparison, trials: list[dict[str, Any]]) -> RunConfig:
    """Return the configuration of the best trial, with the number of steps of a run."""
    own = [trial for trial in trials if trial["algorithm"] == algo]
    best = max(own, key=lambda trial: trial["return"])
    steps = comparison.steps or int(best["trained"] * comparison.seconds / best["seconds"])
    return RunConfig(**{**best["config"], "timesteps": steps})


def untuned_config(algo: str, comparison: Comparison, logs: Path, chosen: Path) -> RunConfig:
    """Return the configuration of a comparison that is not tuned.

    It has the hyperparameters that were tuned on flat ground, or those of the library. Its number
    of steps takes the processor time of the comparison.

    Args:
        algo: Name of the algorithm.
        comparison: The comparison, whose budget is a processor time.
        logs: Folder of the runs.
        chosen: Folder of the configurations.
    """
    torch.set_num_threads(1)
    file = logs / f"{algo}_{comparison.name}.yml"
    if file.exists():
        return load_config(file)
    track = TRACKS[comparison.track]
    if comparison.budget == DEFAULT:
        config = RunConfig(algo=algo, n_envs=1)
    else:
        config = load_config(chosen / f"{algo}_{comparison.budget}_flat.yml")
    config = replace(config, env=track.env_id, env_kwargs=dict(track.env_kwargs))
    config = with_budget(config, comparison.seconds)
    write_text(file, yaml.safe_dump(asdict(config)))
    return config


def mean_return(folder: Path, config: RunConfig) -> float:
    """Return the mean return of the last model over all commands, on episodes of evaluation."""
    with closing(make_env(config.env, config.env_kwargs)) as env:
        model = load_named(str(folder / FINAL), env)
    scores = evaluate({"model": model}, config.env, episodes=5, seed=7)
    return scores["model"]["overall"]["return"][0]


def train_and_score(
    config: RunConfig, comparison: Comparison, logs: Path, results: Path
) -> dict[str, Any]:
    """Train a run, score its last model, and return the run with its scores.

    Args:
        config: Configuration of the run.
        comparison: Comparison to which the run belongs.
        logs: Folder of the runs.
        results: Folder of the result files.

    Raises:
        ValueError: If the run exists, but with other hyperparameters.
    """
    torch.set_num_threads(1)
    track = TRACKS[comparison.track]
    name = f"{config.algo}_{comparison.name}_{config.seed}"
    note = logs / f"{name}.yml"
    file = results / f"{name}.json"
    folder = logs / name
    if note.exists() and file.exists():
        # The number of steps follows from a measured time, which differs from computer to computer.
        kept = replace(load_config(folder / "config.yml"), timesteps=config.timesteps)
        if kept != config:
            raise ValueError(
                f"{folder} must have the present hyperparameters, got others: remove {note}"
            )
        return yaml.safe_load(note.read_text(encoding="utf-8"))
    seconds, trained = learn(config, config.timesteps, folder)
    with closing(track.make_env()) as env:
        policy = load_named(str(folder / FINAL), env)
    columns = rounded(run_track(policy, track))
    digest = policy_sha256(str(folder / FINAL), track.env_id)
    result = TrackResult(name, digest, columns)
    write_result(file, new_result(title(config.algo, comparison), {track.name: result}))
    done: dict[str, Any] = {
        "algorithm": config.algo,
        "seed": config.seed,
        "seconds": seconds,
        "trained": trained,
        **{
            metric: float(metric_value(columns, METRICS[metric], track.episodes.weight))
            for metric in ("return", "success", "load")
        },
    }
    write_text(note, yaml.safe_dump(done))
    print(name, f"{done['return']:.1f} {done['success']:.3f}", round(seconds), flush=True)
    return done


def updates(config: RunConfig) -> float:
    """Return the number of updates of the networks, or of ARS's policy, per 1,000 steps."""
    if config.algo == "ars":
        return 1000.0 / rollout(config)
    if config.algo == "ppo":
        return 1000.0 * hyperparameter(config, "n_epochs") / hyperparameter(config, "batch_size")
    return 1000.0 * hyperparameter(config, "gradient_steps") / config.n_envs


def tables(results: dict[str, Any]) -> dict[str, list[str]]:
    """Return the tables of the page: trials, scores of each comparison, and algorithms in pairs.

    Args:
        results: All trials, configurations, and runs with their scores.
    """
    tuned = [comparison for comparison in COMPARISONS if comparison.tuned]
    trials = [
        [algo.upper(), *(sorted_returns(results["trials"], algo, each) for each in tuned)]
        for algo in ALGORITHMS
    ]
    head = ["algorithm", *(f"returns of the trials, {each.amount}" for each in tuned)]
    scores = []
    rows = []
    for comparison in COMPARISONS:
        runs = [run for run in results["runs"] if run["comparison"] == comparison.name]
        configs = results["configs"].get(comparison.name, {})
        scores.append(table(SCORES, [row(algo, runs, configs[algo]) for algo in configs]))
        primary = TRACKS[comparison.track].primary
        values = {
            algo: np.array([run[primary] for run in runs if run["algorithm"] == algo])
            for algo in configs
        }
        rows += [[f"{comparison.track}, {comparison.amount}", *pair] for pair in pairs(values)]
    return {PAGE: [table(head, trials), *scores, table(PAIRS, rows, texts=3)]}


def sorted_returns(trials: list[dict[str, Any]], algo: str, comparison: Comparison) -> str:
    """Return the returns of an algorithm's trials in increasing order, for a cell of a table."""
    returns = [
        trial["return"]
        for trial in trials
        if (trial["algorithm"], trial["budget"]) == (algo, comparison.budget)
    ]
    return ", ".join(f"{value:.0f}" for value in sorted(returns)) or "-"


def row(algo: str, runs: list[dict[str, Any]], config: dict[str, Any]) -> list[str]:
    """Return the row of an algorithm in the table of a comparison.

    Args:
        algo: Name of the algorithm.
        runs: Runs of the comparison.
        config: Configuration of the algorithm.
    """
    own = [run for run in runs if run["algorithm"] == algo]
    seconds = [run["seconds"] for run in own]
    returns = np.array([run["return"] for run in own])
    return [
        algo.upper(),
        str(len(own)),
        f"{np.mean([run['trained'] for run in own]):,.0f}",
        np.format_float_positional(updates(RunConfig(**config)), 3, fractional=False, trim="-"),
        f"{min(seconds):.0f} to {max(seconds):.0f}",
        *(f"{value:.0f}" for value in (returns.mean(), returns.min(), returns.max())),
        f"{np.mean([run['success'] for run in own]):.2f}",
        f"{np.mean([run['load'] for run in own]):.1f}",
    ]


def pairs(values: dict[str, Any]) -> list[list[str]]:
    """Return rows that compare algorithms in pairs: the test of Mann and Whitney, after Holm.

    Args:
        values: Value of the primary metric of each run, by algorithm.
    """
    tests = []
    for first, second in itertools.combinations(values, 2):
        ours, theirs = values[first], values[second]
        test = mannwhitneyu(ours, theirs, method="auto")
        tests.append((test.pvalue, first, second, test.statistic / len(ours) / len(theirs)))
    rows = []
    largest = 0.0
    for rank, (p, first, second, better) in enumerate(sorted(tests)):
        largest = max(largest, min(1.0, p * (len(tests) - rank)))
        rows.append([first.upper(), second.upper(), f"{better:.2f}", f"{largest:.2g}"])
    return rows


def main() -> None:
    """Tune the algorithms, train them, and write the result files."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    names = [comparison.name for comparison in COMPARISONS]
    add = parser.add_argument
    add("--workers", type=int, default=2, help="number of runs side by side (2)")
    add("--only", choices=names, help="run one comparison, and do not write the page")
    add("--logs", type=Path, default=ROOT / "logs" / "algorithms", help="folder of the runs")
    add("--out", type=Path, help="folder of the page and its data (docs; logs/quick with --quick)")
    add("--quick", action="store_true", help="try the program in a tiny setting")
    args = parser.parse_args()
    comparisons = [each for each in COMPARISONS if args.only in (None, each.name)]
    trials = TRIALS
    results = ROOT / "results"
    chosen = ROOT / "agents" / "studies" / "equal"
    args.out = args.out or (QUICK if args.quick else DOCS)
    if args.quick:
        trials = 1
        comparisons = [replace(COMPARISONS[0], runs=1, algorithms=("ppo",), seconds=1.0)]
        args.logs = results = chosen = args.out / "logs"
    for folder in (args.logs, results, chosen):
        folder.mkdir(parents=True, exist_ok=True)
    os.environ |= {"OMP_NUM_THREADS": "1", "JANSEN_ENV_THREADS": "1"}  # a run has one core
    data: dict[str, Any] = {"trials": [], "configs": {}, "runs": []}
    with ProcessPoolExecutor(args.workers, get_context("spawn")) as pool:
        for comparison in comparisons:
            found = []
            if comparison.tuned:
                jobs = [
                    pool.submit(try_out, algo, trial, comparison, args.logs)
                    for trial in range(trials)
                    for algo in comparison.algorithms
                ]
                found = [job.result() for job in jobs]
                data["trials"] += [{"budget": comparison.budget, **trial} for trial in found]
            configs = {}
            for algo in comparison.algorithms:
                if comparison.tuned:
                    config = best_config(algo, comparison, found)
                else:
                    job = pool.submit(untuned_config, algo, comparison, args.logs, chosen)
                    config = job.result()
                configs[algo] = config
                file = chosen / f"{algo}_{comparison.name}.yml"
                write_text(file, yaml.safe_dump(asdict(config)))
            data["configs"][comparison.name] = {
                algo: asdict(config) for algo, config in configs.items()
            }
            runs = [
                pool.submit(
                    train_and_score, replace(config, seed=seed), comparison, args.logs, results
                )
                for seed in range(1, comparison.runs + 1)
                for config in configs.values()
            ]
            data["runs"] += [{"comparison": comparison.name, **run.result()} for run in runs]
    if args.only is None:
        publish(args.out, DATA, data, tables(data))


if __name__ == "__main__":
    main()
