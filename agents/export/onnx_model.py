"""A policy as an ONNX model, by ``torch.onnx.export``: scaling, network and limits in one file.

The input is ``observation`` (N, d) float32; outputs are ``action`` (N, 1), from -1 to 1, and
``torque`` (N, 1), N m. N is free. All is computed in float64 and rounded to float32 at the end, as
:meth:`jansen_env.policies.pretrained.PretrainedPolicy.predict` does. A graph cannot raise an error:
where an observation of a robot is not finite, the action and torque of that robot are NaN.
"""

import json
import logging
import warnings
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor, nn

import jansen_env
from jansen_env.policies.pretrained import Features, Harmonics, Normalized, PretrainedPolicy

if TYPE_CHECKING:
    import onnx

NEEDED = ("onnx", "onnxscript")  # packages of the extra "export"
OPSET = 18  # of 2022, which runtimes of today read


class Controller(nn.Module):
    """A policy's network in PyTorch, from observations (n, d) to actions and torques (n, 1)."""

    def __init__(self, policy: PretrainedPolicy) -> None:
        super().__init__()
        self.policy = policy

    def forward(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        """Return actions, -1 to 1, and torques, N m; NaN where an observation is not finite."""
        policy, seen = self.policy, observation.double()
        values = torch.cat([_features(block, seen) for block in policy.features], dim=1)
        for layer in policy.layers:
            values = values @ torch.tensor(layer.weight.T) + torch.tensor(layer.bias)
            if layer.activation == "elu":  # not of float64 in onnxruntime
                values = torch.where(values > 0.0, values, values.clamp(max=0.0).exp() - 1.0)
            elif layer.activation is not None:
                values = getattr(torch, layer.activation)(values)
        # Clips turn infinity into a number, and NaN too in some programs that run ONNX.
        usable = torch.isfinite(seen).all(dim=1, keepdim=True) & torch.isfinite(values)
        if np.isfinite(policy.limit):
            values = values.clamp(-policy.limit, policy.limit)
        actions = (values.tanh() if policy.squash == "tanh" else values).clamp(-1.0, 1.0)
        actions = torch.where(usable, actions, torch.nan)
        return actions.float(), (actions * policy.torque_limit).float()


def _features(block: Features, seen: Tensor) -> Tensor:
    """Return features (n, size) of observations."""
    if isinstance(block, Normalized):
        scaled = (seen - torch.tensor(block.mean)) / torch.tensor(block.deviation)
        return scaled.clamp(-block.clip, block.clip)
    if not isinstance(block, Harmonics):
        return seen
    parts = [seen[:, :0]]
    for k in block.multiples:  # by doubling and adding angles
        cos, sin = seen[:, :1], seen[:, 1:2]
        pair = [torch.ones_like(cos), torch.zeros_like(sin)]
        while k > 0:
            if k % 2:
                pair = [pair[0] * cos - pair[1] * sin, pair[1] * cos + pair[0] * sin]
            cos, sin, k = cos * cos - sin * sin, 2.0 * sin * cos, k // 2
        parts += pair
    return torch.cat(parts, dim=1)


def build(policy: PretrainedPolicy, name: str) -> "onnx.ModelProto":
    """Return the model of a policy, checked; ``name``: of the graph."""
    import onnx

    logging.getLogger("torch.onnx").setLevel(logging.ERROR)  # of operators that it does not need
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # torch's own, of its own modules
        program: Any = torch.onnx.export(
            Controller(policy), (torch.zeros(2, len(policy.observed)),), dynamo=True,
            dynamic_shapes=({0: torch.export.Dim("N")},), input_names=["observation"],
            output_names=["action", "torque"], opset_version=OPSET, verbose=False,
        )  # fmt: skip
    model = program.model_proto
    graph = model.graph
    for part in (graph, *graph.node, *graph.input, *graph.output, *graph.value_info):
        del part.metadata_props[:]  # paths of this machine
    model.producer_name, model.producer_version = "jansen_env", jansen_env.__version__
    graph.name = name
    observation = zip(policy.observed, policy.units, strict=True)
    notes = {
        "env_kwargs": policy.env_kwargs, "control_dt": policy.control_dt,
        "torque_limit": policy.torque_limit,
        "observation": [{"name": seen, "unit": unit} for seen, unit in observation],
    }  # fmt: skip
    texts = {key: json.dumps(value) for key, value in notes.items()}
    onnx.helper.set_model_props(model, {"env_id": policy.env_id, **texts})
    onnx.checker.check_model(model, full_check=True)
    return model
