"""Trained policies: built from a configuration; a model's file gives them tensors and no code."""

import inspect
import json
import math
import pickle
import zipfile
from contextlib import closing, suppress
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.save_util import load_from_zip_file
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

from jansen_env.arrays import Array
from jansen_env.checks import named_errors, one_line, whole_number
from jansen_env.files import open_regular
from jansen_env.sb3.run_config import ALGORITHMS, Arguments, RunConfig, find_config, load_config
from jansen_env.scoring.rollout import make_env

ACTIVATIONS = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU, "elu": torch.nn.ELU}
MAX_BYTES = 2**28  # of a model's file unpacked; those of the shipped configurations have 0.2 MB
MAX_STEPS = 10**12  # of a model's training
CLIP = 10.0  # standard deviations
MIN_DEVIATION = 1e-3  # or what hardly varies would be blown up: to the clip, and by rounding
NOTES = "notes.json"  # a member of a model's file beside Stable-Baselines3's own


class SavedModel(NamedTuple):
    """Content of a model's file: the state dicts of its modules and optimisers by name, tensors
    beside them such as SAC's entropy coefficient, time steps trained, and what was noted."""

    parameters: Arguments
    variables: Arguments
    steps: int
    notes: Arguments


def read_model(path: str | Path) -> SavedModel:
    """Read a zip file of Stable-Baselines3: tensors by ``torch.load(weights_only=True)`` and JSON.

    The pickles that Stable-Baselines3 writes beside them stay unread.

    Raises ValueError: no such file, it is damaged or unpacks to more than :data:`MAX_BYTES`.
    """
    try:
        with open_regular(path) as file, zipfile.ZipFile(file) as archive:
            size = sum(member.file_size for member in archive.infolist())
            if size > MAX_BYTES:
                raise ValueError(f"it unpacks to {size} bytes, must be {MAX_BYTES} at most")
            _, parameters, variables = load_from_zip_file(file, load_data=False, device="cpu")
            data = json.loads(archive.read("data"))
            steps = whole_number("num_timesteps", data["num_timesteps"], MAX_STEPS)
            notes = json.loads(archive.read(NOTES)) if NOTES in archive.namelist() else {}
            return SavedModel({**parameters}, {**(variables or {})}, steps, {**notes})
    except pickle.UnpicklingError:  # whose text advises to load without this safety
        raise ValueError(f"{path} is no Stable-Baselines3 model: it holds no tensors") from None
    except Exception as error:  # of a damaged file the parsers raise nearly every kind there is
        raise ValueError(f"{path} is no Stable-Baselines3 model: {one_line(error)}") from error


def load_policy(path: str | Path) -> BasePolicy:
    """Load a trained policy from a run's folder or a model's zip file, without running its code.

    A model that Stable-Baselines3 trained elsewhere takes a config.yml beside it that says how the
    policy is built: algo, env and policy, with hyperparameters' use_sde and policy_kwargs where
    they are not the library's own.

    Raises ValueError: no such model or a damaged one, or no config.yml, or one that is not allowed
    (see :class:`jansen_env.sb3.run_config.RunConfig`) or describes other weights.
    """
    path = Path(path)
    if path.is_dir():
        path = path / "best_model.zip"
    if not path.is_file():
        raise ValueError(f"no model at {path}")
    source = find_config(path)
    config = load_config(source)
    make: Any = ALGORITHMS[config.algo].policy_aliases[config.policy]
    arguments = {"use_sde": config.hyperparameters.get("use_sde", False),
                 "lr_schedule": lambda _: 0.0}  # fmt: skip # not used
    known = {k: v for k, v in arguments.items() if k in inspect.signature(make).parameters}
    fitting = named_errors(source, AssertionError, TypeError)  # of arguments to one another
    with fitting, closing(make_env(config.env, config.env_kwargs)) as env:
        policy: BasePolicy = make(
            env.observation_space, env.action_space, **known, **policy_kwargs_of(config)
        )
    policy.set_training_mode(False)
    model = read_model(path)
    if not model.notes:  # those of train.py have some
        check_not_normalized(path)
    weights = model.parameters.get("policy", {})
    with named_errors(f"{path} does not fit {source}", Exception):  # torch raises most kinds
        check_shapes(policy.state_dict(), weights)
        policy.load_state_dict(weights)
    if not all(tensor.isfinite().all() for tensor in policy.state_dict().values()):
        raise ValueError(f"{path} has weights that are not finite")
    return policy


def check_shapes(needed: Arguments, found: Arguments) -> None:
    """Check that a model's file has the tensors that its configuration builds.

    Raises ValueError: it has others; names the first one, and the units of the layers it found.
    """
    absent, more = sorted(needed.keys() - found.keys()), sorted(found.keys() - needed.keys())
    if absent or more:
        parts = [f"it lacks {len(absent)} tensors, such as {absent[0]}"] if absent else []
        parts += [f"it has {len(more)} others, such as {more[0]}"] if more else []
        raise ValueError(
            f"{'; '.join(parts)}. algo, policy and policy_kwargs must be those of the training"
        )
    for name, tensor in needed.items():
        if tuple(found[name].shape) != tuple(tensor.shape):
            raise ValueError(
                f"{name} must have the shape {tuple(tensor.shape)}, got "
                f"{tuple(found[name].shape)}. policy_kwargs.net_arch and env must be those of the "
                f"training; the file has hidden layers of {_hidden_units(found)} units"
            )


