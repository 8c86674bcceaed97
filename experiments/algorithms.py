"""Which algorithm learns to walk best with the same budget and the same number of trials?

Run the experiment as follows. It takes about 45 minutes of one core.

    python experiments/algorithms.py [--workers 2] [--seeds N] [--logs logs/algorithms] [--quick]

A run has a budget of 90 s of processor time. Every algorithm is tuned with five trials on
JansenWalkerBuilt-v0. A trial draws its hyperparameters from the ranges in :func:`drawn`, trains for
about half of the budget on one of the seeds 100 to 102, and scores its last model by the mean
return over the commands of the environment, in episodes that are not test episodes. All algorithms
have the same observations, reward and wrappers, and networks have the same features of the
observations. ARS has its linear policy, which knows no features.

The hyperparameters of the best trial then train on the seeds 1 to N. The number of steps is the
budget divided by the time per step that the trial measured. The benchmark scores the last model of
each run on the track ``flat``. The script writes a result file
``results/ALGORITHM_90s_flat_SEED.json`` for each run, the hyperparameters
``agents/studies/equal/ALGORITHM_90s.yml``, and docs/algorithms/algorithms.json with all trials and
runs. Jobs whose files exist are left out, so that the experiment can be interrupted.
"""

import argparse
import itertools
import os
import time
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing
from dataclasses import asdict, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import torch
import yaml
from pages import DOCS, publish, table
from scipy.stats import mannwhitneyu

from agents.training.runs import FINAL, record_run
from agents.training.train_model import prepare, train
from jansen_env.cli.named_policies import load_named, policy_sha256
from jansen_env.files import write_text
from jansen_env.sb3.run_config import RunConfig
from jansen_env.scoring.evaluation import evaluate
from jansen_env.scoring.protocol import METRICS, TRACKS, metric_value, run_track
from jansen_env.scoring.result_files import (
    TrackResult,
    new_result,
    rounded,
    write_result,
)
from jansen_env.scoring.rollout import make_env

ROOT = Path(__file__).parents[1]
DATA, PAGE = "algorithms/algorithms.json", "studies.md"
ALGORITHMS = ("ppo", "sac", "tqc", "ars")
SECONDS = 90.0  # budget of a run, in s of processor time
TRACK = "flat"  # track on which the runs are scored
TRIALS = 5  # per algorithm
SEEDS = 3  # number of training seeds
FEATURES = {"normalize": True, "harmonics": 4, "half_turn": True}
"""Features of the observations, which all networks get."""
PAIRS = ["first", "second", "probability that the first is better", "p after Holm"]


def title(algo: str) -> str:
    """Return the name of an algorithm in tables of the benchmark."""
    return f"{algo.upper()}, {SECONDS:.0f} s"


def drawn(algo: str, trial: int) -> RunConfig:
    """Return the configuration of a trial; its number of steps is not yet that of its budget.

    Args:
        algo: Name of the algorithm.
        trial: Number of the trial, which seeds the draws.
    """
    random = np.random.default_rng([ALGORITHMS.index(algo), 0, trial])

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
        common["n_envs"] = 16
        features = {"net_arch": [], "with_bias": False, "squash_output": False}
        hyperparameters = {
            "n_eval_episodes": 16,
            "learning_rate": f"linear_{between(5e-3, 0.1)}",
            "delta_std": between(0.02, 0.3),
            "n_delta": pick(8, 16, 32),
        }
    elif algo == "ppo":
        common["n_envs"] = pick(16, 32, 64, 256)
        hyperparameters = {
            "learning_rate": f"linear_{between(3e-4, 3e-3)}",
            "n_steps": pick(4096, 16384) // common["n_envs"],
            "batch_size": pick(512, 1024, 4096),
            "n_epochs": int(random.integers(3, 13)),
            "gamma": pick(0.98, 0.99, 0.995),
            "gae_lambda": pick(0.95, 0.98),
            "ent_coef": pick(0.0, 0.0005),
        }
        features["log_std_init"] = pick(0.0, -0.5, -1.0)
    else:
        common["n_envs"] = 64
        hyperparameters = {
            "learning_rate": f"linear_{between(3e-4, 3e-3)}",
            "learning_starts": 3200,
            "buffer_size": 300_000,
            "batch_size": 256,
            "gradient_steps": pick(2, 4, 8),
            "gamma": pick(0.98, 0.99, 0.995),
            "tau": pick(0.005, 0.01, 0.02),
            "ent_coef": pick("auto_0.01", "auto_0.1"),
        }
    return RunConfig(**common, hyperparameters=hyperparameters, policy_kwargs=features)


