"""Pretrained policies that come with the package. They need only NumPy to run.

A policy consists of two files that contain no code. ``ENV_ID/NAME.json`` describes what the policy
observes, how its network is built and was trained, and its scores. ``NAME.safetensors`` contains
the weights. ``docs/policies.md`` describes the format, and ``python -m agents.pack`` writes it.
"""

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from copy import copy
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import load_env_creator
from numpy.typing import ArrayLike, NDArray
from safetensors.numpy import load as read_tensors

from jansen_env.arrays import Array
from jansen_env.checks import (
    MOST_SINGLE,
    instance,
    invalid,
    one_of,
    positive_single,
    shown,
    whole_number,
    within,
)
from jansen_env.engine.layers import (
    ELU,
    LINEAR,
    RELU,
    TANH,
    put_actions,
    put_commands,
    put_harmonics,
    put_normalized,
)
from jansen_env.files import read_bounded
from jansen_env.plants.plant import plant_time_step
from jansen_env.registration import IDS
from jansen_env.world.settings import control_period

FORMAT = "jansen_env policy 1"
ENTRIES = (
    "format",
    "env",
    "observation",
    "action",
    "network",
    "training",
    "versions",
    "scores",
    "sha256",
)
POLICIES = Path(__file__).parent
DEFAULT = "ppo"  # name of the policy that is used if the user names none
MAX_BYTES = 2**20  # largest size of a file; the files of the package are smaller than 650 kB
SHORTEST_PERIOD, LONGEST_PERIOD = 1e-4, 1.0  # limits of the control period, in s
MOST_TIME_STEPS = 200_000  # largest number of time steps of an episode; walkers have 10,000

Tensors = dict[str, NDArray[Any]]
Json = dict[str, Any]  # a JSON object

CRANK_ANGLE = ("cos_crank_angle", "sin_crank_angle")

ACTIVATIONS: dict[str | None, int] = {"tanh": TANH, "relu": RELU, "elu": ELU, None: LINEAR}
SQUASH = {"clip": LINEAR, "tanh": TANH}


class Plain(NamedTuple):
    """Features that are the observations themselves.

    Attributes:
        size: Number of observations.
    """

    size: int

    def __call__(self, seen: Array) -> Array:
        """Return the observations, shape (n, size)."""
        return seen


class Normalized(NamedTuple):
    """Normalised observations: clip((observation - mean) / deviation, -clip, clip).

    Attributes:
        mean: Mean of each observation, shape (size,).
        deviation: Standard deviation of each observation, shape (size,).
        clip: Largest magnitude of a feature.
    """

    mean: Array
    deviation: Array
    clip: float

    @property
    def size(self) -> int:
        """Number of features."""
        return len(self.mean)

    def __call__(self, seen: Array) -> Array:
        """Return the features of observations, both with shape (n, size)."""
        out = np.empty((len(seen), self.size))
        put_normalized(np.ascontiguousarray(seen), self.mean, self.deviation, self.clip, out)
        return out


class Harmonics(NamedTuple):
    """Harmonics of the crank angle: cos k psi and sin k psi for each multiple k.

    The first two observations are the cosine and the sine of the crank angle psi.

    Attributes:
        multiples: The multiples k.
    """

    multiples: tuple[int, ...]

    @property
    def size(self) -> int:
        """Number of features."""
        return 2 * len(self.multiples)

    def __call__(self, seen: Array) -> Array:
        """Return the features, shape (n, size), of observations, shape (n, d)."""
        out = np.empty((len(seen), self.size))
        put_harmonics(np.ascontiguousarray(seen[:, :2]), np.array(self.multiples, np.int64), out)
        return out


Features: TypeAlias = Plain | Normalized | Harmonics


class Layer(NamedTuple):
    """Layer of a network, which computes activation(weight x + bias).

    Attributes:
        weight: Weights, shape (units, inputs).
        bias: Biases, shape (units,).
        activation: Name of the activation function in ``ACTIVATIONS``. None for a linear layer.
    """

    weight: Array
    bias: Array
    activation: str | None


class Network:
    """Function of inputs, shape (n, width), that applies all layers of a network.

    The result of a row does not depend on the other rows.

    Args:
        layers: At least one layer.
        limit: Largest magnitude of the output of the last layer.
        squash: Name of the function that is applied to the limited output, in :data:`SQUASH`.

    Attributes:
        layers: The layers in the format of :func:`jansen_env.engine.layers.put_actions`.
        weights: The weights in the format of :func:`jansen_env.engine.layers.put_actions`.
    """

    def __init__(self, layers: Sequence[Layer], limit: float, squash: str) -> None:
        sizes = [(*layer.weight.T.shape, ACTIVATIONS[layer.activation]) for layer in layers]
        parts = [part for layer in layers for part in (layer.weight.T.ravel(), layer.bias)]
        self.layers = np.array(sizes, np.int64)
        self.weights = np.concatenate(parts)
        self._limit = limit
        self._squash = SQUASH[squash]
        self._widest = self.layers[:, :2].max()

    def __call__(self, inputs: Array) -> Array:
        """Return the outputs, shape (n, units of the last layer), of inputs, shape (n, width)."""
        out = np.empty((len(inputs), self.layers[-1, 1]))
        work = np.empty((2, self._widest))
        put_actions(inputs, self.layers, self.weights, self._limit, self._squash, work, out)
        return out


