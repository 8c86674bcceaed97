"""Data-parallel training: several workers learn what one with all their robots does."""

from __future__ import annotations

import errno
import os
import re
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch
from stable_baselines3.common.logger import Logger

import train
from agents import data_parallel, launch, ray_workers, training
from agents.callbacks import NormalizerUpdate, Saver
from agents.model_files import read_model
from agents.process import HANGUP
from agents.runs import read_evaluations

N_ENVS, N_STEPS, BATCH, EPOCHS, ROLLOUTS = 6, 20, 36, 3, 4  # of each epoch the last batch is short
CONFIG = {
    "algo": "ppo", "env": "JansenWalker-v0", "policy": "MlpPolicy", "seed": 5,
    "timesteps": 2 * N_ENVS * N_STEPS, "n_envs": N_ENVS,
    "training_variants": [{"reset_noise_scale": s} for s in (1.0, 2.0, 3.0, 4.0)],
    "hyperparameters": {
        "n_steps": N_STEPS, "batch_size": BATCH, "n_epochs": EPOCHS, "clip_range_vf": 0.2,
        "ent_coef": 0.01, "max_grad_norm": 0.1, "use_sde": True, "sde_sample_freq": 8,
        "learning_rate": 1.0e-3,
    },
    "policy_kwargs": {"net_arch": [64, 64], "normalize": True},
}  # fmt: skip
SMALL_PPO = Path(__file__).parent / "small_ppo.yml"
SHORT = ["--config", str(SMALL_PPO), "-n", "512", "--n-envs", "4", "--eval-episodes", "1",
         "--no-progress", "--save-freq", "256", "--eval-freq", "0", "--workers", "2"]  # fmt: skip


def rollouts():
    """What each rollout holds of (steps, robots): robots see different things, and fare so."""
    rng = np.random.default_rng(0)
    shape, robot = (N_STEPS, N_ENVS), np.arange(N_ENVS)
    return [
        {
            "observations": rng.normal(robot[:, None], 1.0 + robot[:, None], (*shape, 20)),
            "actions": rng.normal(0.0, 1.0, (*shape, 1)),
            "values": rng.normal(0.0, 1.0, shape),
            "log_probs": rng.normal(-1.5, 0.5, shape),
            "advantages": rng.normal(3.0 * robot, 1.0 + robot, shape),
            "returns": rng.normal(robot, 3.0, shape),
        }
        for _ in range(ROLLOUTS)
    ]


def orders(size):
    """For each epoch, the order in which each of ``size`` workers takes its samples."""
    rng = np.random.default_rng(1)
    each = N_STEPS * N_ENVS // size
    return [[rng.permutation(each) for _ in range(size)] for _ in range(ROLLOUTS * EPOCHS)]


def union(parts):
    """The order of one worker whose minibatches are the unions of the others'."""
    each, share = len(parts[0]), BATCH // len(parts)
    batches = [
        part[begin : begin + share] + rank * each  # a buffer holds one robot after the other
        for begin in range(0, each, share)
        for rank, part in enumerate(parts)
    ]
    return np.concatenate(batches)


def learn(model, callbacks, robots, order, monkeypatch):
    """Let a model learn from fixed rollouts; all its numbers and the sizes of its gradients."""
    model.set_logger(Logger(None, []))
    order = iter(order)
    monkeypatch.setattr(np.random, "permutation", lambda n: next(order))
    for callback in callbacks:
        callback.init_callback(model)
        callback.on_training_start({}, {})
    for rollout in rollouts():
        for callback in callbacks:
            callback.on_rollout_start()
        model.rollout_buffer.reset()
        for name, values in rollout.items():
            array = getattr(model.rollout_buffer, name)
            array[:] = values[:, robots]
        model.rollout_buffer.full = True
        for callback in callbacks:
            callback.on_rollout_end()
        model.train()
    numbers = {name: value.numpy().copy() for name, value in model.policy.state_dict().items()}
    optimiser = model.policy.optimizer.state_dict()["state"]
    for index, state in optimiser.items():
        numbers[f"mean gradient {index}"] = state["exp_avg"].numpy().copy()
    return numbers


