"""Trained policies that come with the package: run with NumPy, nothing else.

A policy is two files without code: ``ENV_ID/NAME.json`` says what it observes, how its network is
built and trained, and what it scores; ``NAME.safetensors`` has the weights. ``docs/policies.md``
describes the format; ``python -m agents.pack`` writes it.
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
    one_of,
    positive_single,
    shown,
    whole_number,
    within,
)
from jansen_env.engine.layers import ELU, LINEAR, RELU, TANH, put_actions, put_harmonics
from jansen_env.files import read_bounded
from jansen_env.plants.plant import plant_time_step
from jansen_env.registration import IDS
from jansen_env.world.settings import control_period

FORMAT = "jansen_env policy 1"
ENTRIES = (
    "format", "env", "observation", "action", "network", "training", "versions", "scores", "sha256",
)  # fmt: skip
POLICIES = Path(__file__).parent
DEFAULT = "ppo"  # of the names of an environment's policies
MAX_BYTES = 2**20  # of a file; those of the package have less than 650 kB
SHORTEST_PERIOD, LONGEST_PERIOD = 1e-4, 1.0  # s, for which an action is held
MOST_TIME_STEPS = 200_000  # of an episode; walkers have 10,000 by default

Tensors = dict[str, NDArray[Any]]
Json = dict[str, Any]  # an object

CRANK_ANGLE = ("cos_crank_angle", "sin_crank_angle")

ACTIVATIONS: dict[str | None, int] = {"tanh": TANH, "relu": RELU, "elu": ELU, None: LINEAR}
SQUASH = {"clip": LINEAR, "tanh": TANH}


class Plain(NamedTuple):
    """Observations as they are; ``size``: how many numbers."""

    size: int

    def __call__(self, seen: Array) -> Array:
        return seen


class Normalized(NamedTuple):
    """clip((observation - mean) / deviation, -clip, clip) with mean, deviation (size,)."""

    mean: Array
    deviation: Array
    clip: float

    @property
    def size(self) -> int:
        return len(self.mean)

    def __call__(self, seen: Array) -> Array:
        return np.clip((seen - self.mean) / self.deviation, -self.clip, self.clip)


class Harmonics(NamedTuple):
    """cos k psi, sin k psi of each k of ``multiples``; psi is the crank angle, whose cosine and
    sine are the first two observations."""

    multiples: tuple[int, ...]

    @property
    def size(self) -> int:
        return 2 * len(self.multiples)

    def __call__(self, seen: Array) -> Array:
        out = np.empty((len(seen), self.size))
        put_harmonics(np.ascontiguousarray(seen[:, :2]), np.array(self.multiples, np.int64), out)
        return out


Features: TypeAlias = Plain | Normalized | Harmonics


class Layer(NamedTuple):
    """activation(weight x + bias)."""

    weight: Array  # (units, inputs)
    bias: Array  # (units,)
    activation: str | None  # in ACTIVATIONS


class Network:
    """Layers as one function of inputs (n, width), the same alone and among others.

    Args:
        layers: at least one; as an attribute, and ``weights``, as
            :func:`jansen_env.engine.layers.put_actions` takes them.
        limit: the most that the last may give. squash: one of :data:`SQUASH`.
    """

    def __init__(self, layers: Sequence[Layer], limit: float, squash: str) -> None:
        sizes = [(*layer.weight.T.shape, ACTIVATIONS[layer.activation]) for layer in layers]
        parts = [part for layer in layers for part in (layer.weight.T.ravel(), layer.bias)]
        self.layers, self.weights = np.array(sizes, np.int64), np.concatenate(parts)
        self._limit, self._squash, self._widest = limit, SQUASH[squash], self.layers[:, :2].max()

    def __call__(self, inputs: Array) -> Array:
        out, work = np.empty((len(inputs), self.layers[-1, 1])), np.empty((2, self._widest))
        put_actions(inputs, self.layers, self.weights, self._limit, self._squash, work, out)
        return out


class PretrainedPolicy:
    """A trained policy; its actions are those of the network it was trained as, without noise.

    Args:
        description: content of the JSON file. tensors: content of the other one.

    Attributes:
        env_id, env_kwargs: what it was trained on. observed, units: names and units of what it
            observes, in order. torque_limit: N m, of action 1. control_dt: s for which an action
            is held. scale: mean and standard deviation of each observation in training, 0 and 1
            where they are not kept.
        features, layers, limit, squash: the network, in this order: features side by side; layers;
            the most that their output may be; the function of that.
            Clipped to -1 .. 1: share of the torque limit.

    Raises ValueError: something in the description is missing or not allowed, does not fit the
    tensors or the environment, or is beyond float32, in which C may compute.
    """

    def __init__(self, description: Json, tensors: Tensors) -> None:
        instance("the whole", description, dict)
        if (given := description.get("format")) != FORMAT:
            raise ValueError(f"format must be {FORMAT!r}, got {shown(given)}")
        if unknown := sorted({*description} - {*ENTRIES}):
            raise ValueError(f"there are entries {shown(unknown)}, must be among {list(ENTRIES)}")
        self.description, self.tensors = description, tensors
        for name, tensor in tensors.items():
            if tensor.dtype != np.float32 or not np.isfinite(tensor).all():
                raise ValueError(f"tensor {name!r} must be of finite float32 numbers")
        env, action, network = (_entry(description, k, dict) for k in ("env", "action", "network"))
        self.env_id: str = _entry(env, "id", str)
        self.env_kwargs: Json = _entry(env, "kwargs", dict)
        self.torque_limit = positive_single("torque_limit", action.get("torque_limit"))
        self.control_dt = positive_single("control_dt", action.get("control_dt"))
        check_action(self.env_id, self.env_kwargs, self.torque_limit, self.control_dt)
        observation = _entry(description, "observation", list)
        self.observed = tuple(_entry(entry, "name", str) for entry in observation)
        self.units = tuple(_entry(entry, "unit", str) for entry in observation)
        self._columns, self._shown = [*range(len(observation))], len(observation)
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
        """Return a part of the network's input as a function of observations (n, d)."""
        instance("a block of features", block, dict)
        size, kinds = len(self.observed), ("observation", "normalized", "harmonics")
        kind = one_of("kind of features", block.get("kind"), kinds)
        if kind == "observation":
            return Plain(size)
        if kind == "harmonics":
            if self.observed[:2] != CRANK_ANGLE:
                raise ValueError(f"harmonics take the first observations {list(CRANK_ANGLE)}")
            multiples = _entry(block, "multiples", list)
            return Harmonics(tuple(whole_number("a multiple", m, 1000) for m in multiples))
        mean, variance = (self._tensor(block, k, (size,)) for k in ("mean", "variance"))
        if variance.min() < 0.0:
            raise ValueError(f"a variance must be 0 or above, got {variance.min()}")
        floor, clip = (positive_single(k, block.get(k)) for k in ("floor", "clip"))
        self.scale = mean, np.maximum(np.sqrt(variance), floor)
        return Normalized(*self.scale, clip)

    def _tensor(self, part: Json, key: str, shape: tuple[int, ...]) -> Array:
        """Return the tensor that ``part`` names, of this shape."""
        name = _entry(part, key, str)
        if name not in self.tensors:
            raise ValueError(f"there is no tensor {shown(name)}")
        if (given := self.tensors[name].shape) != shape:
            raise ValueError(f"tensor {name!r} must have the shape {shape}, got {given}")
        return self.tensors[name].astype(np.float64)

    def on(self, env: Any) -> "PretrainedPolicy":
        """Return this policy for an environment, of one robot or many, that may show more; columns
        are found by name.

        Raises ValueError: the environment does not show all that the policy observes, or its robot
        has another number of toes.
        """
        names = [entry.name for entry in env.unwrapped.observed]
        if missing := [name for name in self.observed if name not in names]:
            raise ValueError(
                f"the policy of {self.env_id} observes {missing[0]}, must be one of {names}, which "
                "this environment shows"
            )
        if more := [n for n in names if n.startswith("toe_load_") and n not in self.observed]:
            raise ValueError(
                f"this environment shows {more[0]}, which the policy of {self.env_id} does not "
                "observe: it has learnt on a robot with fewer toes"
            )
        policy = copy(self)
        policy._columns, policy._shown = [names.index(name) for name in self.observed], len(names)
        return policy

    def predict(
        self,
        observation: ArrayLike,
        state: Any = None,
        episode_start: ArrayLike | None = None,
        deterministic: bool = False,
    ) -> tuple[NDArray[np.float32], Any]:
        """Return actions (n, 1) or (1,) for observations (n, d) or (d,), and the state as given.

        d: as many as are :attr:`observed`, or as the environment shows that was given to
        :meth:`on`. Computed in float64, the same on every processor, alone and among others;
        without noise, whatever ``deterministic`` says.

        Raises ValueError: observations of another size, or an observation that the network observes
        is not a finite float32 number, or no finite action follows from it.
        """
        x, size = np.asarray(observation, dtype=np.float64), self._shown
        if x.ndim not in (1, 2) or x.shape[-1] != size:
            allowed = f"({size},) or (n, {size})"
            raise ValueError(f"observation must have the shape {allowed}, got {x.shape}")
        batch = np.take(x.reshape(-1, size), self._columns, axis=1)
        if not (np.abs(batch) <= MOST_SINGLE).all():
            raise self._unusable(batch)
        outputs = self.network(np.concatenate([part(batch) for part in self.features], axis=1))
        actions = np.clip(outputs, -1.0, 1.0).astype(np.float32)
        if not np.isfinite(actions).all():
            raise ValueError("action must be finite, got nan: an observation is far out of range")
        return (actions if x.ndim == 2 else actions[0]), state

    def _unusable(self, batch: Array) -> ValueError:
        """Return the error for observations (n, d) with a number that is not finite."""
        row, column = np.argwhere(~(np.abs(batch) <= MOST_SINGLE))[0].tolist()
        place = f" of row {row}" if len(batch) > 1 else ""
        return ValueError(
            f"observation {self.observed[column]}{place} must be a finite number within float32's "
            f"range, got {batch[row, column]}"
        )


