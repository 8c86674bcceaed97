"""Training with Stable-Baselines3: run folders, checkpoints, resuming, safe loading.

A run's folder holds all that is needed to go on with it or to score it:

    config.yml  command.txt  best_model.zip  final_model.zip  evaluations.json
    checkpoints/model_STEPS_steps.zip  monitor/*.csv  tensorboard/

Models are Stable-Baselines3's own zip files. They are read here without unpickling anything: only
the tensors in them are used, and the rest is built anew from config.yml.
"""

from __future__ import annotations

import io
import json
import pickle
import re
import time
import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch
import yaml
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback, CallbackList, ProgressBarCallback
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.vec_env import (
    DummyVecEnv,
    VecEnv,
    VecEnvWrapper,
    VecMonitor,
)

from agents.normalizer import NormalizedObservation
from agents.policy import Policy
from agents.rollout import make_env, run_episodes
from agents.scores import values
from agents.tasks import find_task
from agents.vec_env import can_move_together, make_vec_env
from jansen_env.files import write_json, write_text, write_whole

ALGORITHMS: dict[str, type[BaseAlgorithm]] = {"ppo": PPO, "sac": SAC}
ACTIVATIONS = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU, "elu": torch.nn.ELU}
CONFIGS = Path(__file__).parent / "configs"
SELECTION_SEED = 30_000  # of the episodes that choose the best model, apart from all others


def shipped_config(env_id: str, algo: str) -> Path:
    """The configuration for an environment and algorithm that comes with the package.

    Raises:
        ValueError: there is none.
    """
    path = CONFIGS / env_id / f"{algo}.yml"
    if not path.is_file():
        found = sorted(f"{p.parent.name}/{p.stem}" for p in CONFIGS.glob("*/*.yml"))
        raise ValueError(
            f"no configuration for {env_id}/{algo}, must be one of {found}, or a file of your own"
        )
    return path


def load_config(path: str | Path) -> dict[str, Any]:
    """A training configuration from YAML, read without running code.

    Keys: ``policy``, ``timesteps``, ``n_envs``, ``reward_scale``, ``env_kwargs`` (for training and
    evaluation), ``training_variants`` (further arguments of the training environments, taken in
    turn; ``max_episode_steps`` is one too), ``hyperparameters`` (the algorithm's arguments;
    ``learning_rate`` and ``clip_range`` may be "linear_X", falling from X to 0 over the run) and
    ``policy_kwargs`` (the policy's; ``activation`` is a name, ``normalize`` scales observations).

    Raises:
        ValueError: the file is no mapping, or has unknown or missing keys.
    """
    text = Path(path).read_text(encoding="utf-8")
    config = yaml.safe_load(text)
    required = {"policy", "timesteps", "n_envs", "hyperparameters"}
    allowed = required | {
        "policy_kwargs", "reward_scale", "env_kwargs", "training_variants", "algo", "env", "seed",
    }  # fmt: skip
    if not isinstance(config, dict) or not required <= set(config) <= allowed:
        found = sorted(config) if isinstance(config, dict) else type(config).__name__
        raise ValueError(
            f"{path} has {found}, must be a mapping with {sorted(required)} and optionally "
            f"{sorted(allowed - required)}"
        )
    return config


def make_training_env(
    env_id: str,
    env_kwargs: dict[str, Any],
    count: int,
    reward_scale: float = 1.0,
    folder: Path | None = None,
    variants: Sequence[dict[str, Any]] = ({},),
) -> VecEnv:
    """``count`` environments side by side, logged to ``folder``/monitor, rewards scaled.

    The i-th one takes the arguments of ``variants`` number i, counted around, on top of the others.
    """
    if can_move_together(env_id, env_kwargs, variants):
        file = None
        if folder is not None:
            (folder / "monitor").mkdir(parents=True, exist_ok=True)
            number = len(list((folder / "monitor").iterdir()))  # a resumed run writes another file
            file = str(folder / "monitor" / str(number))
        together = make_vec_env(env_id, count, env_kwargs, variants)
        return ScaledReward(VecMonitor(together, file), reward_scale)
    if folder is not None:
        (folder / "monitor").mkdir(parents=True, exist_ok=True)

    def make(index: int) -> Callable[[], gym.Env[Any, Any]]:
        def build() -> gym.Env[Any, Any]:
            file = None if folder is None else str(folder / "monitor" / str(index))
            kwargs = {**env_kwargs, **variants[index % len(variants)]}
            env = Monitor(make_env(env_id, kwargs), file, override_existing=False)
            return gym.wrappers.TransformReward(env, lambda reward: reward_scale * float(reward))

        return build

    return DummyVecEnv([make(i) for i in range(count)])


