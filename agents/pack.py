"""Pack a trained policy into two small files that need no torch: ``python -m agents.pack RUN``.

The command writes ``ENV_ID/NAME.json``, which includes the scores of the policy, and
``ENV_ID/NAME.safetensors``. :mod:`jansen_env.policies.pretrained` reads these files.
"""

import platform
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import torch
from safetensors.numpy import save
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import BasePolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

import jansen_env
from agents.training.train_model import prepare
from jansen_env.arrays import Array
from jansen_env.checks import named_errors, one_of, shown
from jansen_env.cli.flags import Parser, episode_count, non_negative_int, path_flag
from jansen_env.cli.named_policies import model_file
from jansen_env.cli.process import run
from jansen_env.cli.progress import progress
from jansen_env.files import check_writable, write_bytes, write_json
from jansen_env.policies import pretrained
from jansen_env.policies.pretrained import PretrainedPolicy
from jansen_env.sb3.run_config import RunConfig, find_config, load_config, make_config
from jansen_env.sb3.trained import (
    CLIP,
    MIN_DEVIATION,
    half_turn_image,
    load_policy,
    read_model,
)
from jansen_env.scoring.benchmarks import find_benchmark
from jansen_env.scoring.evaluation import evaluate
from jansen_env.scoring.rollout import make_env

Description: TypeAlias = dict[str, Any]
"""Part of the JSON file of a policy."""

LIBRARIES = ("gymnasium", "numpy", "stable-baselines3", "torch")
COPY = "critic_target."  # SAC's copy of the critic, which need not be stored
TOLERANCE = 1e-6  # largest difference between the actions in torch and in NumPy


def describe_network(config: RunConfig, tensors: pretrained.Tensors) -> Description:
    """Describe how a policy computes its deterministic action from an observation.

    Args:
        config: Configuration of the run.
        tensors: Weights of the policy.

    Raises:
        ValueError: If the algorithm is not PPO, SAC or TQC.
    """
    one_of("algo", config.algo, ["ppo", "sac", "tqc"])
    policy_kwargs = config.policy_kwargs
    sac = config.algo != "ppo"
    hidden, last = (
        ("actor.latent_pi", "actor.mu") if sac else ("mlp_extractor.policy_net", "action_net")
    )
    activation = policy_kwargs.get("activation", "relu" if sac else "tanh")
    weights = [name for name in tensors if name.startswith((f"{hidden}.", f"{last}."))]
    layers = [
        {
            "units": len(tensors[name]),
            "activation": None if name.startswith(last) else activation,
            "weight": name,
            "bias": f"{name.removesuffix('weight')}bias",
        }
        for name in weights
        if name.endswith(".weight")
    ]
    features: list[Description] = [{"kind": "observation"}]
    if policy_kwargs.get("normalize"):
        path = "actor.features_extractor" if sac else "pi_features_extractor"
        features = [
            {
                "kind": "normalized",
                "mean": f"{path}.mean",
                "variance": f"{path}.variance",
                "floor": MIN_DEVIATION,
                "clip": CLIP,
            }
        ]
    if count := policy_kwargs.get("harmonics"):
        features.append({"kind": "harmonics", "multiples": [2 * k for k in range(1, count + 1)]})
    limit = None
    if sac and config.hyperparameters.get("use_sde"):  # the mean is clipped before squashing
        limit = policy_kwargs.get("clip_mean", 2.0) or None
    squash = "tanh" if sac or policy_kwargs.get("squash_output") else "clip"
    return {"features": features, "layers": layers, "limit": limit, "squash": squash}


def pack(
    run: str | Path,
    name: str | None = None,
    out: str | Path = "policies",
    episodes: int = 10,
    seed: int = 0,
) -> Path:
    """Write the best model of a run, or a single model, as ENV_ID/NAME.json and .safetensors.

    Args:
        run: Folder of a run, or file of a model. If it is the JSON file of a packed policy, the
            policy is scored again and its files are rewritten in place.
        name: Name of the policy. None selects the name of its algorithm.
        out: Folder to write to.
        episodes: Number of episodes per command for the scores; see
            :func:`jansen_env.scoring.evaluation.evaluate`.
        seed: Seed of the scores.

    Returns:
        The JSON file.

    Raises:
        ValueError: If there is no such model, or a part of it cannot be packed.
    """
    if name is not None and Path(name).name != name:
        raise ValueError(f"name must be the name of a file without a folder, got {shown(name)}")
    policy, short = read(run)
    again = Path(run).suffix == ".json"
    path = Path(run) if again else Path(out) / policy.env_id / f"{name or short}.json"
    check_writable("out", path.parent)  # checked before the expensive work
    policy.description["scores"] = scores_of(policy, episodes, seed)
    weights = save(policy.tensors)
    write_bytes(path.with_suffix(".safetensors"), weights)
    return write_json(path, {**policy.description, "sha256": pretrained.checksum(weights)})


