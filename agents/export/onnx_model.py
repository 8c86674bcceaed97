"""ONNX model of a policy, made by ``torch.onnx.export``: scaling, network and limits in one file.

The input is ``observation``, shape (N, d), float32. The outputs are ``action`` in [-1, 1] and
``torque`` in N m, each of shape (N, 1). The batch size N is arbitrary. The model computes in
float64 and rounds the results to float32, as
:meth:`jansen_env.policies.pretrained.PretrainedPolicy.predict` does. An ONNX graph cannot raise an
error. If the observation of a robot is not finite, the action and the torque of this robot are NaN.
"""

import json
import logging
import warnings
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor, nn
from typing_extensions import override

import jansen_env
from jansen_env.policies.pretrained import Features, Harmonics, Normalized, PretrainedPolicy

if TYPE_CHECKING:
    import onnx

NEEDED = ("onnx", "onnxscript")  # packages that the extra "export" installs
OPSET = 18  # released in 2022, and supported by current runtimes


class Controller(nn.Module):
    """PyTorch module of a policy.

    It maps observations, shape (n, d), to actions and torques, shape (n, 1) each.

    Args:
        policy: The policy.
    """

    def __init__(self, policy: PretrainedPolicy) -> None:
        super().__init__()
        self.policy = policy

    @override
    def forward(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        """Compute actions and torques.

        Args:
            observation: Observations, shape (n, d).

        Returns:
            Actions in [-1, 1] and torques in N m, shape (n, 1) each; NaN for a robot whose
            observation is not finite.
        """
        policy = self.policy
        seen = observation.double()
        values = torch.cat([_features(block, seen) for block in policy.features], dim=1)
        for layer in policy.layers:
            values = values @ torch.tensor(layer.weight.T) + torch.tensor(layer.bias)
            if layer.activation == "elu":  # onnxruntime has no ELU in float64
                values = torch.where(values > 0.0, values, values.clamp(max=0.0).exp() - 1.0)
            elif layer.activation is not None:
                values = getattr(torch, layer.activation)(values)
        # Clipping turns infinity into a finite number; in some ONNX runtimes, it does so with NaN.
        usable = torch.isfinite(seen).all(dim=1, keepdim=True) & torch.isfinite(values)
        if np.isfinite(policy.limit):
            values = values.clamp(-policy.limit, policy.limit)
        actions = (values.tanh() if policy.squash == "tanh" else values).clamp(-1.0, 1.0)
        actions = torch.where(usable, actions, torch.nan)
        return actions.float(), (actions * policy.torque_limit).float()


def _features(block: Features, seen: Tensor) -> Tensor:
    """Return the features of a block for observations, shape (n, size)."""
    if isinstance(block, Normalized):
        scaled = (seen - torch.tensor(block.mean)) / torch.tensor(block.deviation)
        return scaled.clamp(-block.clip, block.clip)
    if not isinstance(block, Harmonics):
        return seen
    parts = [seen[:, :0]]
    for k in block.multiples:  # computed with double-angle and angle-sum formulas
        cos = seen[:, :1]
        sin = seen[:, 1:2]
        pair = [torch.ones_like(cos), torch.zeros_like(sin)]
        while k > 0:
            if k % 2:
                pair = [pair[0] * cos - pair[1] * sin, pair[1] * cos + pair[0] * sin]
            cos, sin = cos * cos - sin * sin, 2.0 * sin * cos
            k //= 2
        parts += pair
    return torch.cat(parts, dim=1)


def build(policy: PretrainedPolicy, name: str) -> "onnx.ModelProto":
    """Build the ONNX model of a policy and check it.

    Args:
        policy: The policy.
        name: Name of the graph.
    """
    import onnx

    # Hide warnings about operators that the model does not use.
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # torch warns about its own modules
        program: Any = torch.onnx.export(
            Controller(policy),
            (torch.zeros(2, len(policy.observed)),),
            dynamo=True,
            dynamic_shapes=({0: torch.export.Dim("N")},),
            input_names=["observation"],
            output_names=["action", "torque"],
            opset_version=OPSET,
            verbose=False,
        )
    model = program.model_proto
    graph = model.graph
    for part in (graph, *graph.node, *graph.input, *graph.output, *graph.value_info):
        del part.metadata_props[:]  # removes file paths of this machine
    model.producer_name = "jansen_env"
    model.producer_version = jansen_env.__version__
    graph.name = name
    observation = zip(policy.observed, policy.units, strict=True)
    notes = {
        "env_kwargs": policy.env_kwargs,
        "control_dt": policy.control_dt,
        "torque_limit": policy.torque_limit,
        "observation": [{"name": seen, "unit": unit} for seen, unit in observation],
    }
    texts = {key: json.dumps(value) for key, value in notes.items()}
    onnx.helper.set_model_props(model, {"env_id": policy.env_id, **texts})
    onnx.checker.check_model(model, full_check=True)
    return model
