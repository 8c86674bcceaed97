"""Trained policies, built from a configuration.

The file of a model only provides tensors; no code in it is run.
"""

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
from typing_extensions import override

from jansen_env.arrays import Array
from jansen_env.checks import named_errors, one_line, whole_number
from jansen_env.files import open_regular
from jansen_env.sb3.run_config import ALGORITHMS, Arguments, RunConfig, find_config, load_config
from jansen_env.scoring.rollout import make_env

ACTIVATIONS = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU, "elu": torch.nn.ELU}
# Largest size of an unpacked model file. Models of the configurations in this package are about
# 0.2 MB in size.
MAX_BYTES = 2**28
MAX_STEPS = 10**12  # largest number of time steps of a model's training
CLIP = 10.0  # largest magnitude of a normalised observation, in standard deviations
# Smallest standard deviation by which observations are divided. A smaller one would amplify
# observations that hardly vary, and their rounding errors, up to the clip.
MIN_DEVIATION = 1e-3
NOTES = "notes.json"  # member of a model file that this package adds to those of Stable-Baselines3


class SavedModel(NamedTuple):
    """Content of a model file.

    Attributes:
        parameters: State dicts of the modules and optimisers, by name.
        variables: Other tensors, such as the entropy coefficient of SAC, by name.
        steps: Number of time steps of the training.
        notes: Notes that ``train.py`` added to the file, by name.
    """

    parameters: Arguments
    variables: Arguments
    steps: int
    notes: Arguments


def read_model(path: str | Path) -> SavedModel:
    """Read a model from a zip file of Stable-Baselines3.

    Tensors are read by ``torch.load(weights_only=True)``, and all other data as JSON. The pickles
    that Stable-Baselines3 also writes are not read.

    Args:
        path: Path of the zip file.

    Raises:
        ValueError: If there is no such file, if it is damaged, or if it unpacks to more than
            :data:`MAX_BYTES`.
    """
    try:
        with open_regular(path) as file, zipfile.ZipFile(file) as archive:
            size = sum(member.file_size for member in archive.infolist())
            if size > MAX_BYTES:
                raise ValueError(f"it must unpack to at most {MAX_BYTES} bytes, got {size}")
            _, parameters, variables = load_from_zip_file(file, load_data=False, device="cpu")
            data = json.loads(archive.read("data"))
            steps = whole_number("num_timesteps", data["num_timesteps"], MAX_STEPS)
            notes = json.loads(archive.read(NOTES)) if NOTES in archive.namelist() else {}
            return SavedModel({**parameters}, {**(variables or {})}, steps, {**notes})
    except pickle.UnpicklingError:  # its message advises to load the file without this protection
        raise ValueError(f"{path} is not a Stable-Baselines3 model: it has no tensors") from None
    except Exception as error:  # a damaged file can make the parsers raise nearly any exception
        raise ValueError(f"{path} is not a Stable-Baselines3 model: {one_line(error)}") from error


def load_policy(path: str | Path) -> BasePolicy:
    """Load a trained policy, without running code from its file.

    A model that was trained elsewhere with Stable-Baselines3 needs a config.yml in the same folder
    that describes how the policy is built: algo, env and policy. If use_sde (in hyperparameters) or
    policy_kwargs differ from the defaults of the library, the file also contains these.

    Args:
        path: Folder of a training run, or zip file of a model.

    Raises:
        ValueError: If there is no such model or it is damaged, or if there is no config.yml, its
            content is not allowed (see :class:`jansen_env.sb3.run_config.RunConfig`), or it
            describes other weights.
    """
    path = Path(path)
    if path.is_dir():
        path = path / "best_model.zip"
    if not path.is_file():
        raise ValueError(f"{path} must be the file of a model, got no such file")
    source = find_config(path)
    config = load_config(source)
    make: Any = ALGORITHMS[config.algo].policy_aliases[config.policy]
    arguments = {
        "use_sde": config.hyperparameters.get("use_sde", False),
        "lr_schedule": lambda _: 0.0,  # required, but only used for training
    }
    known = {k: v for k, v in arguments.items() if k in inspect.signature(make).parameters}
    fitting = named_errors(source, AssertionError, TypeError)  # if arguments do not fit together
    with fitting, closing(make_env(config.env, config.env_kwargs)) as env:
        policy: BasePolicy = make(
            env.observation_space, env.action_space, **known, **policy_kwargs_of(config)
        )
    policy.set_training_mode(False)
    model = read_model(path)
    if not model.notes:  # models of train.py have notes, and are never trained with VecNormalize
        check_not_normalized(path)
    weights = model.parameters.get("policy", {})
    with named_errors(f"{path} does not fit {source}", Exception):  # torch raises many types
        check_shapes(policy.state_dict(), weights)
        policy.load_state_dict(weights)
    if not all(tensor.isfinite().all() for tensor in policy.state_dict().values()):
        raise ValueError(f"the weights in {path} must be finite, got NaN or infinity")
    return policy


def check_shapes(needed: Arguments, found: Arguments) -> None:
    """Check that a model file contains the tensors that its configuration describes.

    Args:
        needed: Tensors of the policy that the configuration builds, by name.
        found: Tensors of the model file, by name.

    Raises:
        ValueError: If the tensors differ. The message names the first tensor that differs. If its
            shape differs, the message also contains the units of the hidden layers in the file.
    """
    absent = sorted(needed.keys() - found.keys())
    more = sorted(found.keys() - needed.keys())
    if absent or more:
        parts = [f"one without {len(absent)} of these, such as {absent[0]}"] if absent else []
        parts += [f"one with {len(more)} other tensors, such as {more[0]}"] if more else []
        raise ValueError(
            f"the model must have the {len(needed)} tensors of its configuration, got "
            f"{' and '.join(parts)}; algo, policy and policy_kwargs must be those of the training"
        )
    for name, tensor in needed.items():
        if tuple(found[name].shape) != tuple(tensor.shape):
            raise ValueError(
                f"{name} must have the shape {tuple(tensor.shape)}, got "
                f"{tuple(found[name].shape)}; policy_kwargs.net_arch and env must be those of the "
                f"training, in which the hidden layers had {_hidden_units(found)} units"
            )


