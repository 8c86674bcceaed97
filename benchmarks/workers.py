"""What workers that train together gain and cost: two against one, and averages between up to 8.

    python -m benchmarks.workers [--rounds 5] [--out logs/workers] [--quick]

``JansenWalker-v0``'s shipped configuration, and a larger one. On one core each, what a step of the
rollout and a minibatch take by their sizes; between idle processes, what it takes to average the
gradients. From both, what more cores would give. Writes ``workers.md``.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from benchmarks import measure

ENV = "JansenWalker-v0"
LARGE = {"n_envs": 1024, "batch_size": 16_384}  # robots and minibatch, in place of the shipped ones
ROBOTS, BATCHES = (4, 16, 64, 256), (64, 512, 4096)  # of which the costs are measured
SIZES = (2, 4, 8)  # workers that average
AVERAGES, PAUSE = 300, 0.003  # how often, and s of idling before each, about a minibatch's time
CORES = (1, 2, 4, 8, 16, 32, 64)
ROUNDS = 5
NEVER = 10**9  # updates between two lines of a log


def configuration(**changes: int) -> dict[str, Any]:
    """The shipped configuration, with another number of robots or another minibatch."""
    from agents.config import new_config

    config = new_config(env_id=ENV, n_envs=changes.get("n_envs"))
    config["hyperparameters"].update({k: v for k, v in changes.items() if k != "n_envs"})
    return config


def worker_rates(config: dict[str, Any], rounds: int, out: Path, worker: Any) -> Path:
    """Steps/s of one worker with two threads and of all with one each, in turns; to rates.json."""
    import torch
    import torch.distributed as dist

    from agents.training import prepare

    torch.set_num_threads(1)
    together: Any = prepare(config, None, worker)
    alone: Any = prepare(config) if worker.leads else None
    steps = 2 * config["n_envs"] * config["hyperparameters"]["n_steps"]

    def play(model: Any, callbacks: list[Any]) -> float:
        dist.barrier()
        start = time.perf_counter()
        if model is not None:
            model.learn(steps, callbacks, log_interval=NEVER, reset_num_timesteps=False)
        dist.barrier()
        return steps / (time.perf_counter() - start)

    updates = worker.updates()
    found = measure.take_turns(
        {"one": lambda: play(alone, []), "two": lambda: play(together, updates)}, rounds
    )
    if worker.leads:
        (out / "rates.json").write_text(json.dumps(found), encoding="utf-8")
    return Path(worker.told("folder", lambda: str(out)))


def averaging_times(numbers: int, pause: float, count: int, out: Path, worker: Any) -> Path:
    """Times (s) of each average of so many numbers, workers idling in between; to times.json.

    Of each the time that passed, and the processor's of this worker, all its threads together.
    """
    import torch

    tensor, times = torch.ones(numbers), []
    for _ in range(count):
        time.sleep(pause)
        start, before = time.perf_counter(), time.process_time()
        worker.average(tensor)
        times.append((time.perf_counter() - start, time.process_time() - before))
    if worker.leads:
        (out / "times.json").write_text(json.dumps(times), encoding="utf-8")
    return Path(worker.told("folder", lambda: str(out)))


def rollout_times(robots: int, rounds: int) -> list[float]:
    """Time (s) of a step of the rollout of so many robots on one core, policy included."""
    from agents.config import training_envs
    from agents.models import build_model
    from agents.vec_env import make_vec_env

    config = configuration(n_envs=robots)
    config["hyperparameters"]["batch_size"] = robots * config["hyperparameters"]["n_steps"]
    venv = make_vec_env(ENV, robots, *training_envs(config), threads=1)
    model: Any = build_model("ppo", {**config, "n_epochs": 1}, venv, seed=0)
    model.train = lambda: None
    steps = config["hyperparameters"]["n_steps"]

    def play() -> float:
        start = time.perf_counter()
        model.learn(robots * steps, log_interval=NEVER, reset_num_timesteps=False)
        return (time.perf_counter() - start) / steps

    play()
    times = [play() for _ in range(rounds)]
    venv.close()
    return times


def minibatch_times(size: int, rounds: int) -> list[float]:
    """Time (s) of an optimiser step on a minibatch of so many samples on one core."""
    from agents.models import build_model
    from agents.vec_env import make_vec_env

    config = configuration(n_envs=1)
    settings = config["hyperparameters"]
    settings.update(n_steps=8 * size, batch_size=size, n_epochs=2)
    model: Any = build_model("ppo", config, make_vec_env(ENV, 1, threads=1), seed=0)
    model._setup_learn(NEVER)
    buffer = model.rollout_buffer
    rng = np.random.default_rng(0)

    def play() -> float:
        buffer.reset()
        for name in ("observations", "actions", "values", "advantages", "returns"):
            array = getattr(buffer, name)
            array[:] = rng.normal(size=array.shape)
        buffer.log_probs[:] = -1.0
        buffer.full = True
        start = time.perf_counter()
        model.train()
        return (time.perf_counter() - start) / 16

    play()
    return [play() for _ in range(rounds)]


def line(sizes: Mapping[int, float] | Mapping[float, float]) -> tuple[float, float]:
    """(fixed, per item) of the straight line through times by size, each as exact in proportion."""
    n, t = np.array(list(sizes), float), np.array(list(sizes.values()))
    fixed, each = np.linalg.lstsq(np.stack([1 / t, n / t], 1), np.ones(len(n)), rcond=None)[0]
    return max(float(fixed), 0.0), max(float(each), 0.0)


def predicted(
    config: dict[str, Any],
    workers: int,
    step: tuple[float, float],
    minibatch: tuple[float, float],
    averaging: tuple[float, float],
) -> tuple[float, float]:
    """(s of a rollout and its update, share of the averages in it) with a core for each worker."""
    settings = config["hyperparameters"]
    robots, steps = config["n_envs"] / workers, settings["n_steps"]
    rollout = steps * (step[0] + step[1] * robots)
    batches = settings["n_epochs"] * config["n_envs"] * steps / settings["batch_size"]
    averages = batches * (averaging[0] + averaging[1] * math.log2(workers)) if workers > 1 else 0.0
    batch = settings["batch_size"] / workers
    whole = rollout + batches * (minibatch[0] + minibatch[1] * batch) + averages
    return whole, averages / whole


def predictions(costs: tuple[Any, Any, Any]) -> Iterator[tuple[str, ...]]:
    """Rows for each number of cores: steps/s by the costs, and their ratio to one core's."""
    shipped, large = configuration(), configuration(**LARGE)
    for cores in CORES:
        row = [str(cores)]
        for config, grows in ((shipped, True), (large, False), (large, True)):
            settings = config["hyperparameters"]
            times = cores if grows else 1
            scaled = {
                **config,
                "n_envs": config["n_envs"] * times,
                "hyperparameters": {**settings, "batch_size": settings["batch_size"] * times},
            }
            whole, share = predicted(scaled, cores, *costs)
            gain = times * predicted(config, 1, *costs)[0] / whole
            rate = scaled["n_envs"] * settings["n_steps"] / whole
            row += [f"{rate:,.0f}", f"{gain:.1f}", f"{share:.0%}"]
        yield tuple(row)


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    found = measure.chosen(measure.options(__doc__, "logs/workers", rounds=ROUNDS), arguments)
    measure.require("stable_baselines3")
    import torch

    from agents.launch import run_here
    from agents.training import prepare

    torch.set_num_threads(1)  # these networks are small, more threads cost more than they bring
    out, rounds, count = found.out, found.rounds, AVERAGES
    sizes, robots, batches = list(SIZES), list(ROBOTS), list(BATCHES)
    configs = {"shipped": configuration(), "large": configuration(**LARGE)}
    if found.quick:
        rounds, count, sizes, robots, batches = 1, 5, [2], [1, 2], [4, 8]
        configs = {"shipped": configuration(n_envs=4, n_steps=8, batch_size=16, n_epochs=1)}
    out.mkdir(parents=True, exist_ok=True)

    def result(name: str, workers: int, work: Callable[..., Path]) -> Any:
        run_here(workers, work)
        return json.loads((out / name).read_text(encoding="utf-8"))

    rows: list[tuple[str, ...]] = []
    for name, config in configs.items():
        rates = result("rates.json", 2, partial(worker_rates, config, rounds, out))
        size = config["hyperparameters"]["batch_size"]
        rows.append((name, str(config["n_envs"]), str(size), *measure.spread(rates["one"]),
                     *measure.spread(rates["two"]),
                     str(measure.ratio(rates["two"], rates["one"]))))  # fmt: skip
    model = prepare(configs["shipped"])
    numbers = sum(p.numel() for p in model.policy.parameters())
    step = {n: median(rollout_times(n, rounds)) for n in robots}
    minibatch = {n: median(minibatch_times(n, rounds)) for n in batches}
    averaging: dict[int, list[tuple[float, float]]] = {
        n: result("times.json", n, partial(averaging_times, numbers, PAUSE, count, out))
        for n in sizes
    }
    costs = (
        line(step),
        line(minibatch),
        line({math.log2(n): median(cpu for _, cpu in times) for n, times in averaging.items()}),
    )
    write(out, rounds, rows, numbers, (step, minibatch, averaging), costs)
    for name in ("rates.json", "times.json"):
        (out / name).unlink()


