"""Small training runs, and what has come out of them, for the tests of resuming."""

from dataclasses import replace
from pathlib import Path

import torch

from agents.training import config, runs
from agents.training import train_model as training
from agents.training.callbacks import TIMES
from jansen_env.sb3.run_config import RunConfig
from jansen_env.sb3.trained import read_model

CRANK = "JansenCrank-v0"
LIBRARY = Path(__file__).parents[1] / "agents" / "studies" / "library"
STEPS = 576  # of a whole run
SAVED = 6  # checkpoints of a whole run
EPISODE = 21  # steps, so that episodes end anywhere in a rollout


def small_run(algo="ppo", env_id="JansenWalker-v0", hyperparameters=(), **more):
    """The shipped configuration, or the study's of the library's defaults, with small rollouts, or
    a small replay buffer that fills."""
    shipped = config.new_config(None if algo in ("ppo", "sac") else LIBRARY, algo, env_id)
    if algo.startswith("ppo"):
        small = {"n_steps": 16, "n_epochs": 2, "batch_size": 16}
    elif algo == "ars":
        small = {"n_delta": 1, "n_eval_episodes": 6}
    else:
        small = {"learning_starts": 96, "gradient_steps": 1, "batch_size": 16, "buffer_size": 300}
    more = {"timesteps": STEPS, "n_envs": 6, **more}
    env_kwargs = {"max_episode_steps": EPISODE, **shipped.env_kwargs, **more.pop("env_kwargs", {})}
    return replace(
        shipped,
        env_kwargs=env_kwargs,
        **more,
        hyperparameters={**shipped.hyperparameters, **small, **dict(hyperparameters)},
        policy_kwargs={**shipped.policy_kwargs, "net_arch": [16, 16]},
    )


class Killed(BaseException):
    """Nothing in training catches it."""


def go_on(settings, folder: Path, killed_after=float("inf"), every=None):
    """Train from a folder's last state to the end, as train.py does, or for so many steps only.

    With checkpoints and evaluations ``every`` so many steps; returns the model.
    """
    steps = settings.timesteps
    with runs.locked(folder):
        resume = runs.last_state(folder)
        model = training.prepare(settings, resume)
        _kill(model.get_env(), killed_after)
        runs.record_run(folder, settings, "python train.py")
        try:
            training.train(
                model,
                settings,
                folder,
                eval_every=every or steps // 3,
                save_every=every or steps // SAVED,
                resume=resume,
                progress=False,
            )
            assert killed_after == float("inf"), "it has come to its end before"
        except Killed:
            pass
    return model


def _kill(venv, steps):
    """Let training end without a word once so many steps are trained."""
    step_wait = venv.step_wait
    left = [steps]

    def step():
        left[0] -= venv.num_envs
        if left[0] <= 0:
            raise Killed
        return step_wait()

    venv.step_wait = step


def outcome(folder: Path):
    """All that a run has come to: final model and state, best model, evaluations."""
    found = runs.read_evaluations(folder)
    rows = [{name: row[name] for name in row if name not in TIMES} for row in found]
    return read_model(folder / runs.FINAL), read_model(folder / runs.BEST)[:3], rows


def same(left, right) -> bool:
    """Whether two outcomes are equal, bit for bit."""
    if isinstance(left, torch.Tensor):
        return torch.equal(left, right)
    if isinstance(left, dict):
        return left.keys() == right.keys() and all(same(left[key], right[key]) for key in left)
    if isinstance(left, (list, tuple)):
        return len(left) == len(right) and all(map(same, left, right))
    return left == right


NETWORKS = {
    "plain": ("ppo", {}, {"net_arch": [8], "activation": "tanh"}),
    "normalized": ("ppo", {}, {"net_arch": [8, 4], "activation": "relu", "normalize": True}),
    "apart": (
        "ppo",
        {},
        {
            "net_arch": {"pi": [6], "vf": [4]},
            "activation": "elu",
            "normalize": True,
            "share_features_extractor": False,
        },
    ),
    "squashed": ("ppo", {"use_sde": True}, {"net_arch": [], "squash_output": True}),
    "sac": ("sac", {}, {"net_arch": [8], "normalize": True}),
    "tqc": ("tqc", {}, {"net_arch": [8]}),
    "sac with gSDE": ("sac", {"use_sde": True}, {"net_arch": [8], "clip_mean": 0.3}),
}


def made_run(folder, algo, hyperparameters, policy_kwargs, env_id=CRANK, **more):
    """A run's folder with a model that has learnt nothing, with weights of some size."""
    small = {"n_steps": 8, "batch_size": 8} if algo == "ppo" else {}
    config = RunConfig(
        algo=algo,
        env=env_id,
        timesteps=16,
        n_envs=1,
        policy_kwargs=policy_kwargs,
        hyperparameters={**hyperparameters, **small},
        **{"env_kwargs": {"max_episode_steps": 50}, **more},
    )
    folder.mkdir()
    runs.record_run(folder, config, "python train.py --seed 0")
    model = training.prepare(config)
    torch.manual_seed(0)
    with torch.no_grad():
        for name, tensor in model.policy.state_dict().items():
            if "target" not in name and tensor.is_floating_point():
                tensor.copy_(
                    torch.rand_like(tensor) + 0.1
                    if "extractor." in name
                    else 0.5 * torch.randn_like(tensor)
                )
    if algo != "ppo":
        model.critic_target.load_state_dict(model.critic.state_dict())
    model.save(folder / "best_model.zip")
    return folder