def arguments_of(env_id: str) -> Json:
    """Return the default arguments of an environment of this package, and its time limit.

    Raises ValueError: the package has no environment of this id.
    """
    spec = gym.spec(one_of("env.id", env_id, sorted(IDS)))
    env: Any = load_env_creator(str(spec.entry_point))
    return {**env.defaults(), "max_episode_steps": spec.max_episode_steps}


def check_action(
    env_id: str, env_kwargs: Mapping[str, object], torque_limit: float, control_dt: float
) -> None:
    """Check a policy's torque limit (N m) and control period (s) against its environment.

    Raises ValueError: they differ; there is no such environment; the period is out of range; or an
    episode has no end, or more than :data:`MOST_TIME_STEPS` time steps.
    """
    given = {**arguments_of(env_id), **env_kwargs}
    env: Any = load_env_creator(str(gym.registry[env_id].entry_point))
    driven = {name: given[name] for name in ("robot", "motor", "torque_limit")}
    robot = env.TASK.SETTINGS(**driven).make_robots()[0]
    plant = given.get("plant", "projection")  # the crank has none to choose
    period, step = control_period(given["control_dt"], plant_time_step(plant, given["time_step"]))
    for name, value, needed in (
        ("torque_limit", torque_limit, robot.motor.torque_limit),
        ("control_dt", control_dt, within("control_dt", period, SHORTEST_PERIOD, LONGEST_PERIOD)),
    ):
        if not math.isclose(value, needed):
            raise ValueError(f"{name} must be {needed} as of {env_id} with env.kwargs, got {value}")
    steps = whole_number("max_episode_steps", given["max_episode_steps"], least=1)
    if (count := steps * round(period / step)) > MOST_TIME_STEPS:
        raise ValueError(
            f"max_episode_steps is {steps} with control_dt {period} and time_step {step}, "
            f"{count} time steps, must be at most {MOST_TIME_STEPS} of these"
        )


