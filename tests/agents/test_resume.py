"""A run that was killed and resumed is, bit for bit, the one that was not."""

from dataclasses import replace

import pytest
import torch
from small_runs import go_on, outcome, same, small_run

from agents.training.runs import last_state
from agents.training.train_model import prepare
from jansen_env.sb3.trained import load_policy, read_model

pytestmark = pytest.mark.usefixtures("few_episodes")
CASES = {
    "ppo": small_run(),
    "noise of a whole rollout": small_run(hyperparameters={"use_sde": True, "sde_sample_freq": -1}),
    "lasting noise": small_run(hyperparameters={"use_sde": True, "sde_sample_freq": 8}),
    "all that is drawn": small_run(env_id="JansenWalkerHardcore-v0"),
    "recurrent": replace(small_run("ppo_lstm"), policy_kwargs={"lstm_hidden_size": 8}),
    "crank": small_run(env_id="JansenCrank-v0"),
    "sac": small_run("sac"),
    "td3": small_run("td3"),
    "tqc": small_run("tqc"),
    "crossq": small_run("crossq"),
    "sac, noise of a whole rollout": small_run("sac", hyperparameters={"sde_sample_freq": -1}),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_a_killed_run_ends_as_if_it_had_not_been(case, tmp_path):
    """Runs are killed before the first checkpoint, in the middle of a rollout, and shortly before
    the end.
    """
    settings = CASES[case]
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    for folder in (whole, killed):
        folder.mkdir()
    go_on(settings, whole)
    for part in (0.1, 0.43, 0.57, 0.1):
        go_on(settings, killed, killed_after=part * settings.timesteps)
    go_on(settings, killed)
    assert same(outcome(whole), outcome(killed))
    load_policy(killed)


@pytest.mark.slow
def test_ars_goes_on_with_the_weights_it_had(tmp_path):
    """The noise is not the same: a round of candidates that was cut short begins again."""
    settings = small_run("ars", timesteps=2000)
    go_on(settings, tmp_path, killed_after=1500)
    saved = read_model(last_state(tmp_path))
    model = prepare(settings, last_state(tmp_path))
    kept = torch.cat([tensor.flatten() for tensor in saved.parameters["policy"].values()])
    assert model.num_timesteps == saved.steps > 0 and kept.any() and model.weights.equal(kept)
    go_on(settings, tmp_path)
    assert outcome(tmp_path)[0].steps >= settings.timesteps
    load_policy(tmp_path)


@pytest.mark.slow
def test_environments_one_by_one_go_on_with_new_episodes(tmp_path, capsys):
    kwargs = {"track_joint_forces": True, "max_episode_steps": 9}
    settings = small_run(timesteps=96, n_envs=2, training_variants=[{}], env_kwargs=kwargs)
    go_on(settings, tmp_path, killed_after=50)
    go_on(settings, tmp_path)
    assert "begin new episodes" in capsys.readouterr().out
    assert outcome(tmp_path)[0].steps == settings.timesteps
