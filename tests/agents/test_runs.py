"""Runs of train.py: what their folders keep, how they start, stop and go on."""

import os
import pickle
import signal
from dataclasses import asdict, replace

import numpy as np
import pytest
import torch
import yaml
from small_runs import go_on, small_run
from stable_baselines3 import PPO

import train
from agents.training import callbacks, runs, training_state
from agents.training import train_model as training
from jansen_env.sb3.run_config import load_config
from jansen_env.sb3.trained import read_model

KEPT = 64  # steps of the checkpoint that a killed run is resumed from
STEPS = 128


def small_config(env_id="JansenWalker-v0", algo="ppo", **more):
    """Rollouts of 32 steps of 4 environments, in episodes of 8 each."""
    quick = {"n_steps": 8, "n_epochs": 1} if algo == "ppo" else {"learning_starts": 32}
    more = {"timesteps": STEPS, "n_envs": 4, "env_kwargs": {"max_episode_steps": 8}, **more}
    return small_run(algo, env_id, **{"training_variants": [{}], "hyperparameters": quick, **more})


@pytest.fixture
def returns(monkeypatch):
    """The returns that the next evaluations find, without an episode run; then 0."""
    left = []

    def estimates(*given):
        return {"return": left.pop(0) if left else 0.0}

    monkeypatch.setattr(callbacks, "run_episodes", lambda *given: None)
    monkeypatch.setattr(callbacks, "point_estimates", estimates)
    return left


def kill(folder):
    """Leave of a finished run what a kill shortly before its end leaves."""
    (folder / runs.FINAL).unlink()


@pytest.mark.slow
def test_learning_rate_never_goes_below_zero(tmp_path, returns):
    falling = {"n_steps": 8, "clip_range": "linear_0.2", "learning_rate": "linear_1e-3"}
    model = go_on(small_config(timesteps=100, hyperparameters=falling), tmp_path, every=KEPT)
    assert model.num_timesteps > 100
    assert model.policy.optimizer.param_groups[0]["lr"] == 0.0
    assert all(torch.isfinite(p).all() for p in model.policy.parameters())
    schedule = training.linear_schedule("linear_1e-3")
    assert [schedule(left) for left in (1.0, 0.5, 0.0, -0.04)] == [1e-3, 5e-4, 0.0, 0.0]


def test_resumed_run_keeps_a_better_model(tmp_path, returns):
    """The best model comes from steps that are trained again: only a better one replaces it."""
    returns += [1.0, 5.0]
    go_on(small_config(), tmp_path, every=KEPT)
    best = (tmp_path / runs.BEST).read_bytes()
    assert read_model(tmp_path / runs.BEST).steps == STEPS
    kill(tmp_path)
    returns += [2.0, 2.0]
    go_on(small_config(), tmp_path, every=KEPT)
    assert (tmp_path / runs.BEST).read_bytes() == best
    returned = [row["return"] for row in runs.read_evaluations(tmp_path)]
    assert returned == [1.0, 2.0, 2.0]
    kill(tmp_path)
    returns += [6.0]
    go_on(small_config(), tmp_path, every=KEPT)
    assert (tmp_path / runs.BEST).read_bytes() != best
    assert runs.best_score(tmp_path) == 6.0


def test_of_equal_models_the_first_is_kept(tmp_path, returns, capsys):
    """The last evaluation is printed once."""
    returns += [5.0, 5.0, 5.0]
    go_on(small_config(), tmp_path, every=KEPT)
    assert read_model(tmp_path / runs.BEST).steps == KEPT
    printed = capsys.readouterr().out
    assert printed.count("(the best so far)") == printed.count(f"evaluation: {STEPS} steps, ") == 1


def test_finished_run_stays_as_it_is(tmp_path, returns, no_scores, capsys):
    """If it is resumed with nothing left to train, it is only scored; with more steps it
    continues.
    """
    go_on(small_config(), tmp_path, every=KEPT)
    PPO.load(tmp_path / runs.FINAL, device="cpu")  # Stable-Baselines3 reads what is saved, too
    names = (runs.FINAL, "config.yml", "command.txt", "evaluations.json")
    before = [(tmp_path / name).read_bytes() for name in names]
    train.main(["--resume", str(tmp_path), "-n", "100"])
    assert f"is finished after {STEPS} steps; the run has 100" in capsys.readouterr().out
    assert [(tmp_path / name).read_bytes() for name in names] == before
    train.main(["--resume", str(tmp_path), "-n", str(STEPS + 32), "--no-progress"])
    assert f"resuming from {tmp_path / runs.FINAL} at {STEPS} steps" in capsys.readouterr().out
    assert read_model(tmp_path / runs.FINAL).steps == STEPS + 32


def test_last_state_is_the_one_of_most_steps(tmp_path):
    """It is a checkpoint or the final model.

    At equal steps it is the final model, which is one update ahead.
    """
    model = training.prepare(small_config())
    assert runs.last_state(tmp_path) is None
    for name in (
        "checkpoints/model_9_steps.zip",
        "checkpoints/model_10_steps.zip",
        runs.FINAL,
        "checkpoints/model_200_steps.zip",
    ):
        model.num_timesteps = 10 if name == runs.FINAL else int(name.split("_")[1])
        training_state.save_model(model, tmp_path / name, {})
        assert runs.last_state(tmp_path) == tmp_path / name