def names(env_id: str) -> list[str]:
    """Return the names of the policies that come with the package for an environment."""
    known = {folder.name for folder in POLICIES.iterdir()}  # or an id could lead anywhere
    if not isinstance(env_id, str) or env_id not in known:
        return []
    return sorted(path.stem for path in (POLICIES / env_id).glob("*.json"))


def shipped(env_id: str, name: str = DEFAULT) -> Path:
    """Return the path of the JSON file of a policy of the package.

    Raises ValueError: there is none of this name for the environment.
    """
    one_of("env_id", env_id, sorted(path.name for path in POLICIES.iterdir() if names(path.name)))
    one_of("policy", name, names(env_id))
    return POLICIES / env_id / f"{name}.json"


def load(env_id: str, name: str = DEFAULT) -> PretrainedPolicy:
    """Load a policy that comes with the package; ``name``: one of :func:`names`.

    Raises ValueError: there is none of this name for the environment.
    """
    return load_file(shipped(env_id, name))


def load_file(path: str | Path) -> PretrainedPolicy:
    """Load a policy from its JSON file and the .safetensors file beside it. No code in them runs.

    Raises ValueError: one of them is missing, too large or damaged, or they are not of one policy.
    """
    path = Path(path)
    weights = path.with_suffix(".safetensors")
    try:
        description = json.loads(read_bounded(path, MAX_BYTES))
        content = read_bounded(weights, MAX_BYTES)
        try:
            tensors = read_tensors(content)
        except Exception as error:  # SafetensorError, and NumPy's of types that it does not have
            raise ValueError(f"{weights} is no file of tensors: {error}") from error
        policy = PretrainedPolicy(description, tensors)
        if description.get("sha256") != checksum(content):
            raise ValueError(f"sha256 is not that of {weights.name}: they are of two policies")
    except (OSError, RecursionError, ValueError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"{path} is no policy: {reason}") from error
    return policy


def checksum(data: bytes) -> str:
    """Return the SHA-256, which tells whether two files belong together."""
    return hashlib.sha256(data).hexdigest()


def _entry(part: object, name: str, kind: type) -> Any:
    """Return ``part[name]``, which must be of a type."""
    return instance(name, instance("an entry", part, dict).get(name), kind)
