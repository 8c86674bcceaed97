"""Model cards: what a policy that is taken along is for, how to run it, and what it is worth.

After Mitchell et al., "Model Cards for Model Reporting", FAT* 2019. All numbers come from the
policy's file, its environment and its scores. Texts of a policy's file stand as code, in which
Markdown finds nothing to act on (:func:`code`, :func:`block`).
"""

from __future__ import annotations

import inspect
import json
import shlex
from collections.abc import Mapping
from importlib.metadata import metadata
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from tabulate import tabulate

import jansen_env
from agents.card_examples import code, examples
from agents.config import training_envs
from agents.metrics import INTERVALS, tabled
from agents.observation_guide import frames, meaning, running_means
from agents.rollout import make_env
from agents.tasks import WALKERS, Task, find_task, vector_env
from jansen_env.noise import make_noise
from jansen_env.policy_network import Harmonics, Normalized
from jansen_env.pretrained import PretrainedPolicy, checksum
from jansen_env.world.parameters import PARAMETERS

SHOWN = ("friction", "restitution", "payload", "tilt")  # of a walker, drawn or not


class Export(NamedTuple):
    """What a card tells of.

    Attributes:
        name, policy: of what. run: where it is from, as ``--policy`` of agents.evaluate takes it.
        shipped: whether it comes with the package. command: that exported it.
        files: their content by name. kinds: of "onnx", "c" and "safetensors".
        differences: what was compared, and by how much its actions differ at most from those of
            PyTorch in float64; None where it was not compared. compared: on how many observations.
        scores: of each policy as of :func:`agents.evaluate.evaluate`, its own under its name.
        episodes, seed: per command, of the scores.
        observation: (d,) that occurs, for the examples.
    """

    name: str
    policy: PretrainedPolicy
    run: str
    shipped: bool
    command: str
    files: Mapping[str, bytes]
    kinds: tuple[str, ...]
    differences: Mapping[str, float | None]
    compared: int
    scores: Mapping[str, Mapping[str, Any]]
    episodes: int
    seed: int
    observation: NDArray[np.float32]


def block(text: str) -> str:
    """Text of any source as a block of code: lines indented, of which none can end it."""
    lines = ["".join(c if c.isprintable() else "_" for c in line) for line in text.split("\n")]
    return "\n".join(f"    {line}" for line in lines)


def card(export: Export) -> str:
    """The model card, in Markdown."""
    policy = export.policy
    env: Any = make_env(policy.env_id, policy.env_kwargs)
    plain = env.unwrapped
    summary = (inspect.getdoc(type(plain)) or "").split("\n")[0]
    parts = [
        f"# {export.name}",
        f"A trained policy of the environment {code(policy.env_id)} of jansen_env "
        f"{jansen_env.__version__}: {summary} It takes an observation every "
        f"{policy.control_dt:g} s and answers with the torque on the crank.",
        "**Trained and scored in simulation only; not tested on a machine.**",
        "## Files\n\n" + _files(export),
        "## Observation\n\n" + _observation(policy, plain),
        *([f"## What is worked out\n\n{text}"] if (text := running_means(plain)) else []),
        "## Action\n\n" + _action(policy),
        "## Run it\n\n"
        + "\n\n".join(examples(policy, export.name, export.kinds, export.observation)),
        "## Agreement with PyTorch\n\n" + _agreement(export),
        "## Environment\n\n" + _environment(policy),
        "## Limits\n\n" + _limits(policy),
        "## Training\n\n" + _training(policy),
        "## Scores\n\n" + _scores(export, env),
        "## Licence\n\n" + _licence(export.shipped),
    ]
    env.close()
    return "\n\n".join(part.strip("\n") for part in parts) + "\n"


def _table(headers: list[str], rows: Any) -> str:
    return tabulate(rows, headers, tablefmt="github", disable_numparse=True)


def _files(export: Export) -> str:
    rows = [
        [code(file), f"{len(data)}", code(checksum(data))] for file, data in export.files.items()
    ]
    return f"{_table(['file', 'bytes', 'SHA-256'], rows)}\n\nWritten by:\n\n{block(export.command)}"