class PretrainedPolicy:
    """Pretrained policy, whose actions are those of the trained network without noise.

    The network applies its features side by side, the layers, the limit and ``squash``, in this
    order. Its output is clipped to -1 .. 1. It is the torque as a fraction of the torque limit.

    Args:
        description: Content of the JSON file.
        tensors: Content of the file of tensors.

    Attributes:
        env_id: Id of the environment on which the policy was trained.
        env_kwargs: Arguments of this environment.
        observed: Names of the numbers that the policy observes, in order.
        units: Units of these numbers.
        torque_limit: Torque of the action 1, in N m.
        control_dt: Duration for which an action is held, in s.
        scale: Mean and standard deviation of each observation in training. They are 0 and 1 if the
            policy does not contain them.
        features: Functions that compute the inputs of the network from the observations.
        layers: Layers of the network.
        limit: Largest magnitude of the output of the layers.
        squash: Name of the function that is applied to the limited output.

    Raises:
        ValueError: If an entry of the description is missing or not allowed, does not fit the
            tensors or the environment, or is outside the range of float32, in which C code may
            compute.
    """

    def __init__(self, description: Json, tensors: Tensors) -> None:
        instance("the whole", description, dict)
        if (given := description.get("format")) != FORMAT:
            raise ValueError(f"format must be {FORMAT!r}, got {shown(given)}")
        if unknown := sorted({*description} - {*ENTRIES}):
            raise invalid("an entry of the policy", unknown[0], f"one of {list(ENTRIES)}")
        self.description = description
        self.tensors = tensors
        for name, tensor in tensors.items():
            if tensor.dtype != np.float32:
                raise ValueError(f"tensor {name!r} must have the type float32, got {tensor.dtype}")
            if (wrong := tensor[~np.isfinite(tensor)]).size:
                raise ValueError(f"tensor {name!r} must contain finite numbers, got {wrong[0]}")
        env = _entry(description, "env", dict)
        action = _entry(description, "action", dict)
        network = _entry(description, "network", dict)
        self.env_id: str = _entry(env, "id", str)
        self.env_kwargs: Json = _entry(env, "kwargs", dict)
        self.torque_limit = positive_single("torque_limit", action.get("torque_limit"))
        self.control_dt = positive_single("control_dt", action.get("control_dt"))
        check_action(self.env_id, self.env_kwargs, self.torque_limit, self.control_dt)
        observation = _entry(description, "observation", list)
        self.observed = tuple(_entry(entry, "name", str) for entry in observation)
        self.units = tuple(_entry(entry, "unit", str) for entry in observation)
        self._columns = [*range(len(observation))]
        self._shown = len(observation)
        self.scale: tuple[Array | float, Array | float] = (0.0, 1.0)
        self.features = [*map(self._feature, _entry(network, "features", list))]
        width = sum(block.size for block in self.features)
        if width == 0:
            raise ValueError("network.features must have at least one number, got none")
        self.layers: list[Layer] = []
        for layer in _entry(network, "layers", list):
            units = whole_number("units", instance("a layer", layer, dict).get("units"), least=1)
            activation = one_of("activation", layer.get("activation"), ACTIVATIONS)
            weight = self._tensor(layer, "weight", (units, width))
            self.layers.append(Layer(weight, self._tensor(layer, "bias", (units,)), activation))
            width = units
        if width != 1 or not self.layers:
            raise ValueError(f"the last layer must have 1 unit, the action, got {width}")
        self.limit = np.inf if (m := network.get("limit")) is None else positive_single("limit", m)
        self.squash: str = one_of("squash", network.get("squash"), SQUASH)
        self.network = Network(self.layers, self.limit, self.squash)

    def _feature(self, block: Json) -> Features:
        """Return a function that computes a part of the network's inputs from observations.

        Args:
            block: Description of this part.
        """
        instance("a block of features", block, dict)
        size = len(self.observed)
        kinds = ("observation", "normalized", "harmonics")
        kind = one_of("kind of features", block.get("kind"), kinds)
        if kind == "observation":
            return Plain(size)
        if kind == "harmonics":
            if self.observed[:2] != CRANK_ANGLE:
                raise ValueError(
                    f"the first observations must be {list(CRANK_ANGLE)} for features of the kind "
                    f"'harmonics', got {shown(self.observed[:2])}"
                )
            multiples = _entry(block, "multiples", list)
            return Harmonics(tuple(whole_number("a multiple", m, 1000) for m in multiples))
        mean = self._tensor(block, "mean", (size,))
        variance = self._tensor(block, "variance", (size,))
        if variance.min() < 0.0:
            raise ValueError(f"a variance must be 0 or above, got {variance.min()}")
        floor = positive_single("floor", block.get("floor"))
        clip = positive_single("clip", block.get("clip"))
        self.scale = mean, np.maximum(np.sqrt(variance), floor)
        return Normalized(*self.scale, clip)

    def _tensor(self, part: Json, key: str, shape: tuple[int, ...]) -> Array:
        """Return the tensor that ``part[key]`` names, after checking its shape."""
        name = _entry(part, key, str)
        if name not in self.tensors:
            raise invalid(key, name, f"one of the tensors {shown(sorted(self.tensors))}")
        if (given := self.tensors[name].shape) != shape:
            raise ValueError(f"tensor {name!r} must have the shape {shape}, got {given}")
        return self.tensors[name].astype(np.float64)

    def on(self, env: Any) -> "PretrainedPolicy":
        """Return this policy for an environment, whose observation may contain further numbers.

        The numbers that the policy observes are found by name.

        Args:
            env: Environment of one robot or of many robots.

        Raises:
            ValueError: If the observation lacks a number that the policy observes, or if the robot
                has another number of toes.
        """
        names = [entry.name for entry in env.unwrapped.observed]
        if missing := [name for name in self.observed if name not in names]:
            raise ValueError(
                f"the policy of {self.env_id} must observe only numbers of this environment, "
                f"{names}, got {missing[0]}"
            )
        if more := [n for n in names if n.startswith("toe_load_") and n not in self.observed]:
            raise ValueError(
                f"the policy of {self.env_id} must observe all toe loads of this environment, got "
                f"a policy without {more[0]}, which was trained on a robot with fewer toes"
            )
        policy = copy(self)
        policy._columns = [names.index(name) for name in self.observed]
        policy._shown = len(names)
        return policy

    def predict(
        self,
        observation: ArrayLike,
        state: Any = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = False,
    ) -> tuple[NDArray[np.float32], Any]:
        """Return the actions for observations, and the unchanged state.

        A row of an observation contains the d numbers in :attr:`observed`. For a policy that
        :meth:`on` returns, it contains the d numbers that the environment observes. The actions are
        computed in float64. They are the same on every processor, and do not depend on the other
        rows.

        Args:
            observation: Observations of n robots, shape (n, d), or of one robot, shape (d,).
            state: Returned unchanged.
            episode_start: Has no effect.
            deterministic: Has no effect: the actions never contain noise.

        Returns:
            The actions, shape (n, 1) or (1,), and the state.

        Raises:
            ValueError: If the observations have another shape, if a number that the network
                observes is not a finite float32 number, or if an action is not finite.
        """
        x = np.asarray(observation, dtype=np.float64)
        size = self._shown
        if x.ndim not in (1, 2) or x.shape[-1] != size:
            allowed = f"({size},) or (n, {size})"
            raise ValueError(f"observation must have the shape {allowed}, got {x.shape}")
        batch = np.take(x.reshape(-1, size), self._columns, axis=1)
        if not (np.abs(batch) <= MOST_SINGLE).all():
            raise self._unusable(batch)
        outputs = self.network(np.concatenate([part(batch) for part in self.features], axis=1))
        actions = np.empty(outputs.shape, np.float32)
        put_commands(outputs.ravel(), 1.0, actions.reshape(-1))
        if not np.isfinite(actions).all():
            raise ValueError("action must be finite, got nan: an observation is far out of range")
        return (actions if x.ndim == 2 else actions[0]), state

    def _unusable(self, batch: Array) -> ValueError:
        """Return the error for observations, shape (n, d), with a number that is not usable.

        Such a number is not finite, or outside the range of float32.
        """
        row, column = np.argwhere(~(np.abs(batch) <= MOST_SINGLE))[0].tolist()
        place = f" of row {row}" if len(batch) > 1 else ""
        return ValueError(
            f"observation {self.observed[column]}{place} must be a finite number within float32's "
            f"range, got {batch[row, column]}"
        )


