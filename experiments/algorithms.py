"""Which algorithm learns to walk best with the same budget and the same number of trials?

Run the experiment as follows. It takes about four hours of one core.

    python experiments/algorithms.py [--workers 2] [--seeds 10] [--logs logs/algorithms] [--quick]

A run has a budget of 90 s of processor time, or of 200,000 steps. For each budget, every algorithm
is tuned with five trials on JansenWalkerBuilt-v0. A trial draws its hyperparameters from the ranges
in :func:`drawn`, trains on one of the seeds 100 to 102 until half of the budget of 90 s or the
whole budget of 200,000 steps is spent, and scores its last model by the mean return over the
commands of the environment, in episodes that are not test episodes. All algorithms have the same
observations, reward and wrappers, and networks have the same features of the observations. ARS has
its linear policy, which knows no features.

The hyperparameters of the best trial then train on the seeds 1 to 10, and the benchmark scores the
last model of each run. The runs on rough terrain use the same hyperparameters. The script writes a
result file ``results/ALGORITHM_BUDGET_SEED.json`` for each run, the hyperparameters
``agents/studies/equal/ALGORITHM_BUDGET.yml``, and docs/algorithms/algorithms.json with all trials.
Jobs whose files exist are left out, so that the experiment can be interrupted.
"""

import argparse
import itertools
import os
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing
from dataclasses import asdict, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

os.environ |= {"OMP_NUM_THREADS": "1", "JANSEN_ENV_THREADS": "1"}  # a run has one core

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
STEPS = 200_000  # the other budget of a run
TRIALS = 5  # per algorithm and budget
BUDGETS = {"90s": "90 s", "200k": "200000 steps"}
FEATURES = {"normalize": True, "harmonics": 4, "half_turn": True}
"""Features of the observations, which all networks get."""
PAIRS = ["track", "first", "second", "probability that the first is better", "p after Holm"]
ON_TERRAIN = ("ppo", "sac")  # algorithms that are also trained on rough terrain
TERRAIN_SEEDS = 5


class Job(NamedTuple):
    """A run of an algorithm on a track.

    Attributes:
        algo: Name of the algorithm.
        budget: Budget of the run, a key of :data:`BUDGETS`.
        track: Name of the track.
        seed: Seed of the run.
    """

    algo: str
    budget: str
    track: str
    seed: int

    @property
    def name(self) -> str:
        """Name of the job in files and folders."""
        return f"{self.algo}_{self.budget}_{self.track}_{self.seed}"

    @property
    def title(self) -> str:
        """Name of the algorithm and its budget in tables of the benchmark."""
        return f"{self.algo.upper()}, {BUDGETS[self.budget]}"