def rollout(config: RunConfig) -> int:
    """Return the number of steps between two updates of the networks."""
    hyperparameters = config.hyperparameters
    if config.algo == "ars":
        # Two candidates for each direction, each with an episode of every robot.
        return 2 * hyperparameters["n_delta"] * config.n_envs * 500
    return config.n_envs * hyperparameters.get("n_steps", 1)


def with_budget(config: RunConfig, seconds: float) -> RunConfig:
    """Return a configuration whose number of steps takes a given time.

    The configuration is trained twice, for a short time, and its cost extrapolated.

    Args:
        config: The configuration.
        seconds: Processor time, in s.
    """
    if config.algo in ("sac", "tqc"):
        short = 3200 + 64 * 25
        longer = 3200 + 64 * 250
    else:
        short = rollout(config)
        longer = (3 if config.algo == "ppo" else 2) * short
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


def try_out(algo: str, trial: int, logs: Path, seconds: float) -> dict[str, Any]:
    """Train the configuration of a trial, and return it with its return.

    Args:
        algo: Name of the algorithm.
        trial: Number of the trial.
        logs: Folder of the runs.
        seconds: Processor time of the trial, in s.
    """
    torch.set_num_threads(1)
    file = logs / f"{algo}_90s_trial_{trial}.yml"
    if file.exists():
        return yaml.safe_load(file.read_text(encoding="utf-8"))
    config = with_budget(drawn(algo, trial), seconds)
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
    print(algo, trial, f"{found['return']:.1f}", round(spent), flush=True)
    return found


def mean_return(folder: Path, config: RunConfig) -> float:
    """Return the mean return of the last model over all commands, on episodes of evaluation."""
    with closing(make_env(config.env, config.env_kwargs)) as env:
        model = load_named(str(folder / FINAL), env)
    scores = evaluate({"model": model}, config.env, episodes=5, seed=7)
    return scores["model"]["overall"]["return"][0]


def train_and_score(config: RunConfig, logs: Path, results: Path) -> dict[str, Any]:
    """Train a run, score its last model, and return the run with its scores.

    Args:
        config: Configuration of the run.
        logs: Folder of the runs.
        results: Folder of the result files.
    """
    torch.set_num_threads(1)
    track = TRACKS[TRACK]
    name = f"{config.algo}_90s_{TRACK}_{config.seed}"
    note = logs / f"{name}.yml"
    file = results / f"{name}.json"
    if note.exists() and file.exists():
        return yaml.safe_load(note.read_text(encoding="utf-8"))
    folder = logs / name
    seconds, trained = learn(config, config.timesteps, folder)
    with closing(track.make_env()) as env:
        policy = load_named(str(folder / FINAL), env)
    columns = rounded(run_track(policy, track))
    digest = policy_sha256(str(folder / FINAL), track.env_id)
    write_result(file, new_result(title(config.algo), {TRACK: TrackResult(name, digest, columns)}))
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
    print(name, round(done["return"], 1), round(seconds), flush=True)
    return done