def _hidden_units(weights: Arguments) -> list[int]:
    """Return the number of units of each hidden layer of a policy network."""
    hidden = ("mlp_extractor.policy_net.", "actor.latent_pi.")
    return [
        tensor.shape[0]
        for name, tensor in weights.items()
        if name.startswith(hidden) and name.endswith("weight")
    ]


def check_not_normalized(path: Path) -> None:
    """Check that a model was not trained with ``VecNormalize`` of Stable-Baselines3.

    The file of such a model does not contain the statistics of the observations, so its policy
    would get observations of a different magnitude. The statistics are in a pickle next to the
    model. This pickle is not read here, because a pickle can run code.

    Args:
        path: Path of the model file.

    Raises:
        ValueError: If there is a file of such statistics next to the model or in the folder above,
            or if the model file contains observations from before a normalisation.
    """
    places = [
        place
        for folder in (path.parent, path.parent.parent)
        for place in sorted(folder.glob("*normalize*.pkl"))
    ]
    with zipfile.ZipFile(path) as archive, suppress(KeyError, ValueError, RecursionError):
        data = json.loads(archive.read("data"))
        kept = data.get("_last_original_obs") if isinstance(data, dict) else None
        places += [] if kept is None else [path]
    if places:
        raise ValueError(
            f"{path} must be a model without VecNormalize, got one that was trained with "
            f"VecNormalize (see {places[0]}); its statistics are in a pickle, which is not read "
            "here. To score the model in Python, see docs/training.md, 'Models with VecNormalize'"
        )


def policy_kwargs_of(config: RunConfig) -> Arguments:
    """Return the ``policy_kwargs`` of a configuration, with classes in place of their names."""
    arguments = dict(config.policy_kwargs)
    if "activation" in arguments:
        arguments["activation_fn"] = ACTIVATIONS[arguments.pop("activation")]
    harmonics = arguments.pop("harmonics", 0)
    half_turn = arguments.pop("half_turn", False)
    if arguments.pop("normalize", False):
        arguments["features_extractor_class"] = NormalizedObservation
        image = half_turn_image(config) if half_turn else None
        arguments["features_extractor_kwargs"] = {"harmonics": harmonics, "image": image}
    return arguments


def half_turn_image(config: RunConfig) -> Array:
    """Return the matrix that maps an observation to the one after half a turn of the crank.

    The matrix reverses the direction of the crank in an observation, shape (d,), and exchanges the
    toes of the two crank pins. The robot is then in the same configuration as before, so the same
    torque is required.

    Args:
        config: Configuration of a training run, which names the environment.

    Returns:
        The matrix, shape (d, d). It is the identity if a leg of the robot has no counterpart half a
            turn away.
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
            other
            for other, (of, at) in enumerate(robot.toes)
            if at == joint
            and robot.legs[of].side == robot.legs[leg].side
            and math.isclose(math.cos(robot.legs[of].phase - robot.legs[leg].phase), -1.0)
        ]
        if not others:
            return np.eye(len(places))
        if (row := places.get(f"toe_load_{toe}")) is not None:
            image[row] = np.eye(len(places))[places[f"toe_load_{others[0]}"]]
    return image


class NormalizedObservation(BaseFeaturesExtractor):
    """Features extractor that normalises observations and can add harmonics of the crank angle.

    A normalised observation is (observation - mean) / standard deviation, clipped. The statistics
    are part of the state dict, and change only in :meth:`update`.

    If ``harmonics`` is above 0, cos 2 k psi and sin 2 k psi are appended for k = 1 ..
    ``harmonics``, because the required torque repeats after half a turn of the crank. The
    observation must then begin with the cosine and sine of the crank angle psi. With the matrix of
    :func:`half_turn_image`, all features repeat exactly.

    Args:
        observation_space: Space of the observations.
        harmonics: Number of harmonics.
        image: Matrix of :func:`half_turn_image`, shape (d, d). None to leave the normalised
            observations as they are.
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

    @override
    def forward(self, observation: torch.Tensor) -> torch.Tensor:
        """Return the features of observations.

        Args:
            observation: Observations, shape (n, d).

        Returns:
            The features, shape (n, d + 2 m), with m harmonics.
        """
        observation = observation.flatten(1)
        deviation = torch.sqrt(self.variance).clamp(min=MIN_DEVIATION)
        scaled = torch.clamp((observation - self.mean) / deviation, -CLIP, CLIP)
        features = [scaled if self.image is None else 0.5 * (scaled + scaled @ self.image)]
        cos, sin = observation[:, 0:1], observation[:, 1:2]  # of the angle psi
        cos_2, sin_2 = cos**2 - sin**2, 2.0 * sin * cos
        cos, sin = torch.ones_like(cos), torch.zeros_like(sin)
        for _ in range(self.harmonics):  # add 2 psi to the angle in each pass
            cos, sin = cos * cos_2 - sin * sin_2, sin * cos_2 + cos * sin_2
            features += [cos, sin]
        return torch.cat(features, dim=1)

    @torch.no_grad()
    def update(self, observations: torch.Tensor) -> None:
        """Update the statistics with further observations (Chan's parallel variance).

        Args:
            observations: The observations, shape (n, d).
        """
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