def arguments_of(env_id: str) -> Json:
    """Return the default arguments of an environment of this package, and its time limit.

    Args:
        env_id: Id of the environment.

    Raises:
        ValueError: If the package has no environment with this id.
    """
    spec = gym.spec(one_of("env.id", env_id, sorted(IDS)))
    env: Any = load_env_creator(str(spec.entry_point))
    return {**env.defaults(), "max_episode_steps": spec.max_episode_steps}


def check_action(
    env_id: str, env_kwargs: Mapping[str, object], torque_limit: float, control_dt: float
) -> None:
    """Check that the torque limit and the control period of a policy fit its environment.

    Args:
        env_id: Id of the environment.
        env_kwargs: Arguments of the environment.
        torque_limit: Torque limit of the policy, in N m.
        control_dt: Control period of the policy, in s.

    Raises:
        ValueError: If they differ from those of the environment, if there is no such environment,
            if the period is out of range, or if an episode has no time limit or more than
            :data:`MOST_TIME_STEPS` time steps.
    """
    given = {**arguments_of(env_id), **env_kwargs}
    env: Any = load_env_creator(str(gym.registry[env_id].entry_point))
    driven = {name: given[name] for name in ("robot", "motor", "torque_limit")}
    robot = env.TASK.SETTINGS(**driven).make_robots()[0]
    plant = given.get("plant", "projection")  # the crank task has no choice
    default_step = plant_time_step(plant, given["time_step"], given.get("joint_play", 0.0))
    period, step = control_period(given["control_dt"], default_step)
    for name, value, needed in (
        ("torque_limit", torque_limit, robot.motor.torque_limit),
        ("control_dt", control_dt, within("control_dt", period, SHORTEST_PERIOD, LONGEST_PERIOD)),
    ):
        if not math.isclose(value, needed):
            raise ValueError(
                f"{name} must be {needed}, the value of {env_id} with env.kwargs, got {value}"
            )
    steps = whole_number("max_episode_steps", given["max_episode_steps"], least=1)
    if (count := steps * round(period / step)) > MOST_TIME_STEPS:
        raise ValueError(
            f"max_episode_steps must lead to at most {MOST_TIME_STEPS} time steps, got {steps} "
            f"with control_dt {period} and time_step {step}, which leads to {count}"
        )