def tables(results: dict[str, Any]) -> dict[str, list[str]]:
    """Return the tables of the page: the scores of the algorithms, and the algorithms in pairs.

    Args:
        results: All trials, and all runs with their scores.
    """
    head = [
        "algorithm",
        "runs",
        "steps",
        "processor time (s)",
        "returns of the trials",
        "return",
        "lowest",
        "highest",
        "success",
        "load (weights)",
    ]
    rows = []
    returns = {}
    for algo in ALGORITHMS:
        runs = [run for run in results["runs"] if run["algorithm"] == algo]
        if not runs:
            continue
        trials = [each["return"] for each in results["trials"] if each["algorithm"] == algo]
        scores = returns[algo.upper()] = np.array([run["return"] for run in runs])
        seconds = [run["seconds"] for run in runs]
        rows.append(
            [
                algo.upper(),
                str(len(runs)),
                f"{np.mean([run['trained'] for run in runs]):,.0f}",
                f"{min(seconds):.0f} to {max(seconds):.0f}",
                ", ".join(f"{value:.0f}" for value in sorted(trials)),
                *(f"{value:.0f}" for value in (scores.mean(), scores.min(), scores.max())),
                f"{np.mean([run['success'] for run in runs]):.2f}",
                f"{np.mean([run['load'] for run in runs]):.1f}",
            ]
        )
    return {PAGE: [table(head, rows), table(PAIRS, pairs(returns), texts=2)]}


def pairs(returns: dict[str, Any]) -> list[list[str]]:
    """Return rows that compare the algorithms in pairs, with Holm's correction.

    Args:
        returns: Return of each run, by algorithm.
    """
    tests = []
    for first, second in itertools.combinations(returns, 2):
        ours, theirs = returns[first], returns[second]
        test = mannwhitneyu(ours, theirs, method="exact")
        tests.append((test.pvalue, first, second, test.statistic / len(ours) / len(theirs)))
    rows = []
    largest = 0.0
    for rank, (p, first, second, better) in enumerate(sorted(tests)):
        largest = max(largest, min(1.0, p * (len(tests) - rank)))
        rows.append([first, second, f"{better:.2f}", f"{largest:.2f}"])
    return rows


def main() -> None:
    """Tune the algorithms, train them, and write the result files."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--workers", type=int, default=2, help="number of runs side by side (2)")
    add("--seeds", type=int, default=SEEDS, help=f"number of training seeds ({SEEDS})")
    add("--logs", type=Path, default=ROOT / "logs" / "algorithms", help="folder of the runs")
    add("--out", type=Path, default=DOCS, help="folder of the page and its data (docs)")
    add("--quick", action="store_true", help="try the program in a tiny setting")
    args = parser.parse_args()
    algorithms, trials, budget, seeds = list(ALGORITHMS), TRIALS, SECONDS, args.seeds
    results = ROOT / "results"
    chosen = ROOT / "agents" / "studies" / "equal"
    if args.quick:
        algorithms, trials, budget, seeds = ["ppo"], 1, 1.0, 1
        args.logs = results = chosen = args.out / "logs"
    for folder in (args.logs, results, chosen):
        folder.mkdir(parents=True, exist_ok=True)
    os.environ |= {"OMP_NUM_THREADS": "1", "JANSEN_ENV_THREADS": "1"}  # a run has one core
    with ProcessPoolExecutor(args.workers, get_context("spawn")) as pool:
        tried = [
            pool.submit(try_out, algo, trial, args.logs, budget / 2)
            for trial in range(trials)
            for algo in algorithms
        ]
        found = [trial.result() for trial in tried]
        configs = []
        for algo in algorithms:
            own = [trial for trial in found if trial["algorithm"] == algo]
            best = max(own, key=lambda trial: trial["return"])
            steps = int(best["trained"] * budget / best["seconds"])
            config = RunConfig(**{**best["config"], "timesteps": steps})
            write_text(chosen / f"{algo}_90s.yml", yaml.safe_dump(asdict(config)))
            configs.append(config)
        runs = [
            pool.submit(train_and_score, replace(config, seed=seed), args.logs, results)
            for seed in range(1, seeds + 1)
            for config in configs
        ]
        done = [run.result() for run in runs]
    data = {"trials": found, "runs": done}
    publish(args.out, DATA, data, tables(data))


if __name__ == "__main__":
    main()
