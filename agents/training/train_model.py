"""Training with Stable-Baselines3: build a model or resume it from a checkpoint, and train it."""

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
from typing_extensions import override

from agents.training.callbacks import NormalizerUpdate, Saver, UpdateThreads
from agents.training.config import training_envs
from agents.training.runs import FINAL, replay_path
from agents.training.training_state import load_replay_buffer, restore, restore_state
from jansen_env.sb3 import make_vec_env
from jansen_env.sb3.run_config import ALGORITHMS, RunConfig, find_config
from jansen_env.sb3.trained import policy_kwargs_of, read_model
from jansen_env.scoring.metrics import Env

EVALUATIONS = 8  # default number of evaluations per run


class TrainingReward(VecEnvWrapper):
    """Wrapper that subtracts a cost for falls from the rewards and scales the result.

    Args:
        venv: Environments to wrap.
        scale: Factor of the rewards.
        fall_cost: Cost of an episode that ends before its time limit.
    """

    def __init__(self, venv: VecEnv, scale: float, fall_cost: float) -> None:
        super().__init__(venv)
        self.scale = scale
        self.fall_cost = fall_cost

    @override
    def reset(self) -> VecEnvObs:
        """Reset all environments; return the observations."""
        return self.venv.reset()

    @override
    def step_wait(self) -> VecEnvStepReturn:
        """Return the results of a step, with changed rewards."""
        observations, rewards, dones, infos = self.venv.step_wait()
        fallen = dones & ~np.array([info.get("TimeLimit.truncated", False) for info in infos])
        rewards = self.scale * (rewards - self.fall_cost * fallen)
        return observations, rewards.astype(np.float32), dones, infos


def prepare(config: RunConfig, resume: Path | None = None, device: str = "cpu") -> BaseAlgorithm:
    """Build the model of a configuration with its environments, or resume it from a checkpoint.

    This function writes no files.

    Args:
        config: Configuration of the run.
        resume: Checkpoint from which to resume. None builds a new model.
        device: PyTorch device of the networks.

    Raises:
        ValueError: If the configuration or a file is invalid.
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
    """Build a new model.

    Args:
        config: Configuration of the run.
        env: Environments on which the model is trained.
        device: PyTorch device of the networks.
    """
    arguments = dict(config.hyperparameters)
    for name in ("learning_rate", "clip_range", "clip_range_vf", "delta_std"):
        if isinstance(value := arguments.get(name), str):
            arguments[name] = linear_schedule(value)
    if "action_noise" in arguments:
        deviation = np.full(env.action_space.shape or (), arguments["action_noise"])
        arguments["action_noise"] = NormalActionNoise(np.zeros_like(deviation), deviation)
    return ALGORITHMS[config.algo](
        config.policy,
        env,
        device=device,
        seed=config.seed,
        **arguments,
        policy_kwargs=policy_kwargs_of(config),
    )


def linear_schedule(text: str) -> LinearSchedule:
    """Return a schedule that falls linearly from a value at the start of a run to 0 at its end.

    After the end, where the last rollout of a run may end, the schedule stays at 0.

    Args:
        text: ``"linear_X"``, where X is the initial value.
    """
    return LinearSchedule(float(text.removeprefix("linear_")), 0.0, end_fraction=1.0)


@contextmanager
def _failures_explained(model: BaseAlgorithm, go_on: str) -> Iterator[None]:
    """Convert a file error, diverged training or Ctrl-C into a SystemExit with an explanation."""
    try:
        yield
    except KeyboardInterrupt:
        print(f"\nstopped at {model.num_timesteps} steps; {go_on}")
        raise SystemExit(130) from None
    except OSError as error:
        reason = f"stopped at {model.num_timesteps} steps: {error}; {go_on}"
        raise SystemExit(f"training {reason}") from error
    except ValueError as error:
        # PyTorch raises an error with this text if actions are NaN.
        if "to satisfy the constraint" not in str(error):
            raise
        raise SystemExit(
            f"training diverged at {model.num_timesteps} steps: the policy's actions are no "
            "longer finite; a lower learning_rate may help"
        ) from error


def train(
    model: BaseAlgorithm,
    config: RunConfig,
    folder: Path,
    *,
    eval_every: int | None,
    save_every: int,
    tensorboard: str | None = None,
    resume: Path | None = None,
    progress: bool = True,
    more_callbacks: Sequence[BaseCallback] = (),
) -> None:
    """Train a model for ``config.timesteps`` steps; write final_model.zip and best_model.zip.

    Args:
        model: Model that :func:`prepare` returned.
        config: Configuration of the run.
        folder: Folder of the run.
        eval_every: Number of steps between evaluations; 0 for no evaluations. None selects
            :data:`EVALUATIONS` evaluations in total.
        save_every: Number of steps between checkpoints; 0 for no checkpoints.
        tensorboard: Folder of the TensorBoard log. None writes no log.
        resume: Checkpoint from which :func:`prepare` resumed. None for a new run.
        progress: Whether to show a progress bar.
        more_callbacks: Further callbacks of Stable-Baselines3. If there is an evaluation at the
            same step, they are called after it.

    Raises:
        SystemExit: If Ctrl-C is pressed (exit status 130), if the actions of the policy are no
            longer finite, or if a file cannot be written. Files that were saved before stay valid.
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
    if isinstance(model, OnPolicyAlgorithm):  # off-policy algorithms update with small batches
        callbacks.append(UpdateThreads())
    if progress:
        callbacks.append(ProgressBarCallback())
    go_on = f"python train.py --resume {shlex.quote(str(folder))} goes on from the last checkpoint"
    with _failures_explained(model, go_on), closing(venv):
        if (remaining := steps - model.num_timesteps) > 0:
            model.learn(
                remaining, callback=callbacks, reset_num_timesteps=False, tb_log_name=folder.name
            )
            saver.evaluate()
        saver.save(folder / FINAL)
