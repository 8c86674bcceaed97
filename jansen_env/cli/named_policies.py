"""Policies by the names and files that users pass to commands."""

import argparse
import hashlib
import os
import sys
from collections.abc import Callable, Sequence
from contextlib import closing
from importlib import import_module
from pathlib import Path
from typing import Any, TypeAlias, cast

from jansen_env.checks import invalid, listed, named_errors, shown
from jansen_env.policies import pretrained
from jansen_env.policies.policy import Policy
from jansen_env.scoring.benchmarks import find_benchmark
from jansen_env.scoring.rollout import EnvKwargs, make_env
from jansen_env.tasks.walking.profile import load_profile

SEARCHED = "profile:"  # prefix of the file of a profile that a search has found

Loaded: TypeAlias = list[tuple[dict[str, Policy], EnvKwargs]]
"""Policies by label and arguments of the environment, for each simulation backend."""


def default_policy(env_id: str) -> str:
    """Return the name of an environment's pretrained policy, or of its first baseline.

    Args:
        env_id: Id of the environment.
    """
    trained = pretrained.names(env_id)
    return "pretrained" if trained else next(iter(find_benchmark(env_id).baselines))


def shipped_file(name: str, env_id: str) -> Path | None:
    """Return the file of a pretrained policy.

    Args:
        name: ``"pretrained"`` or ``"pretrained:NAME"``.
        env_id: Id of the environment.

    Returns:
        Path of the file, or None if ``name`` has another form.
    """
    word, _, policy = name.partition(":")
    return (
        pretrained.shipped(env_id, policy or pretrained.DEFAULT) if word == "pretrained" else None
    )


def load_named(name: str, env: Any) -> Policy:
    """Load a policy for an environment.

    Args:
        name: Name of a baseline, ``"pretrained"``, ``"pretrained:NAME"``, ``"profile:FILE"`` for a
            profile that a search has found, the folder of a run, the file of a model or policy, or
            ``"MODULE:FUNCTION"`` for a function that makes a policy for the unwrapped environment.
        env: Environment in which the policy acts.

    Raises:
        ValueError: If there is no such policy, or if it does not fit the environment.
    """
    env_id = env.spec.id
    baselines = find_benchmark(env_id).baselines
    path = shipped_file(name, env_id) or Path(name)
    if name in baselines:
        return baselines[name](env.unwrapped)
    if name.startswith(SEARCHED):
        return load_profile(name.removeprefix(SEARCHED), "found").policy(env.unwrapped)
    if function := _imported(name):
        return _call(function, name, env)
    if not path.exists():
        known = listed([*baselines, "pretrained"], name)
        allowed = f"a run's folder, a model's zip file, a policy's json file or one of {known}"
        raise invalid("policy", name, allowed)
    if path.suffix == ".json":
        packed = pretrained.load_file(path)
        with named_errors(f"policy {name!r} does not fit {env_id}"):
            return packed.on(env)
    # More threads would change the last bits of the actions.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    from jansen_env.sb3 import load_policy  # imported late, because torch is slow to import

    policy: Any = load_policy(name)
    for space in ("observation_space", "action_space"):
        trained = getattr(policy, space)
        needed = getattr(env, space)
        if trained.shape != needed.shape:
            raise ValueError(
                f"the {space} of policy {name!r} must have the shape {needed.shape} for {env_id}, "
                f"got {trained.shape}"
            )
    return policy


def _module_name(name: str) -> str | None:
    """Return the module in ``"MODULE:FUNCTION"``, or None if a name has another form."""
    module, colon, function = name.partition(":")
    dotted = all(part.isidentifier() for part in module.split("."))
    other = module in ("pretrained", SEARCHED.removesuffix(":")) or Path(name).exists()
    return module if colon and dotted and function.isidentifier() and not other else None