def work(out, worker):
    """What each worker of the tests does: learn from fixed rollouts, and train a little."""
    monkeypatch = pytest.MonkeyPatch()
    share = N_ENVS // worker.size
    robots = slice(worker.rank * share, (worker.rank + 1) * share)
    model = training.prepare(CONFIG, None, worker)
    order = [parts[worker.rank] for parts in orders(worker.size)]
    fixed = learn(model, worker.updates(), robots, order, monkeypatch)
    monkeypatch.undo()
    np.savez(out / f"fixed_{worker.rank}.npz", **fixed)

    model = training.prepare(CONFIG, None, worker)
    seeds, generator = model.get_env().unwrapped._seeds, torch.initial_seed()
    scales = model.get_env().get_attr("reset_noise_scale")
    monkeypatch.setattr(Saver, "evaluate", lambda self: None)  # it takes its time
    training.train(model, CONFIG, out, eval_every=120, save_every=0, progress=False, worker=worker)
    trained = {name: value.numpy() for name, value in model.policy.state_dict().items()}
    np.savez(out / f"trained_{worker.rank}.npz", **trained)
    np.savez(
        out / f"start_{worker.rank}.npz",
        seeds=seeds,
        scales=scales,
        generator=generator,
        steps=model.num_timesteps,
        settings=[model.max_grad_norm, model.normalize_advantage],
    )
    return Path(worker.told("folder", lambda: str(out)))


@pytest.fixture(scope="module")
def workers(tmp_path_factory):
    """What two workers have left: {name: the arrays of each}."""
    out = tmp_path_factory.mktemp("workers")
    assert launch.run_here(2, partial(work, out)) == out
    names = ("fixed", "trained", "start")
    found = {name: [dict(np.load(out / f"{name}_{k}.npz")) for k in range(2)] for name in names}
    return found | {"out": out}


def test_two_workers_learn_what_one_does(workers, monkeypatch):
    """Four updates of twelve steps on the same data, gradients clipped, advantages normalised.

    Not bit for bit: sums over a minibatch are taken in two parts, and Adam divides by the size of
    gradients, so that rounding in a small one is as large in the step as in a large one.
    """
    model = training.prepare(CONFIG)
    norms = []
    monkeypatch.setattr(torch.nn.utils, "clip_grad_norm_", noting(norms))
    order = [union(parts) for parts in orders(2)]
    one = learn(model, [NormalizerUpdate()], slice(None), order, monkeypatch)
    assert len(norms) == ROLLOUTS * EPOCHS * 4 and 0.1 < np.mean(np.array(norms) < 0.1) < 0.5
    for name, value in workers["fixed"][0].items():
        limit = 3e-6 if "gradient" in name else 1e-6
        assert np.abs(value - one[name]).max() <= limit * np.abs(one[name]).max(), name


def test_workers_stay_equal_bit_for_bit(workers):
    """Policies, observation statistics and optimisers after learning; and they have learnt."""
    for name in ("fixed", "trained"):
        first, second = workers[name]
        assert all(np.array_equal(first[key], second[key]) for key in first)
    assert workers["trained"][0]["features_extractor.count"] == 1 * N_ENVS * N_STEPS


def test_workers_are_parts_of_one_run(workers):
    """Robots with the seeds and variants of the one-worker run, other noise; steps of all."""
    model = training.prepare(CONFIG)
    venv = model.get_env()
    for name, expected in (
        ("seeds", venv.unwrapped._seeds),
        ("scales", venv.get_attr("reset_noise_scale")),
    ):
        found = np.concatenate([start[name] for start in workers["start"]])
        assert found.tolist() == list(expected), name
    assert workers["start"][0]["generator"] != workers["start"][1]["generator"]
    for start in workers["start"]:
        assert start["steps"] == CONFIG["timesteps"]
        assert start["settings"].tolist() == [0.1, True]  # as the configuration has them
    monitors = sorted(path.name for path in (workers["out"] / "monitor").iterdir())
    assert monitors == ["0.monitor.csv", "1.monitor.csv"]


