"""Training with Stable-Baselines3: a model on its environments, from start or checkpoint."""

import shlex
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback, ProgressBarCallback
from stable_baselines3.common.noise import NormalActionNoise
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper
from stable_baselines3.common.vec_env.base_vec_env import VecEnvObs, VecEnvStepReturn

from agents.training.callbacks import NormalizerUpdate, Saver, UpdateThreads
from agents.training.config import training_envs
from agents.training.runs import FINAL, replay_path
from agents.training.training_state import load_replay_buffer, restore, restore_state
from jansen_env.sb3 import make_vec_env
from jansen_env.sb3.run_config import ALGORITHMS, RunConfig, find_config
from jansen_env.sb3.trained import policy_kwargs_of, read_model
from jansen_env.scoring.metrics import Env

EVALUATIONS = 8  # of a run, by default


class TrainingReward(VecEnvWrapper):
    """Rewards less ``fall_cost`` where an episode ends before its time limit, times ``scale``."""

    def __init__(self, venv: VecEnv, scale: float, fall_cost: float) -> None:
        super().__init__(venv)
        self.scale, self.fall_cost = scale, fall_cost

    def reset(self) -> VecEnvObs:
        return self.venv.reset()

    def step_wait(self) -> VecEnvStepReturn:
        observations, rewards, dones, infos = self.venv.step_wait()
        fallen = dones & ~np.array([info.get("TimeLimit.truncated", False) for info in infos])
        rewards = self.scale * (rewards - self.fall_cost * fallen)
        return observations, rewards.astype(np.float32), dones, infos


def prepare(config: RunConfig, resume: Path | None = None, device: str = "cpu") -> BaseAlgorithm:
    """Build the model that a configuration describes, on its environments, or resume from a
    checkpoint; writes nothing. ``device``: torch's, of the networks.

    Raises ValueError: something in the configuration or the files is wrong.
    """
    kwargs, variants = training_envs(config)
    venv = make_vec_env(config.env, config.n_envs, env_kwargs=kwargs, variants=variants)
    venv = TrainingReward(venv, config.reward_scale, config.fall_cost)
    model = build_model(config, venv, device)
    if resume is not None:
        saved = read_model(resume)
        restore(model, saved)
        if isinstance(model, OffPolicyAlgorithm) and model.replay_buffer is not None:
            path = replay_path(find_config(resume).parent, model.num_timesteps)
            load_replay_buffer(model.replay_buffer, path)
        restore_state(model, saved.notes.get("state", {}))
    return model


def build_model(config: RunConfig, env: VecEnv | Env, device: str = "cpu") -> BaseAlgorithm:
    """Build the new model of a configuration for an environment."""
    arguments = dict(config.hyperparameters)
    for name in ("learning_rate", "clip_range", "clip_range_vf", "delta_std"):
        if isinstance(value := arguments.get(name), str):
            arguments[name] = linear_schedule(value)
    if "action_noise" in arguments:
        deviation = np.full(env.action_space.shape or (), arguments["action_noise"])
        arguments["action_noise"] = NormalActionNoise(np.zeros_like(deviation), deviation)
    return ALGORITHMS[config.algo](
        config.policy, env, device=device, seed=config.seed, **arguments,
        policy_kwargs=policy_kwargs_of(config),
    )  # fmt: skip


def linear_schedule(text: str) -> LinearSchedule:
    """Return ``"linear_X"``: from X at the start to 0 at the end, and 0 past it, where a run's last
    rollout may end."""
    return LinearSchedule(float(text.removeprefix("linear_")), 0.0, end_fraction=1.0)


@contextmanager
def _failures_explained(model: BaseAlgorithm, go_on: str) -> Iterator[None]:
    """Turn a full disk, a policy that is NaN and Ctrl-C into a SystemExit that says so."""
    try:
        yield
    except KeyboardInterrupt:
        print(f"\nstopped at {model.num_timesteps} steps; {go_on}")
        raise SystemExit(130) from None
    except OSError as error:
        reason = f"stopped at {model.num_timesteps} steps: {error}; {go_on}"
        raise SystemExit(f"training {reason}") from error
    except ValueError as error:
        if "to satisfy the constraint" not in str(error):  # torch's, of a policy that is NaN
            raise
        raise SystemExit(
            f"training diverged at {model.num_timesteps} steps: the policy's actions are no "
            "longer finite; a lower learning_rate may help"
        ) from error


def train(
    model: BaseAlgorithm, config: RunConfig, folder: Path, *, eval_every: int | None,
    save_every: int, tensorboard: str | None = None, resume: Path | None = None,
    progress: bool = True, more_callbacks: Sequence[BaseCallback] = (),
) -> None:  # fmt: skip
    """Train until ``config.timesteps``; leaves final_model.zip and best_model.zip in a folder.

    Args:
        model, config, resume: as of :func:`prepare`. folder: the run's.
        eval_every, save_every: steps between evaluations and between checkpoints, 0 for none;
            ``eval_every`` is None for :data:`EVALUATIONS` in all.
        tensorboard: folder of its log, None for none. progress: whether to show a bar.
        more_callbacks: of Stable-Baselines3, called after an evaluation at the same step.

    Raises SystemExit: Ctrl-C (status 130), the policy's actions are no longer finite, or a file
    cannot be written: what was saved before stays good.
    """
    venv = model.get_env()
    assert venv is not None
    steps = config.timesteps
    eval_every = max(1, steps // EVALUATIONS) if eval_every is None else eval_every
    state = read_model(resume).notes["state"] if resume is not None else None
    saver = Saver(folder, config, save_every, eval_every, model.num_timesteps, state)
    saver.init_callback(model)
    model.tensorboard_log = tensorboard
    callbacks = [NormalizerUpdate(), saver, *more_callbacks]
    if isinstance(model, OnPolicyAlgorithm):  # others update with small batches
        callbacks.append(UpdateThreads())
    if progress:
        callbacks.append(ProgressBarCallback())
    go_on = f"python train.py --resume {shlex.quote(str(folder))} goes on from the last checkpoint"
    with _failures_explained(model, go_on), closing(venv):
        if (remaining := steps - model.num_timesteps) > 0:
            model.learn(remaining, callback=callbacks, reset_num_timesteps=False,
                        tb_log_name=folder.name)  # fmt: skip
            saver.evaluate()
        saver.save(folder / FINAL)