def scores_of(policy: PretrainedPolicy, episodes: int, seed: int = 0) -> Description:
    """Score a policy with :func:`jansen_env.evaluate`.

    Args:
        policy: The policy.
        episodes: Number of episodes per command.
        seed: Seed of the episodes.

    Returns:
        The scores, and the arguments that reproduce them.
    """
    env = make_env(policy.env_id, policy.env_kwargs)
    policy = policy.on(env)  # the environment may show more observations than the policy uses
    env.close()
    total = len(find_benchmark(policy.env_id).commands) * episodes
    with progress("scoring", total) as advance:
        scores = evaluate(
            {"it": policy}, policy.env_id, policy.env_kwargs, None, episodes, seed, advance=advance
        )["it"]
    return {
        "episodes_per_command": episodes,
        "seed": seed,
        "overall": scores["overall"],
        "by_command": scores["by_command"],
    }


def read(run: str | Path) -> tuple[PretrainedPolicy, str]:
    """Return a policy and its name.

    Args:
        run: JSON file of a packed policy, or an argument of :func:`from_run`.
    """
    if Path(run).suffix == ".json":
        return pretrained.load_file(run), Path(run).stem
    policy = from_run(run)
    return policy, policy.description["training"]["config"]["algo"]


def from_run(run: str | Path) -> PretrainedPolicy:
    """Return the best model of a run, or a single model, as a packed policy without scores.

    Args:
        run: Folder of a run, or file of a model.

    Raises:
        ValueError: If there is no such model, or a part of it cannot be packed.
    """
    model = model_file(str(run)) or Path(run)
    policy = load_policy(model)
    source = find_config(model)
    config = load_config(source)
    commands = source.parent / "command.txt"
    tensors = {
        key: np.ascontiguousarray(tensor.float().numpy())  # this includes step counters
        for key, tensor in policy.state_dict().items()
        if not key.startswith(COPY)
    }
    lines = commands.read_text("utf-8", "replace").splitlines() if commands.is_file() else []
    network = describe_network(config, tensors)
    if config.policy_kwargs.get("half_turn"):
        # The network averages the features of an observation and its image. Changed weights do the
        # same for a single observation.
        image = half_turn_image(config).astype(np.float32)
        of_observation = tensors[network["layers"][0]["weight"]][:, : len(image)]
        of_observation[:] = 0.5 * (of_observation + of_observation @ image.T)
    env: Any = make_env(config.env, config.env_kwargs).unwrapped
    description = {
        "format": pretrained.FORMAT,
        "env": {"id": config.env, "kwargs": config.env_kwargs},
        "observation": [{"name": row.name, "unit": row.unit} for row in env.observed],
        # An action is a fraction of torque_limit, which is in N m; control_dt is in s.
        "action": {
            "name": "crank_torque",
            "unit": "torque_limit",
            "torque_limit": env.torque_limit,
            "control_dt": env.control_dt,
        },
        "network": network,
        "training": {"command": lines, "steps": read_model(model).steps, "config": asdict(config)},
        "versions": {
            "jansen_env": jansen_env.__version__,
            "python": platform.python_version(),
            **{name: version(name) for name in LIBRARIES},
        },
    }
    env.close()
    packed = PretrainedPolicy(description, tensors)
    check_equal(packed, policy)
    return packed


def load_sb3(env_id: str, name: str = pretrained.DEFAULT) -> BaseAlgorithm:
    """Load a pretrained policy as a model of Stable-Baselines3; see :func:`to_sb3`.

    Args:
        env_id: Id of the environment.
        name: Name of the policy.
    """
    return to_sb3(pretrained.load(env_id, name))


def to_sb3(packed: PretrainedPolicy) -> BaseAlgorithm:
    """Return a policy as a Stable-Baselines3 model on the environments of its training.

    The state of the optimiser is not stored in a packed policy, so the optimiser starts afresh.

    Args:
        packed: The policy.

    Raises:
        ValueError: If the stored training configuration is invalid, or if it belongs to another
            environment or another network.
    """
    training = packed.description.get("training")
    config = make_config(training.get("config") if isinstance(training, dict) else None)
    for name, value in (("env", packed.env_id), ("env_kwargs", packed.env_kwargs)):
        if (trained := getattr(config, name)) != value:
            raise ValueError(f"training.config.{name} must be {shown(value)}, got {shown(trained)}")
    model = prepare(config)
    load_weights(model, packed.tensors)
    return model