class ScaledReward(VecEnvWrapper):
    """Rewards times a number; what monitors inside have seen is not scaled."""

    def __init__(self, venv: VecEnv, scale: float) -> None:
        super().__init__(venv)
        self.scale = scale

    def reset(self) -> Any:
        return self.venv.reset()

    def step_wait(self) -> Any:
        observations, rewards, dones, infos = self.venv.step_wait()
        return observations, (self.scale * rewards).astype(np.float32), dones, infos


def build_model(algo: str, config: dict[str, Any], env: Any, **more: Any) -> BaseAlgorithm:
    """A fresh model of ``algo`` for ``env`` from a configuration.

    Raises:
        ValueError: an unknown algorithm, schedule or activation.
    """
    if algo not in ALGORITHMS:
        raise ValueError(f"algo is {algo!r}, must be one of {sorted(ALGORITHMS)}")
    arguments = dict(config["hyperparameters"])
    for name in ("learning_rate", "clip_range"):
        if name in arguments:
            arguments[name] = _schedule(name, arguments[name])
    return ALGORITHMS[algo](
        config["policy"],
        env,
        policy_kwargs=_policy_arguments(config),
        device="cpu",
        **arguments,
        **more,
    )


def _policy_arguments(config: dict[str, Any]) -> dict[str, Any]:
    """``policy_kwargs`` with names turned into classes."""
    arguments = dict(config.get("policy_kwargs", {}))
    if "activation" in arguments:
        activation = arguments.pop("activation")
        if activation not in ACTIVATIONS:
            raise ValueError(f"activation is {activation!r}, must be one of {sorted(ACTIVATIONS)}")
        arguments["activation_fn"] = ACTIVATIONS[activation]
    if arguments.pop("normalize", False):
        arguments["features_extractor_class"] = NormalizedObservation
    return arguments


def _schedule(name: str, value: Any) -> float | Callable[[float], float]:
    if isinstance(value, (int, float)):
        return float(value)
    match = re.fullmatch(r"linear_([0-9.eE+-]+)", str(value))
    if match is None:
        raise ValueError(f"{name} is {value!r}, must be a number or 'linear_NUMBER'")
    start = float(match.group(1))
    return lambda remaining: start * remaining