def names(env_id: str) -> list[str]:
    """Return the names of the policies that come with the package for an environment.

    Args:
        env_id: Id of the environment.
    """
    known = {folder.name for folder in POLICIES.iterdir()}  # an id must not lead to other folders
    if not isinstance(env_id, str) or env_id not in known:
        return []
    return sorted(path.stem for path in (POLICIES / env_id).glob("*.json"))


def shipped(env_id: str, name: str = DEFAULT) -> Path:
    """Return the path of the JSON file of a pretrained policy.

    Args:
        env_id: Id of the environment.
        name: Name of the policy, one of :func:`names`.

    Raises:
        ValueError: If the environment has no policy of this name.
    """
    one_of("env_id", env_id, sorted(path.name for path in POLICIES.iterdir() if names(path.name)))
    one_of("policy", name, names(env_id))
    return POLICIES / env_id / f"{name}.json"


def load(env_id: str, name: str = DEFAULT) -> PretrainedPolicy:
    """Load a pretrained policy that comes with the package.

    Args:
        env_id: Id of the environment.
        name: Name of the policy, one of :func:`names`.

    Raises:
        ValueError: If the environment has no policy of this name.
    """
    return load_file(shipped(env_id, name))


def load_file(path: str | Path) -> PretrainedPolicy:
    """Load a policy from its JSON file and the .safetensors file of the same name.

    No code in these files is run.

    Args:
        path: Path of the JSON file.

    Raises:
        ValueError: If one of the files is missing, too large or damaged, or if they do not belong
            to the same policy.
    """
    path = Path(path)
    weights = path.with_suffix(".safetensors")
    try:
        description = json.loads(read_bounded(path, MAX_BYTES))
        content = read_bounded(weights, MAX_BYTES)
        try:
            tensors = read_tensors(content)
        except Exception as error:  # SafetensorError, or an error of NumPy about an unknown type
            raise ValueError(f"{weights} must be a file of tensors: {error}") from error
        policy = PretrainedPolicy(description, tensors)
        found = checksum(content)
        if (given := description.get("sha256")) != found:
            raise ValueError(
                f"sha256 must be that of {weights.name}, {found}, got {shown(given)}; the two "
                "files belong to different policies"
            )
    except (OSError, RecursionError, ValueError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"{path} must contain a policy: {reason}") from error
    return policy


def checksum(data: bytes) -> str:
    """Return the SHA-256 checksum, which tells whether two files belong together."""
    return hashlib.sha256(data).hexdigest()


def _entry(part: object, name: str, kind: type) -> Any:
    """Return ``part[name]``, after checking its type."""
    return instance(name, instance("an entry", part, dict).get(name), kind)