def _hidden_units(weights: Arguments) -> list[int]:
    """Return the units of the hidden layers of a policy's network."""
    hidden = ("mlp_extractor.policy_net.", "actor.latent_pi.")
    return [
        tensor.shape[0]
        for name, tensor in weights.items()
        if name.startswith(hidden) and name.endswith("weight")
    ]


def check_not_normalized(path: Path) -> None:
    """Check that a model was not trained under Stable-Baselines3's VecNormalize.

    A model's file has no statistics of observations, so that its policy would see numbers of
    another size. They lie beside it as a pickle, which is not read here: it could run code.

    Raises ValueError: a file of such statistics lies beside the model or in the folder above, or
    the model's file has kept observations that were not normalised.
    """
    places = [place for folder in (path.parent, path.parent.parent)
              for place in sorted(folder.glob("*normalize*.pkl"))]  # fmt: skip
    with zipfile.ZipFile(path) as archive, suppress(KeyError, ValueError, RecursionError):
        data = json.loads(archive.read("data"))
        kept = data.get("_last_original_obs") if isinstance(data, dict) else None
        places += [] if kept is None else [path]
    if places:
        raise ValueError(
            f"{path} was trained with VecNormalize (see {places[0]}), whose statistics are a "
            "pickle and are not read here. Score it in Python: docs/training.md, 'Models with "
            "VecNormalize'"
        )


def policy_kwargs_of(config: RunConfig) -> Arguments:
    """Return ``policy_kwargs`` with names turned into classes."""
    arguments = dict(config.policy_kwargs)
    if "activation" in arguments:
        arguments["activation_fn"] = ACTIVATIONS[arguments.pop("activation")]
    harmonics, half_turn = arguments.pop("harmonics", 0), arguments.pop("half_turn", False)
    if arguments.pop("normalize", False):
        arguments["features_extractor_class"] = NormalizedObservation
        image = half_turn_image(config) if half_turn else None
        arguments["features_extractor_kwargs"] = {"harmonics": harmonics, "image": image}
    return arguments


def half_turn_image(config: RunConfig) -> Array:
    """Matrix (d, d) that turns the crank of an observation (d,) by half a turn and exchanges the
    toes of the two crank pins: the machine is the same, so that the same torque is due. The
    identity for a robot with a leg that has no other half a turn on.
    """
    with closing(make_env(config.env, config.env_kwargs)) as made:
        env: Any = made.unwrapped
        places = {entry.name: place for place, entry in enumerate(env.observed)}
        robot = env.robot
    image = np.eye(len(places))
    for name in ("cos_crank_angle", "sin_crank_angle"):
        image[places[name], places[name]] = -1.0
    for toe, (leg, joint) in enumerate(robot.toes):
        others = [
            other for other, (of, at) in enumerate(robot.toes)
            if at == joint and robot.legs[of].side == robot.legs[leg].side
            and math.isclose(math.cos(robot.legs[of].phase - robot.legs[leg].phase), -1.0)
        ]  # fmt: skip
        if not others:
            return np.eye(len(places))
        if (row := places.get(f"toe_load_{toe}")) is not None:
            image[row] = np.eye(len(places))[places[f"toe_load_{others[0]}"]]
    return image


class NormalizedObservation(BaseFeaturesExtractor):
    """(observation - mean) / standard deviation, clipped; statistics are part of the state dict,
    and change only in :meth:`update`.

    Of observations that begin with cos and sin of the crank angle psi, ``harmonics`` many cos 2 k
    psi, sin 2 k psi are appended: the torque that is due repeats after half a turn of the crank.
    With the ``image`` of :func:`half_turn_image` all features repeat, exactly.
    """

    mean: torch.Tensor
    variance: torch.Tensor
    count: torch.Tensor
    image: torch.Tensor | None

    def __init__(
        self, observation_space: gym.spaces.Box, harmonics: int = 0, image: Array | None = None
    ) -> None:
        size = gym.spaces.utils.flatdim(observation_space)
        super().__init__(observation_space, size + 2 * harmonics)
        self.harmonics = harmonics
        self.register_buffer("mean", torch.zeros(size))
        self.register_buffer("variance", torch.ones(size))
        self.register_buffer("count", torch.tensor(0.0))
        matrix = None if image is None else torch.from_numpy(image).float()
        self.register_buffer("image", matrix, persistent=False)

    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Return features (n, d + 2 m) of observations (n, d)."""
        observation = observation.flatten(1)
        deviation = torch.sqrt(self.variance).clamp(min=MIN_DEVIATION)
        scaled = torch.clamp((observation - self.mean) / deviation, -CLIP, CLIP)
        features = [scaled if self.image is None else 0.5 * (scaled + scaled @ self.image)]
        cos, sin = observation[:, 0:1], observation[:, 1:2]  # of psi
        cos_2, sin_2 = cos**2 - sin**2, 2.0 * sin * cos
        cos, sin = torch.ones_like(cos), torch.zeros_like(sin)
        for _ in range(self.harmonics):  # by adding angles
            cos, sin = cos * cos_2 - sin * sin_2, sin * cos_2 + cos * sin_2
            features += [cos, sin]
        return torch.cat(features, dim=1)

    @torch.no_grad()
    def update(self, observations: torch.Tensor) -> None:
        """Take (n, d) more observations into account (Chan's parallel variance)."""
        if self.image is not None:
            observations = torch.cat([observations, observations @ self.image])
        n = float(len(observations))
        total = self.count + n
        shift = observations.mean(0) - self.mean
        spread = self.variance * self.count + observations.var(0, unbiased=False) * n
        spread += shift**2 * self.count * n / total
        self.mean += shift * n / total
        self.variance.copy_(spread / total)
        self.count.copy_(total)