def _observation(policy: PretrainedPolicy, env: Any) -> str:
    """Each number, and how the policy scales it."""
    own = len(policy.observed)
    mean, deviation = (np.ravel(each) for each in policy.scale)
    scaled = len(mean) == own
    noise = make_noise({**_defaults(policy.env_id), **policy.env_kwargs}.get("noise"))
    errors = noise.deviations(policy.observed) if noise else np.zeros((own, 2))
    rows = [
        [
            i, code(name), unit if unit == "1" else code(unit),
            *([f"{mean[i]:.3g} +- {deviation[i]:.3g}"] if scaled else []),
            *([f"{errors[i][0]:.2g}, {errors[i][1]:.2g}"] if noise else []), meaning(name, env),
        ]
        for i, (name, unit) in enumerate(zip(policy.observed, policy.units, strict=True))
    ]  # fmt: skip
    headers = ["place", "name", "unit", *(["in training"] if scaled else [])]
    headers += [*(["noise, bias"] if noise else []), "what it is"]
    clips = [block.clip for block in policy.features if isinstance(block, Normalized)]
    how = "Give numbers in these units, without scaling them; they must be finite."
    if clips:
        how += (
            " The policy itself subtracts the mean in training, divides by the standard deviation, "
            f"and clips at {max(clips):g} of them."
        )
    if noise:
        how += (
            " Noise and bias are the standard deviations of what it was scored with, in each step "
            "and of an episode, times `noise_level`; that of an angle, in rad, stands at the first "
            "of its numbers."
        )
    return f"{how}\n\n{_table(headers, rows)}\n\n{frames(env)}"


def _action(policy: PretrainedPolicy) -> str:
    network = " -> ".join(
        str(n) for n in (policy.layers[0].weight.shape[1], *(len(a.bias) for a in policy.layers))
    )
    names = dict.fromkeys(str(layer.activation) for layer in policy.layers if layer.activation)
    harmonics = [k for b in policy.features if isinstance(b, Harmonics) for k in b.multiples]
    forwards = "walks towards +x" if policy.env_id in WALKERS else "turns it counter-clockwise"
    text = (
        f"One number from -1 to 1: the torque on the crank as a share of {policy.torque_limit:g} "
        f"N m, held for {policy.control_dt:g} s; positive {forwards}. It is the network's "
        f"action without noise. The network has {network} units"
    )
    text += f" with {' and '.join(names)}" if names else ""
    if harmonics:
        text += f", and sees cosine and sine of {harmonics} times the crank angle, too"
    return text + "."


def _agreement(export: Export) -> str:
    rows = [
        [what, "not compared here" if difference is None else f"{difference:.2g}"]
        for what, difference in export.differences.items()
    ]
    return (
        f"The largest difference of an action from that of the PyTorch policy computed in float64, "
        f"over {export.compared} observations: half of them of episodes, a quarter random, a "
        "quarter at and beyond the clip of the scaling:\n\n"
        + _table(["computed by", "largest difference"], rows)
    )


def _defaults(env_id: str) -> dict[str, Any]:
    """An environment's arguments, by default."""
    parameters = inspect.signature(vector_env(env_id).TASK).parameters
    return {name: parameter.default for name, parameter in parameters.items()}


def _environment(policy: PretrainedPolicy) -> str:
    """Its robot and ground, and what is not JansenWalker-v0's own of the other arguments."""
    values = _defaults(policy.env_id)
    plain = _defaults("JansenWalker-v0")
    told = {
        name: value
        for name, value in values.items()
        if name in ("robot", "terrain") or (name in plain and value != plain[name])
    }
    told |= policy.env_kwargs
    rows = [[code(name), code(value)] for name, value in told.items()]
    return (
        f"{code(policy.env_id)}; other arguments than these are the environment's and documented "
        f"with it.\n\n{_table(['argument', 'value, as scored'], rows)}"
    )


def _limits(policy: PretrainedPolicy) -> str:
    """The ranges that training has covered."""
    config = policy.description["training"]["config"]
    kwargs, variants = training_envs(config)
    found: dict[str, list[tuple[float, float]]] = {}
    grounds: dict[str, None] = {}
    longest, changes = 0.0, False
    for variant in variants:
        own: Any = make_env(policy.env_id, {**kwargs, **variant})
        task = own.unwrapped.task
        given = {**_defaults(policy.env_id), **kwargs, **variant}
        longest = max(longest, own.spec.max_episode_steps * policy.control_dt)
        changes |= given.get("command_interval") is not None
        if "terrain" in given:
            grounds[code(given["terrain"])] = None
        found.setdefault("speed_command", []).append(tuple(task.speed_command[0].tolist()))
        delays = tuple(task.world.delay_range[0].tolist())
        for name, limits in {"delay": delays, **_ranges(task)}.items():
            found.setdefault(name, []).append(limits)
        own.close()
    rows = []
    for name, ranges in found.items():
        low, high = min(pair[0] for pair in ranges), max(pair[1] for pair in ranges)
        units = [find_task(policy.env_id).command_unit, "speed asked for"]
        if name in PARAMETERS:
            units = [PARAMETERS[name].unit, PARAMETERS[name].meaning]
        rows.append([code(name), f"{low:g}" if low == high else f"{low:g} to {high:g}", *units])
    if grounds:
        rows.insert(1, [code("terrain"), ", ".join(grounds), "", "the ground"])
    return (
        "Trained on these ranges (one number: always that); what it does outside of them nobody "
        "knows. Linkage and motor are those of the environment above. No sensor has ever failed in "
        f"training; episodes lasted {longest:g} s at most, and the command "
        + ("changed within them" if changes else "stayed the same in each")
        + f".\n\n{_table(['number', 'range', 'unit', 'what it is'], rows)}"
    )