def start_from(model: BaseAlgorithm, run: str | Path) -> None:
    """Load the weights of a policy into a new model, so that training starts from them.

    The model keeps its own action noise.

    Args:
        model: The new model.
        run: Argument of :func:`read` that names the policy.

    Raises:
        ValueError: If there is no such policy, or its weights do not fit the model.
    """
    noise = {k: v.cpu().numpy() for k, v in model.policy.state_dict().items() if k == "log_std"}
    load_weights(model, {**read(run)[0].tensors, **noise})


def load_weights(model: BaseAlgorithm, tensors: pretrained.Tensors) -> None:
    """Load the weights of a packed policy into a model.

    Args:
        model: The model.
        tensors: The weights.

    Raises:
        ValueError: If the weights do not fit the model.
    """
    state = {name: torch.from_numpy(array.copy()) for name, array in tensors.items()}
    for name in model.policy.state_dict():
        if name.startswith(COPY):
            state[name] = state.get(name.replace(COPY, "critic.", 1), torch.empty(0))
    with named_errors("the weights do not fit", RuntimeError):
        model.policy.load_state_dict(state)


def check_equal(packed: PretrainedPolicy, policy: BasePolicy, count: int = 10_000) -> float:
    """Check that a packed policy computes the same actions as the original.

    The rounding error of torch in float32 depends on the size of the batch, so ``policy`` is
    converted to float64.

    Args:
        packed: The packed policy.
        policy: The original policy, which computes in float64 afterwards.
        count: Number of random observations.

    Returns:
        The largest difference between the actions.

    Raises:
        ValueError: If the difference exceeds :data:`TOLERANCE`.
    """
    rng = np.random.default_rng(0)
    in_float64(policy)
    seen = random_observations(packed, 2.0 * rng.normal(size=(count, len(packed.observed))), rng)
    actions, _ = packed.predict(seen)
    expected, _ = policy.predict(seen, deterministic=True)
    difference = float(np.abs(actions - expected).max())
    if difference > TOLERANCE:
        raise ValueError(f"actions must differ by at most {TOLERANCE}, got {difference:.2g}")
    return difference


def random_observations(policy: PretrainedPolicy, spread: Array, rng: np.random.Generator) -> Array:
    """Return random observations for a policy.

    The cosine and the sine of an angle always belong to the same random angle.

    Args:
        policy: The policy.
        spread: Distance of each value from its mean in training, in standard deviations, shape
            (n, d).
        rng: Generator of the random angles.

    Returns:
        The observations, shape (n, d).
    """
    mean, deviation = policy.scale
    seen = mean + deviation * spread
    for cos, name in enumerate(policy.observed):
        partner = name.replace("cos_", "sin_", 1)
        if name.startswith("cos_") and partner in policy.observed:
            angle = rng.uniform(-np.pi, np.pi, len(seen))
            seen[:, cos] = np.cos(angle)
            seen[:, policy.observed.index(partner)] = np.sin(angle)
    return seen.astype(np.float32)


def in_float64(policy: BasePolicy) -> BasePolicy:
    """Convert a PyTorch policy to float64 and return it; the values of its weights do not change.

    Args:
        policy: The policy.
    """
    for module in policy.double().modules():
        if isinstance(module, BaseFeaturesExtractor):  # it receives observations in float32
            module.register_forward_pre_hook(lambda _, inputs: (inputs[0].double(),))
    return policy


def main(arguments: list[str] | None = None) -> None:
    """Pack a policy and print the names of its files.

    Args:
        arguments: Arguments of the command. None selects those of the process.
    """
    parser = Parser(
        "python -m agents.pack",
        __doc__,
        "python -m agents.pack logs/ppo/JansenWalkerBuilt-v0_1",
        "python -m agents.pack model.zip --name mine --out policies",
    )
    add = parser.add_argument
    add(
        "run",
        help="the folder of a run, the zip file of a model with config.yml beside it, or the JSON "
        "file of a policy that is to be scored again",
    )
    add("--name", help="name of the policy; default: the name of its algorithm")
    add(
        "--out",
        type=path_flag,
        default="policies",
        metavar="DIR",
        help="parent folder; the files are written to DIR/ENV_ID; default: policies",
    )
    add(
        "--episodes",
        type=episode_count,
        default=10,
        help="number of episodes per command for the scores; default: 10",
    )
    add("--seed", type=non_negative_int, default=0, help="seed of these episodes; default: 0")
    args = parser.parse_args(arguments)
    with parser.refusing():
        path = pack(**vars(args))
    print(f"written: {path}, with its scores, and {path.with_suffix('.safetensors')}")


if __name__ == "__main__":
    run("python -m agents.pack", main)