def read_tensors(path: str | Path) -> tuple[dict[str, Any], int]:
    """Parameters and number of time steps in a Stable-Baselines3 zip file, without unpickling.

    Returns:
        (parameters by name, as ``BaseAlgorithm.set_parameters`` takes them; time steps trained)

    Raises:
        ValueError: not such a file.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            names = [name for name in archive.namelist() if name.endswith(".pth")]
            tensors = {
                name[: -len(".pth")]: torch.load(
                    io.BytesIO(archive.read(name)), map_location="cpu", weights_only=True
                )
                for name in names
            }
            steps = int(json.loads(archive.read("data"))["num_timesteps"])
    except (zipfile.BadZipFile, KeyError, ValueError, pickle.UnpicklingError) as error:
        raise ValueError(f"{path} is no Stable-Baselines3 model: {error}") from error
    return tensors, steps


def find_config(model: str | Path) -> Path:
    """The config.yml of the run a model belongs to: in its folder or the one above.

    Raises:
        ValueError: there is none.
    """
    folder = Path(model).resolve().parent
    for place in (folder, folder.parent):
        if (place / "config.yml").is_file():
            return place / "config.yml"
    raise ValueError(f"no config.yml beside {model}: it says how the model is built")


def load_policy(path: str | Path) -> Policy:
    """A trained policy from a run's folder or a model's zip file, without running code from it.

    Raises:
        ValueError: no such model, or no config.yml beside it.
    """
    path = Path(path)
    if path.is_dir():
        path = path / "best_model.zip"
    if not path.is_file():
        raise ValueError(f"no model at {path}")
    config = load_config(find_config(path))
    env = make_env(config["env"], config.get("env_kwargs", {}))
    policy_class = ALGORITHMS[config["algo"]].policy_aliases[config["policy"]]
    arguments = _policy_arguments(config)
    if "use_sde" in config["hyperparameters"]:
        arguments["use_sde"] = config["hyperparameters"]["use_sde"]
    policy: Any = policy_class(
        env.observation_space,
        env.action_space,
        lambda _: 0.0,  # the learning rate, of no use here
        **arguments,
    )
    policy.load_state_dict(read_tensors(path)[0]["policy"])
    policy.set_training_mode(False)
    env.close()
    loaded: Policy = policy
    return loaded


def new_run_folder(root: str | Path, algo: str, env_id: str) -> Path:
    """``root/ALGO/ENV_N``, N one above the last; created."""
    parent = Path(root) / algo
    parent.mkdir(parents=True, exist_ok=True)
    pattern = re.compile(re.escape(env_id) + r"_(\d+)")
    found = [int(m.group(1)) for p in parent.iterdir() if (m := pattern.fullmatch(p.name))]
    folder = parent / f"{env_id}_{max(found, default=0) + 1}"
    folder.mkdir()
    return folder


def last_checkpoint(folder: str | Path) -> Path:
    """The checkpoint with the most steps in a run's folder.

    Raises:
        ValueError: there is none.
    """
    found = {
        int(m.group(1)): p
        for p in (Path(folder) / "checkpoints").glob("model_*_steps.zip")
        if (m := re.fullmatch(r"model_(\d+)_steps", p.stem))
    }
    if not found:
        raise ValueError(f"no checkpoint in {Path(folder) / 'checkpoints'}, nothing to resume from")
    return found[max(found)]


def restore(model: BaseAlgorithm, tensors: dict[str, Any]) -> None:
    """Set all parameters of a model, its optimisers' too, from :func:`read_tensors`."""
    variables = tensors.pop("pytorch_variables", None) or {}
    model.set_parameters(tensors, exact_match=True)
    for name, value in variables.items():  # such as SAC's entropy coefficient
        getattr(model, name).data = value.data


class Saver(BaseCallback):
    """Saves checkpoints, and evaluates now and then to keep the best model.

    Args:
        folder: the run's. save_every, eval_every: environment steps; 0 for never.
        env_id, env_kwargs, episodes: of the evaluation, and its episodes per command.
        done: steps trained before this run began.
    """

    def __init__(
        self,
        folder: Path,
        save_every: int,
        eval_every: int,
        env_id: str,
        env_kwargs: dict[str, Any],
        episodes: int = 4,
        done: int = 0,
    ) -> None:
        super().__init__()
        self.folder, self.save_every, self.eval_every = folder, save_every, eval_every
        self.env_id, self.env_kwargs = env_id, env_kwargs
        self.task = find_task(env_id)
        self.commands = np.repeat(self.task.commands, episodes)
        self.history: list[dict[str, Any]] = []
        history = folder / "evaluations.json"
        if history.is_file():
            self.history = json.loads(history.read_text(encoding="utf-8"))
            # After a kill the checkpoint may be older than the last evaluation.
            self.history = [row for row in self.history if row["steps"] <= done]
        self.best = max((row["return"] for row in self.history), default=-np.inf)

    def _on_training_start(self) -> None:
        self._next_save = self.num_timesteps + self.save_every
        self._next_eval = self.num_timesteps + self.eval_every
        trained = self.history[-1].get("seconds", 0.0) if self.history else 0.0
        self._begun = time.perf_counter() - trained

    def _on_step(self) -> bool:
        if self.save_every and self.num_timesteps >= self._next_save:
            self._next_save += self.save_every
            name = f"model_{self.num_timesteps}_steps.zip"
            save_model(self.model, self.folder / "checkpoints" / name)
        if self.eval_every and self.num_timesteps >= self._next_eval:
            self._next_eval += self.eval_every
            self.evaluate()
        return True

    def evaluate(self) -> None:
        """Score the present policy; keep it if it is the best so far."""
        seeds = SELECTION_SEED + np.arange(len(self.commands))
        self.model.policy.set_training_mode(False)
        run = run_episodes(self.model.policy, self.env_id, self.env_kwargs, self.commands, seeds)
        env = make_env(self.env_id, self.env_kwargs)
        scored = values(self.task, run, env)
        env.close()
        for name, value in scored.items():
            self.logger.record(f"eval/{name}", value)
        row: dict[str, Any] = {
            "steps": float(self.num_timesteps),
            "seconds": round(time.perf_counter() - self._begun, 1),  # of training, this included
            **scored,
        }
        if row["return"] > self.best:
            self.best = row["return"]
            save_model(self.model, self.folder / "best_model.zip")
        self.history.append(row)
        write_json(self.folder / "evaluations.json", self.history)