def test_command_line_trains_with_two_workers(tmp_path, capfd):
    """A run like any other: models, evaluations, scores; only one worker speaks."""
    folder = train.main([*SHORT, "--log-folder", str(tmp_path)])
    expected = ("config.yml", "command.txt", "best_model.zip", "final_model.zip", "scores.json")
    assert all((folder / name).is_file() for name in expected)
    assert read_model(folder / "final_model.zip")[1] == 512
    assert [row["steps"] for row in read_evaluations(folder)] == [512]
    rows = [(folder / "monitor" / f"{k}.monitor.csv").read_text() for k in range(2)]
    assert all(row.startswith("#") for row in rows)
    out = capfd.readouterr().out
    assert out.count("PPO on JansenWalker-v0") == out.count("trained in") == 1


def doomed(out, worker):
    """The second worker is killed while the first waits for it."""
    worker.told("folder", lambda: str(out))
    for step in range(1000):
        if worker.rank == 1 and step == 20:
            os.kill(os.getpid(), signal.SIGKILL)
        worker.average(torch.ones(3))


def test_a_killed_worker_ends_all_with_one_line(tmp_path, capfd):
    """Which names it, and what to do."""
    message = f"worker 1 was killed by SIGKILL; python train.py --resume {tmp_path} goes on"
    with pytest.raises(SystemExit, match=re.escape(message)):
        launch.run_here(2, partial(doomed, tmp_path))
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["--env", "JansenWalker-v0", "--algo", "sac", "--workers", "2"],
            "algo is 'sac', must be 'ppo' with several workers",
        ),
        (["--n-envs", "7", "--workers", "2"], "n_envs is 7, must be a multiple of the 2 workers"),
        (
            ["--n-envs", "36", "--workers", "3"],
            "hyperparameters.batch_size is 4096, must be a multiple of the 3",
        ),
        (["--workers", "0"], "'0' is not allowed, must be a whole number from 1"),
    ],
)
def test_what_cannot_be_shared_out_is_refused(arguments, message, tmp_path, capsys):
    """With one line, before anything starts or is written."""
    with pytest.raises(SystemExit) as refused:
        train.main([*arguments, "--log-folder", str(tmp_path / "logs")])
    assert message in f"{refused.value} {capsys.readouterr().err}"
    assert not (tmp_path / "logs").exists()


def test_target_kl_is_refused():
    """Each worker would stop by its own part of the data."""
    hyperparameters = {**CONFIG["hyperparameters"], "target_kl": 0.02}
    with pytest.raises(ValueError, match=r"hyperparameters\.target_kl must be null"):
        data_parallel.check_config({**CONFIG, "hyperparameters": hyperparameters}, 2)


def averaging(out, worker):
    """The average of what six workers have."""
    own = torch.from_numpy(np.random.default_rng(worker.rank).normal(size=1000).astype(np.float32))
    worker.average(own)
    np.save(out / f"{worker.rank}.npy", own.numpy())
    return Path(worker.told("folder", lambda: str(out)))


@pytest.mark.slow
def test_six_workers_average_alike(tmp_path):
    """Along two axes, of two and of three: the mean, and the same bits for all."""
    launch.run_here(6, partial(averaging, tmp_path))
    found = [np.load(tmp_path / f"{rank}.npy") for rank in range(6)]
    expected = np.mean([np.random.default_rng(rank).normal(size=1000) for rank in range(6)], 0)
    assert found[0] == pytest.approx(expected, abs=1e-6)
    assert all(np.array_equal(found[0], other) for other in found)