def drawn(algo: str, budget: str, trial: int) -> RunConfig:
    """Return the configuration of a trial; its number of steps is not yet that of its budget.

    Args:
        algo: Name of the algorithm.
        budget: Budget of the run.
        trial: Number of the trial, which seeds the draws.
    """
    random = np.random.default_rng([ALGORITHMS.index(algo), list(BUDGETS).index(budget), trial])

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
        updates = (2, 4, 8) if budget == "90s" else (8, 16)
        hyperparameters = {
            "learning_rate": f"linear_{between(3e-4, 3e-3)}",
            "learning_starts": 3200,
            "buffer_size": 300_000,
            "batch_size": 256,
            "gradient_steps": pick(*updates),
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
    """Return a configuration with as many steps as it takes in a given time.

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
    first = learning_time(config, short)
    second = learning_time(config, longer)
    steps = longer + (seconds - second) * (longer - short) / (second - first)
    return replace(config, timesteps=max(rollout(config), int(steps)))


def learning_time(config: RunConfig, steps: int, folder: Path | None = None) -> float:
    """Train a configuration; return the processor time of the training, in s.

    Args:
        config: The configuration.
        steps: Number of steps.
        folder: Folder of the run. If None, the model is not saved.
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
    return time.process_time() - start


def try_out(algo: str, budget: str, trial: int, logs: Path, share: float) -> dict[str, Any]:
    """Train the configuration of a trial, and return it with its return.

    Args:
        algo: Name of the algorithm.
        budget: Budget of the run.
        trial: Number of the trial.
        logs: Folder of the runs.
        share: Share of the budget that is used.
    """
    torch.set_num_threads(1)
    file = logs / f"{algo}_{budget}_trial_{trial}.yml"
    if file.exists():
        return yaml.safe_load(file.read_text(encoding="utf-8"))
    config = drawn(algo, budget, trial)
    if budget == "90s":
        full = with_budget(config, SECONDS * share)
        config = replace(full, timesteps=max(rollout(full), full.timesteps // 2))
        whole = full.timesteps
    else:
        whole = int(STEPS * share)
        config = replace(config, timesteps=whole)
    folder = logs / file.stem
    seconds = learning_time(config, config.timesteps, folder)
    found = {
        "algorithm": algo,
        "budget": budget,
        "trial": trial,
        "return": mean_return(folder, config),
        "seconds": round(seconds, 1),
        "config": asdict(replace(config, timesteps=whole)),
    }
    write_text(file, yaml.safe_dump(found))
    print(algo, budget, trial, f"{found['return']:.1f}", round(seconds), flush=True)
    return found


def mean_return(folder: Path, config: RunConfig) -> float:
    """Return the mean return of the last model over all commands, on episodes of evaluation."""
    with closing(make_env(config.env, config.env_kwargs)) as env:
        model = load_named(str(folder / FINAL), env)
    scores = evaluate({"model": model}, config.env, episodes=5, seed=7)
    return scores["model"]["overall"]["return"][0]


def train_and_score(job: Job, config: RunConfig, logs: Path, results: Path) -> dict[str, Any]:
    """Train a run and score its last model.

    Args:
        job: The job.
        config: Configuration of the algorithm.
        logs: Folder of the runs.
        results: Folder of the result files.
    """
    torch.set_num_threads(1)
    track = TRACKS[job.track]
    config = replace(config, env=track.env_id, seed=job.seed)
    note = logs / f"{job.name}.yml"
    file = results / f"{job.name}.json"
    if note.exists() and file.exists():
        return yaml.safe_load(note.read_text(encoding="utf-8"))
    folder = logs / job.name
    seconds = learning_time(config, config.timesteps, folder)
    with closing(track.make_env()) as env:
        policy = load_named(str(folder / FINAL), env)
    columns = rounded(run_track(policy, track))
    digest = policy_sha256(str(folder / FINAL), track.env_id)
    result = TrackResult(job.name, digest, columns)
    write_result(file, new_result(job.title, {job.track: result}))
    weights = track.episodes.weight
    metrics = {"score": track.primary, "success": "success", "load": "load"}
    done = {
        **job._asdict(),
        "steps": config.timesteps,
        "seconds": round(seconds, 1),
        **{
            name: round(float(metric_value(columns, METRICS[metric], weights)), 4)
            for name, metric in metrics.items()
        },
    }
    write_text(note, yaml.safe_dump(done))
    print(job.name, done["score"], round(seconds), flush=True)
    return done


def jobs(seeds: int) -> Iterator[Job]:
    """Return all runs in the order in which they are done.

    Args:
        seeds: Number of seeds on the flat track.
    """
    for seed in range(1, seeds + 1):
        for algo in ALGORITHMS:
            yield Job(algo, "90s", "flat", seed)
            if algo in ("ppo", "ars"):
                yield Job(algo, "200k", "flat", seed)
    for seed in range(1, min(seeds, TERRAIN_SEEDS) + 1):
        for algo in ON_TERRAIN:
            for track in ("terrain", "robust"):
                yield Job(algo, "90s", track, seed)
    for seed in range(1, seeds + 1):
        for algo in ("sac", "tqc"):
            yield Job(algo, "200k", "flat", seed)


def tables(results: dict[str, Any]) -> dict[str, list[str]]:
    """Return the tables of the page: the scores of the algorithms, and the algorithms in pairs.

    Args:
        results: All trials, and all runs with their scores.
    """
    head = [
        "track",
        "algorithm",
        "runs",
        "steps",
        "processor time (s)",
        "best trial",
        "score",
        "lowest",
        "highest",
        "success",
        "load (weights)",
    ]
    groups: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for run in results["runs"]:
        title = f"{run['algo'].upper()}, {BUDGETS[run['budget']]}"
        groups.setdefault((run["track"], title), []).append(run)
    rows = []
    scores = {}
    for (track, title), runs in groups.items():
        first = runs[0]
        trials = [
            trial["return"]
            for trial in results["trials"]
            if (trial["algorithm"], trial["budget"]) == (first["algo"], first["budget"])
        ]
        score = scores[track, title] = np.array([run["score"] for run in runs])
        decimals = 0 if TRACKS[track].primary == "return" else 2
        rows.append(
            [
                track,
                title,
                str(len(runs)),
                f"{first['steps']:,}",
                f"{np.mean([run['seconds'] for run in runs]):.0f}",
                f"{max(trials):.0f}",
                *(f"{value:.{decimals}f}" for value in (score.mean(), score.min(), score.max())),
                f"{np.mean([run['success'] for run in runs]):.2f}",
                f"{np.mean([run['load'] for run in runs]):.1f}",
            ]
        )
    return {PAGE: [table(head, rows, texts=2), table(PAIRS, pairs(scores), texts=3)]}


def pairs(scores: dict[tuple[str, str], Any]) -> list[list[str]]:
    """Return rows that compare the algorithms in pairs, with Holm's correction within a track.

    Args:
        scores: Score of each run, by track and algorithm.
    """
    rows = []
    for track in TRACKS:
        known = [title for name, title in scores if name == track]
        tests = []
        for first, second in itertools.combinations(known, 2):
            ours, theirs = scores[track, first], scores[track, second]
            test = mannwhitneyu(ours, theirs, method="exact")
            tests.append((test.pvalue, first, second, test.statistic / len(ours) / len(theirs)))
        largest = 0.0
        for rank, (p, first, second, better) in enumerate(sorted(tests)):
            largest = max(largest, min(1.0, p * (len(tests) - rank)))
            rows.append([track, first, second, f"{better:.2f}", f"{largest:.3f}"])
    return rows


def main() -> None:
    """Tune the algorithms, train them, and write the result files."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--workers", type=int, default=2, help="number of runs side by side (2)")
    add("--seeds", type=int, default=10, help="number of training seeds on the flat track (10)")
    add("--only", nargs="+", choices=BUDGETS, default=[*BUDGETS], help="budgets (all)")
    add("--logs", type=Path, default=ROOT / "logs" / "algorithms", help="folder of the runs")
    add("--out", type=Path, default=DOCS, help="folder of the page and its data (docs)")
    add("--quick", action="store_true", help="try the program in a tiny setting")
    args = parser.parse_args()
    algorithms, budgets, trials, share = [*ALGORITHMS], args.only, TRIALS, 1.0
    results = ROOT / "results"
    chosen = ROOT / "agents" / "studies" / "equal"
    planned = list(jobs(args.seeds))
    if args.quick:
        algorithms, budgets, trials, share = [*ALGORITHMS[:2]], ["90s"], 1, 0.01
        args.logs = results = chosen = args.out / "logs"
        planned = planned[:1]
    for folder in (args.logs, results, chosen):
        folder.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(args.workers, get_context("spawn")) as pool:
        tried = [
            pool.submit(try_out, algo, budget, trial, args.logs, share)
            for budget in budgets
            for trial in range(trials)
            for algo in algorithms
        ]
        found = [trial.result() for trial in tried]
        configs = {}
        for algo, budget in itertools.product(algorithms, budgets):
            own = [
                trial for trial in found if (trial["algorithm"], trial["budget"]) == (algo, budget)
            ]
            best = max(own, key=lambda trial: trial["return"])
            config = RunConfig(**best["config"])
            if budget == "90s":  # the trial had half of the budget, and measured what it costs
                steps = int(config.timesteps * SECONDS * share / 2 / best["seconds"])
                config = replace(config, timesteps=max(rollout(config), steps))
            configs[algo, budget] = config
            write_text(chosen / f"{algo}_{budget}.yml", yaml.safe_dump(asdict(config)))
        runs = [
            pool.submit(train_and_score, job, configs[job.algo, job.budget], args.logs, results)
            for job in planned
            if job.budget in budgets
        ]
        done = [run.result() for run in runs]
    data = {"trials": found, "runs": done}
    publish(args.out, DATA, data, tables(data))


if __name__ == "__main__":
    main()