class NormalizerUpdate(BaseCallback):
    """Lets the policy's normalizer see the last rollout before the next one begins.

    Within a rollout and the update on it the normalizer stands still.
    """

    def _on_rollout_start(self) -> None:
        extractors = [
            m for m in self.model.policy.modules() if isinstance(m, NormalizedObservation)
        ]
        if not extractors:
            return
        if isinstance(self.model, OnPolicyAlgorithm):
            buffer = self.model.rollout_buffer
            seen = buffer.observations.reshape(-1, extractors[0].mean.shape[0])
            if not buffer.full:
                seen = np.asarray(self.model._last_obs)  # before the first rollout
        else:
            seen = np.asarray(self.model._last_obs)
        for extractor in extractors:
            extractor.update(torch.as_tensor(seen, dtype=torch.float32))

    def _on_step(self) -> bool:
        return True


def save_model(model: BaseAlgorithm, path: Path) -> None:
    """Save whole or not at all."""
    write_whole(path, model.save)


def train(
    algo: str,
    env_id: str,
    config: dict[str, Any],
    folder: Path,
    *,
    seed: int,
    eval_every: int,
    save_every: int,
    tensorboard: str | None,
    resume: Path | None,
    progress: bool = True,
) -> BaseAlgorithm:
    """Train until ``config["timesteps"]``, from the start or from the checkpoint ``resume``.

    Leaves final_model.zip and best_model.zip in ``folder`` and returns the final model.
    """
    env_kwargs = config.get("env_kwargs", {})
    venv = make_training_env(
        env_id,
        env_kwargs,
        config["n_envs"],
        config.get("reward_scale", 1.0),
        folder,
        config.get("training_variants", ({},)),
    )
    model = build_model(algo, config, venv, seed=seed, tensorboard_log=tensorboard)
    if resume is not None:
        tensors, done = read_tensors(resume)
        restore(model, tensors)
        model.num_timesteps = done
        venv.seed(seed + done)
        print(f"resuming from {resume} at {done} steps")
    remaining = config["timesteps"] - model.num_timesteps
    saver = Saver(folder, save_every, eval_every, env_id, env_kwargs, done=model.num_timesteps)
    callbacks: list[BaseCallback] = [NormalizerUpdate(), saver]
    if progress:
        callbacks.append(ProgressBarCallback())
    if remaining > 0:
        model.learn(
            remaining,
            callback=CallbackList(callbacks),
            reset_num_timesteps=False,
            tb_log_name=folder.name,
        )
        saver.evaluate()
    save_model(model, folder / "final_model.zip")
    venv.close()
    return model


def record_run(folder: Path, config: dict[str, Any], command: str) -> None:
    """Write config.yml and command.txt."""
    write_text(folder / "config.yml", yaml.safe_dump(config, sort_keys=False))
    write_text(folder / "command.txt", command + "\n")