def start(folder, *more, launcher=()):
    """train.py as a process of its own, in a session of its own, as in a terminal."""
    command = [sys.executable, *launcher, str(Path(train.__file__)), *SHORT, *more]
    return subprocess.Popen(
        [*command, "--log-folder", str(folder)], start_new_session=True, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(
    ("send", "number"),
    [(os.killpg, signal.SIGINT), (os.kill, signal.SIGTERM), *((os.kill, n) for n in HANGUP)],
)
def test_a_signal_stops_all_workers(send, number, tmp_path):
    """Ctrl-C, which a terminal sends to its processes; SIGTERM, SIGHUP to the first: saved once."""
    process = start(tmp_path, "-n", "10000000", "--save-freq", "0", "--eval-freq", "0")
    run = tmp_path / "ppo" / "JansenWalker-v0_1"
    monitor = run / "monitor" / "1.monitor.csv"
    while process.poll() is None and not (monitor.is_file() and len(monitor.read_text()) > 500):
        time.sleep(0.1)  # until episodes have ended
    send(process.pid, number)
    output = process.communicate()[0]
    assert process.returncode == 128 + number, output
    assert output.count("stopping after this rollout") == output.count("stopped, saved") == 1
    assert len(list((run / "checkpoints").iterdir())) == 1
    assert f"--resume {run}" in output


@pytest.mark.slow
def test_resuming_is_exact(tmp_path, capfd):
    """Two workers that go on from a checkpoint come to the same model bit for bit; one says not."""
    folder = train.main([*SHORT, "-n", "1536", "--log-folder", str(tmp_path)])
    policy = read_model(folder / "final_model.zip")[0]["policy"]
    for path in (folder / "final_model.zip", *(folder / "checkpoints").glob("model_1024*")):
        path.unlink()
    more = ["--resume", str(folder), "--eval-episodes", "1", "--no-progress", "--eval-freq", "0"]
    train.main([*more, "--workers", "2"])
    assert "episodes begin again" not in capfd.readouterr().out
    again = read_model(folder / "final_model.zip")[0]["policy"]
    assert all(torch.equal(policy[name], again[name]) for name in policy)
    (folder / "final_model.zip").unlink()
    train.main([*more, "-n", "1600"])
    assert "of another number of workers: episodes begin" in capfd.readouterr().out


def on_a_full_disk(args, config, worker):
    """A run whose second worker cannot log an episode."""
    if worker.rank == 1:

        def refuse(*row):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "1.monitor.csv")

        training.ResultsWriter.write_row = refuse
    return train.run(args, config, "python train.py", worker)


@pytest.mark.slow
def test_what_ends_one_worker_is_said(tmp_path, capfd):
    """Though it is not the one that leads."""
    short = ["--env-kwargs", "{max_episode_steps: 20}", "--log-folder", str(tmp_path)]
    args = train.parse([*SHORT, *short])
    with pytest.raises(SystemExit) as ended:
        launch.run_here(2, partial(on_a_full_disk, args, train._configure(args)))
    assert ended.value.code == 1
    assert capfd.readouterr().err.count("training stopped at") == 1


@pytest.mark.slow
def test_torchrun_gives_the_same_run(tmp_path):
    """Bit for bit what train.py starts by itself."""
    torchrun = ("-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2")
    policies = []
    for launcher, more in ((torchrun, ("--workers", "2")), ((), ("--workers", "2"))):
        folder = tmp_path / str(len(launcher))
        process = start(folder, *more, launcher=launcher)
        output = process.communicate()[0]
        assert process.returncode == 0, output
        assert output.count("trained in") == 1
        policies.append(read_model(folder / "ppo/JansenWalker-v0_1/final_model.zip")[0]["policy"])
    assert all(torch.equal(policies[0][name], policies[1][name]) for name in policies[0])


@pytest.mark.slow
def test_ray_gives_the_same_run(tmp_path):
    """On a cluster of this machine alone: bit for bit what train.py starts by itself."""
    pytest.importorskip("ray", reason="the extra 'distributed' brings Ray")
    policies = []
    for name, more in (("ray", ("--address", "local")), ("here", ())):
        process = start(tmp_path / name, *more)
        output = process.communicate()[0]
        assert process.returncode == 0, output
        assert output.count("trained in") == 1
        run = tmp_path / name / "ppo" / "JansenWalker-v0_1"
        policies.append(read_model(run / "final_model.zip")[0]["policy"])
    assert all(torch.equal(policies[0][name], policies[1][name]) for name in policies[0])


def test_missing_ray_is_named(monkeypatch, tmp_path):
    """With the extra that installs it."""
    monkeypatch.setattr(ray_workers.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(SystemExit, match="--address needs Ray, which the extra 'distributed'"):
        train.main(["--workers", "2", "--address", "auto", "--log-folder", str(tmp_path)])


def noting(norms, clip=torch.nn.utils.clip_grad_norm_):
    """Clipping that keeps the norms it found."""

    def noted(*arguments):
        norms.append(float(clip(*arguments)))

    return noted