def test_bad_replay_buffers_are_refused(tmp_path):
    buffer = training.prepare(small_config(algo="sac")).replay_buffer
    path = tmp_path / "buffer.npz"

    class Bomb:
        def __reduce__(self):
            return (open, (str(tmp_path / "boom"), "w"))

    training_state.save_replay_buffer(buffer, path)
    for content in (pickle.dumps(Bomb()), path.read_bytes()[:-100], b""):
        path.write_bytes(content)
        with pytest.raises(ValueError, match="is not a replay buffer"):
            training_state.load_replay_buffer(buffer, path)
    arrays = {name: getattr(buffer, name)[:6] for name in training_state.ARRAYS}
    good = {"pos": 5, "full": False, **arrays}
    for changed, reason in (
        ({"pos": np.array([Bomb()], dtype=object)}, "is not a replay buffer"),
        ({"actions": np.zeros((6, 4, 2), np.float32)}, "could not broadcast"),
        ({"pos": -1}, "pos must be.*got -1"),
        ({"more": np.zeros(10**8, np.uint8)}, "it must unpack to at most"),
    ):
        np.savez_compressed(path, **{**good, **changed})
        with pytest.raises(ValueError, match=reason):
            training_state.load_replay_buffer(buffer, path)
    assert not (tmp_path / "boom").exists()


def test_ctrl_c_says_how_to_go_on(tmp_path, returns, monkeypatch, capsys):
    """The exit status is 130, and the last checkpoint is there to resume from."""
    step = callbacks.Saver._on_step

    def interrupt(saver):
        if saver.num_timesteps > KEPT + 32:
            os.kill(os.getpid(), signal.SIGINT)
        return step(saver)

    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in the background
    try:
        with monkeypatch.context() as patch, pytest.raises(SystemExit) as stopped:
            patch.setattr(callbacks.Saver, "_on_step", interrupt)
            go_on(small_config(), tmp_path, every=KEPT)
    finally:
        signal.signal(signal.SIGINT, before)
    assert stopped.value.code == 130
    assert f"--resume {tmp_path} goes on" in capsys.readouterr().out
    go_on(small_config(), tmp_path, every=KEPT)
    assert read_model(tmp_path / runs.FINAL).steps == STEPS


@pytest.fixture
def started(monkeypatch, no_scores):
    """The configurations that train.py would train and score."""
    started_with = []
    monkeypatch.setattr(train, "train", lambda _, settings, *a, **kw: started_with.append(settings))
    return started_with


def test_config_file_says_algorithm_environment_and_seed(tmp_path, started):
    path = tmp_path / "my.yml"
    path.write_text(yaml.safe_dump(asdict(small_config("JansenCrank-v0", seed=7))))
    given = ["--config", str(path), "--log-folder", str(tmp_path)]
    folder = train.main(given)
    assert folder == tmp_path / "ppo" / "JansenCrank-v0_1"
    assert load_config(folder / "config.yml") == started[-1] and started[-1].seed == 7
    train.main([*given, "--seed", "0", "--env", "JansenWalker-v0"])
    assert (started[-1].env, started[-1].seed) == ("JansenWalker-v0", 0)
    path.write_text(yaml.safe_dump(asdict(small_config(algo="sac"))))
    assert train.main(given).parent.name == started[-1].algo == "sac"


@pytest.mark.parametrize(
    "wrong",
    [
        ["--env-kwargs", "{friction: -1}"],
        ["--config", "CONFIG"],
        ["--env-kwargs", "{no_such: 1}"],
        ["--tensorboard-log", f"{__file__}/log"],
        ["--start", "pretrained:none"],
    ],
)
def test_failed_start_leaves_no_folder(wrong, tmp_path, started):
    (tmp_path / "my.yml").write_text("env: ..")
    wrong = [str(tmp_path / "my.yml") if word == "CONFIG" else word for word in wrong]
    with pytest.raises((SystemExit, TypeError)):
        train.main([*wrong, "--log-folder", str(tmp_path / "logs")])
    assert not (tmp_path / "logs").exists() and not started


def test_failed_resume_changes_nothing(tmp_path, started):
    checkpoint = tmp_path / "checkpoints" / "model_9_steps.zip"
    training_state.save_model(training.prepare(small_config()), checkpoint, {})
    settings = replace(small_config(), policy_kwargs={"net_arch": [8]})
    runs.record_run(tmp_path, settings, "python train.py")
    before = [(tmp_path / name).read_bytes() for name in ("config.yml", "command.txt")]
    for message in ("does not fit its configuration", "not a Stable-Baselines3 model"):
        with pytest.raises(SystemExit, match=message):
            train.main(["--resume", str(tmp_path), "-n", "999"])
        checkpoint.write_bytes(b"torn")
    after = [(tmp_path / name).read_bytes() for name in ("config.yml", "command.txt")]
    assert after == before


def test_training_that_diverges_says_so(tmp_path, returns):
    settings = small_config(hyperparameters={"n_steps": 8, "learning_rate": 1e30})
    with pytest.raises(SystemExit, match=r"training diverged at \d+ steps: .* lower learning_rate"):
        go_on(replace(settings, timesteps=4 * STEPS), tmp_path, every=KEPT)
