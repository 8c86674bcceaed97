"""Training: run folders, resuming, safe loading, and that it learns."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml
from stable_baselines3 import PPO

import train
from agents.training import config
from agents.training import train_model as training
from agents.training.runs import record_run
from agents.training.scores import outcome
from jansen_env.registration import IDS
from jansen_env.sb3 import BatchVecEnv
from jansen_env.sb3.run_config import ALGORITHMS, load_config
from jansen_env.sb3.trained import read_model
from jansen_env.scoring.benchmarks import find_benchmark
from jansen_env.scoring.evaluation import Scores

SMALL_PPO = Path(__file__).parents[1] / "small_ppo.yml"
SIZES = "-n 1024 --n-envs 4 --eval-episodes 1 --no-progress --save-freq 256 --eval-freq 256"
SMALL = ["--config", str(SMALL_PPO), *SIZES.split()]


@pytest.fixture(scope="module")
def run(tmp_path_factory, few_episodes):
    return train.main([*SMALL, "--log-folder", str(tmp_path_factory.mktemp("logs")), "--seed", "3"])


@pytest.mark.slow
def test_run_folder_holds_all(run):
    """It holds configuration, command, checkpoints, best and final model, evaluations, scores,
    figures and logs.
    """
    expected = [
        "config.yml",
        "command.txt",
        "best_model.zip",
        "final_model.zip",
        "evaluations.json",
        "scores.json",
        "scores.md",
        "scores.png",
    ]
    assert all((run / name).is_file() for name in expected)
    assert list((run / "checkpoints").glob("model_*_steps.zip"))
    assert list((run / "tensorboard").rglob("events*"))
    settings = yaml.safe_load((run / "config.yml").read_text())
    assert (settings["algo"], settings["seed"], settings["timesteps"]) == ("ppo", 3, 1024)
    assert run.parent.name == "ppo" and run.name == "JansenWalker-v0_1"
    assert "train.py" in (run / "command.txt").read_text()


def test_last_words_of_a_run(tmp_path):
    """One sentence says whether the best baseline is reached, and since when."""
    benchmark = find_benchmark("JansenGoal-v0")
    goal = config.new_config(None, None, "JansenGoal-v0", {"friction": 0.5})
    (tmp_path / "evaluations.json").write_text('[{"steps": 3194880, "return": 200}]')
    names = [*benchmark.baselines, "ppo/run"]
    numbers = {name: [0.1, 0.0, 0.2] for name in benchmark.metrics}
    overall = [{**numbers, "return": [rank + 100.0, 99.0, 101.0]} for rank in range(len(names))]
    scores = {n: {"overall": o, "episodes": 90} for n, o in zip(names, overall, strict=True)}
    for value, words in ((104.0, "above"), (99.0, "misses")):
        overall[-1]["return"] = [value, None, None]
        *_, last, _, watch = outcome(tmp_path, goal, Scores("JansenGoal-v0", scores)).splitlines()
        assert words in last and f"the best baseline, {names[-2]}'s" in last
        assert watch.endswith(f"{tmp_path} --env-kwargs '{{\"friction\": 0.5}}'")
        assert ("(since 3,194,880 steps)" in last) == (words == "above")


@pytest.mark.slow
def test_an_update_has_the_threads_of_the_robots(tmp_path, monkeypatch, few_episodes):
    """Torch updates with as many threads as the robots have, which changes nothing, and walks with
    one.
    """
    settings = config.new_config(timesteps=8192)
    seen = []
    ends = []
    settings.hyperparameters.update(n_steps=16, n_epochs=2)
    update = PPO.train
    monkeypatch.setattr(PPO, "train", lambda m: seen.append(torch.get_num_threads()) or update(m))
    for threads in (1, 2):
        monkeypatch.setenv("JANSEN_ENV_THREADS", str(threads))
        model = training.prepare(settings)
        folder = tmp_path / str(threads)
        folder.mkdir()
        training.train(model, settings, folder, eval_every=0, save_every=0, progress=False)
        assert torch.get_num_threads() == 1
        ends.append(read_model(folder / "final_model.zip").parameters["policy"])
    assert seen == [1, 1, 2, 2]
    for name, weights in ends[0].items():  # by MKL the same bits
        torch.testing.assert_close(weights, ends[1][name], rtol=0.0, atol=1e-3)


def test_networks_are_on_the_device_that_is_asked_for(capsys):
    """So is a normalizer. A device that PyTorch does not have is refused at once."""
    with pytest.warns(UserWarning, match="primarily intended to run on the CPU"):
        model = training.prepare(config.new_config(), device="meta")
    assert {entry.device.type for entry in model.policy.state_dict().values()} == {"meta"}
    for name in ("nowhere", "cpu:x", "meta"):  # meta holds no numbers
        with pytest.raises(SystemExit):
            train.main(["--device", name])
        assert (
            f"argument --device: must be cpu or another device of PyTorch, got '{name}'"
            in capsys.readouterr().err
        )


@pytest.mark.slow
@pytest.mark.parametrize("path", config.shipped_configs(), ids=lambda p: "/".join(p.parts[-2:]))
def test_every_config_builds(path, tmp_path):
    """Each builds on robots that are simulated together, and can be read again as it was
    recorded.
    """
    algo = path.stem if path.stem in ALGORITHMS else None
    settings = config.new_config(path, algo, path.parent.name, seed=3)
    assert isinstance(training.prepare(settings).get_env().unwrapped, BatchVecEnv)
    record_run(tmp_path, settings, "")
    assert load_config(tmp_path / "config.yml") == settings


@pytest.mark.parametrize("env_id", IDS)
def test_training_begins_on_every_environment(env_id, tmp_path, no_scores, few_episodes):
    """It needs no configuration of the caller; scores have tests of their own."""
    given = f"--env {env_id} --timesteps 8 --n-envs 2 --eval-episodes 1 --eval-freq 0 --no-progress"
    kwargs = ["--env-kwargs", "{max_episode_steps: 5}", "--log-folder", str(tmp_path)]
    folder = train.main([*given.split(), *kwargs])
    assert read_model(folder / "final_model.zip").steps >= 8


@pytest.mark.slow
def test_default_training_beats_the_baselines(tmp_path):
    """It beats the profile in return, and the PID by far, on every environment; it hardly ever
    falls.
    """
    folder = train.main(["--log-folder", str(tmp_path), "--no-progress"])
    result = json.loads((folder / "scores.json").read_text())
    ours = result[next(n for n in result if n.startswith("ppo"))]
    pid, profile = result["pid"], result["profile"]
    assert ours["overall"]["return"][0] > 1.8 * pid["overall"]["return"][0]
    assert ours["overall"]["return"][0] > profile["overall"]["return"][0]
    assert ours["overall"]["falls"][0] <= 0.0125  # one of eighty
    slips = [np.array(s["by_command"]["slip_per_metre"]["value"]) for s in (ours, pid)]
    assert (slips[0] < slips[1]).all() and (slips[0][:2] < slips[1][:2] / 2.5).all()
    assert max(ours["by_command"]["steady_speed_error"]["value"]) < 0.025
    assert max(ours["by_command"]["torque_change"]["value"]) < 1.8  # N m; ten seeds: 1.25 to 1.77