def _imported(name: str) -> Callable[[Any], object] | None:
    """Return the function that ``"MODULE:FUNCTION"`` names, or None if a name has another form.

    Raises:
        ValueError: If the module cannot be imported or has no such function.
    """
    module = _module_name(name)
    if module is None:
        return None
    function = name.partition(":")[2]
    try:
        made = getattr(import_module(module), function, None)
    except (ImportError, TypeError, ValueError) as error:
        raise ValueError(f"policy {name!r}: module {module} cannot be imported: {error}") from error
    if not callable(made):
        raise ValueError(f"policy {name!r}: module {module} has no function {function}")
    return cast("Callable[[Any], object]", made)


def _call(function: Callable[[Any], object], name: str, env: Any) -> Policy:
    """Return the policy that a function makes for an environment.

    Raises:
        ValueError: If the function returns an object without the method ``predict``.
    """
    policy: Any = function(env.unwrapped)
    if not callable(getattr(policy, "predict", None)):
        raise ValueError(
            f"policy {name!r} must return an object with the method predict, got {shown(policy)}"
        )
    return cast("Policy", policy)


def policy_sha256(name: str, env_id: str) -> str | None:
    """Return the SHA-256 of a policy's files.

    It covers the JSON file and the tensors of a packed policy, the zip file of a model, the file of
    a profile, or the source file of a module.

    Args:
        name: Name of the policy, as for :func:`load_named`.
        env_id: Id of the environment.

    Returns:
        The hexadecimal digest, or None for a policy without files, such as a baseline.
    """
    module = _module_name(name)
    if module is not None and name not in find_benchmark(env_id).baselines:
        source = getattr(sys.modules.get(module), "__file__", None)
        files = [Path(source)] if source else []
    elif name.startswith(SEARCHED):
        files = [Path(name.removeprefix(SEARCHED))]
    else:
        file = shipped_file(name, env_id) or model_file(name)
        files = [] if file is None else [file]
        if file is not None and file.suffix == ".json":
            files.append(file.with_suffix(".safetensors"))
    if not files:
        return None
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


def model_file(name: str) -> Path | None:
    """Return the file of a policy.

    Args:
        name: Name, folder or file of the policy.

    Returns:
        Path of the file, or None for a baseline.
    """
    path = Path(name).resolve()
    if not path.exists():
        return None
    return path / "best_model.zip" if path.is_dir() else path


def label(name: str) -> str:
    """Return the name of a policy in tables.

    A model or profile is called by the name of its folder.

    Args:
        name: Name, folder or file of the policy.
    """
    if name.startswith(SEARCHED):
        return "/".join(Path(name.removeprefix(SEARCHED)).resolve().parts[-3:-1])
    file = model_file(name)
    if file is None:
        return name
    stem = "" if file.stem == "best_model" else f" {file.stem}"
    return f"{file.parent.parent.name}/{file.parent.name}{stem}"


def labels(names: list[str]) -> list[str]:
    """Return the label of each policy.

    Policies whose labels would be equal keep the names that the user has passed.

    Args:
        names: Names, folders or files of the policies.

    Raises:
        ValueError: If a policy occurs twice.
    """
    policies = [model_file(name) or name for name in names]
    for policy, name in zip(policies, names, strict=True):
        if (times := policies.count(policy)) > 1:
            raise ValueError(f"policy {name!r} must be given only once, got it {times} times")
    short = [label(name) for name in names]
    return [a if short.count(b) > 1 else b for a, b in zip(names, short, strict=True)]


def load_all(args: argparse.Namespace, commands: Sequence[float] = ()) -> Loaded:
    """Load all policies of a command line, for each simulation backend.

    Args:
        args: Parsed command line.
        commands: Commands for the robot, such as speeds, that are checked.

    Raises:
        ValueError: If a policy, an argument or a command is not allowed.
    """
    names = dict(zip(labels(args.policy), args.policy, strict=True))
    loaded: Loaded = []
    for plant in dict.fromkeys(getattr(args, "plant", ())) or [None]:
        env_kwargs = args.env_kwargs if plant is None else {**args.env_kwargs, "plant": plant}
        suffix = "" if plant is None else f" on {plant}"
        with closing(make_env(args.env, env_kwargs)) as env:
            policies = {short + suffix: load_named(name, env) for short, name in names.items()}
            for command in commands:
                env.reset(options=find_benchmark(args.env).options(command))
        loaded.append((policies, env_kwargs))
    return loaded