def write(
    out: Path,
    rounds: int,
    rows: list[tuple[str, ...]],
    numbers: int,
    measured: tuple[dict[int, float], dict[int, float], dict[int, list[tuple[float, float]]]],
    costs: tuple[tuple[float, float], ...],
) -> None:
    """Write the report."""
    step, minibatch, averaging = measured
    first = ("steps/s of one", "lowest", "highest", "of two", "lowest", "highest", "ratio")
    cells = [
        *(("step of the rollout", f"{n} robots", f"{1e6 * t:,.0f}", "") for n, t in step.items()),
        *(("minibatch", f"{n} samples", f"{1e6 * t:,.0f}", "") for n, t in minibatch.items()),
        *(
            ("average of the gradients", f"{n} workers", *(
                f"{1e6 * median(t):,.0f}" for t in zip(*times, strict=True)
            ))
            for n, times in averaging.items()
        ),
    ]  # fmt: skip
    units = ("robot", "sample", "doubling of the workers")
    parts = ("a step", "a minibatch", "an average")
    fits = "; ".join(
        f"{part} {1e6 * fixed:,.0f} and {1e6 * each:,.3g} per {unit}"
        for part, unit, (fixed, each) in zip(parts, units, costs, strict=True)
    )
    cases = ("shipped in each", "large in all", "large in each")
    head = [f"{case}: {what}" for case in cases for what in ("steps/s", "gain", "averaging")]
    measure.report(
        out / "workers.md",
        "# Workers that train together",
        measure.conditions(rounds),
        f"PPO on {ENV}, rollouts and updates: one worker, its robots on two threads, and two with "
        "half of the robots each, on the same two cores.",
        measure.table(("configuration", "robots", "minibatch", *first), rows),
        "Times (us), medians, on one core; of the average of the policy's "
        f"{numbers:,} numbers, between processes of this machine that idle for "
        f"{1e3 * PAUSE:.0f} ms before each, and the processor's time in it for each worker, which "
        "does not grow with the processes that wait for a core.",
        measure.table(("what", "size", "time", "processor's"), cells),
        f"Straight lines through them (us), for the average through the processor's: {fits}.",
        "What these lines add up to with a core for each worker, each with the shipped "
        f"configuration; with {LARGE['n_envs']} robots and minibatches of {LARGE['batch_size']} "
        "shared out to all; and with so many in each worker. Gain is that over one core, "
        "averaging its share of the time.",
        measure.table(("cores", *head), predictions((costs[0], costs[1], costs[2]))),
    )


if __name__ == "__main__":
    main()