def _ranges(task: Any) -> dict[str, Any]:
    """(low, high) of what differs between episodes of a walker, and of what most depends on."""
    if not hasattr(task.world, "episodes"):
        return {}
    drawn, nominal = task.world.episodes.ranges(0), task.world.episodes.nominal
    return {
        name: tuple(
            getattr(drawn.get(name), end, float(nominal[name][0])) for end in ("low", "high")
        )
        for name in PARAMETERS
        if name in drawn or name in SHOWN
    }


def _training(policy: PretrainedPolicy) -> str:
    training = policy.description["training"]
    commands, versions = training.get("command"), policy.description.get("versions")
    if not isinstance(commands, list) or not commands:
        commands = ["(not recorded)"]
    known = versions.items() if isinstance(versions, dict) else ()
    return (
        f"By {code(training['config']['algo'])}, {code(training.get('steps'))} environment steps "
        f"to this model:\n\n{block(chr(10).join(map(str, commands)))}\n\nVersions: "
        + ", ".join(f"{code(f'{name} {number}')}" for name, number in known)
        + ". The whole configuration:\n\n"
        + block(json.dumps(training["config"], indent=1))
    )


def _scores(export: Export, env: Any) -> str:
    """Beside the baselines over all commands, and alone at each of them."""
    task = find_task(export.policy.env_id)
    policies = [export.name, *(name for name in export.scores if name != export.name)]
    rows = []
    for name, metric in task.metrics.items():
        cells = [_cell(metric, export.scores[p]["overall"][name]) for p in policies]
        rows.append([metric.heading, *cells])
    count, commands = export.episodes, len(task.commands)
    return (
        f"{count} episode{'s' * (count > 1)} at each of {commands} command{'s' * (commands > 1)}, "
        f"{commands * count} in all, seed {export.seed}, the same starts for all; in brackets "
        f"{INTERVALS}. They say how well this one policy is known, not what training again would "
        "give.\n\n"
        + _table(["", *policies], rows)
        + f"\n\nAt each command, {task.command_unit}:\n\n"
        + _by_command(task, export)
        + "\n\nMade again by:\n\n"
        + block(_evaluation(export))
    )


def _evaluation(export: Export) -> str:
    """The command that scores alike."""
    policy = export.policy
    words = ["python", "-m", "agents.evaluate", "--env", policy.env_id]
    if policy.env_kwargs:
        words += ["--env-kwargs", json.dumps(policy.env_kwargs)]
    for name in (export.run, *(name for name in export.scores if name != export.name)):
        words += ["--policy", name]
    return shlex.join([*words, "--episodes", str(export.episodes), "--seed", str(export.seed)])


def _by_command(task: Task, export: Export) -> str:
    shown = {name: metric for name, metric in tabled(task.metrics).items() if metric.axis}
    found = export.scores[export.name]["by_command"]
    rows = []
    for i, command in enumerate(found["return"]["command"]):
        cells = [
            _cell(metric, [found[name][part][i] for part in ("value", "low", "high")])
            for name, metric in shown.items()
        ]
        rows.append([f"{command:g}", *cells])
    return _table(["command", *(metric.heading for metric in shown.values())], rows)


def _cell(metric: Any, interval: Any) -> str:
    """A value with its interval."""
    value, low, high = ("-" if x is None else f"{x:.{metric.digits}g}" for x in interval)
    return value if low == "-" else f"{value} [{low}, {high}]"


def _licence(shipped: bool) -> str:
    own = " ".join(metadata("jansen-env").get_all("License-Expression") or ["see its LICENSE"])
    if shipped:
        return f"{own}, as of jansen_env, which the policy comes with."
    return (
        f"What was generated around the weights is under jansen_env's licence, {own}. Who trained "
        "the weights chooses theirs; none is stated here."
    )
