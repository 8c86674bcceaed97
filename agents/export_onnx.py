"""A policy as an ONNX graph: scaling, network, clipping and torque limit in one file.

The input is ``observation`` (N, d) float32; outputs are ``action`` (N, 1), from -1 to 1, and
``torque`` (N, 1), N m. N is free. All is computed in float64 and rounded to float32 at the end, as
:meth:`jansen_env.pretrained.PretrainedPolicy.predict` does.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np

try:
    import onnx
    from onnx import TensorProto, checker, helper, numpy_helper
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        "an export to ONNX needs the package onnx, which the extra 'export' installs: "
        'python -m pip install "jansen-env[export]", or in a checkout -e ".[export]"',
        name=error.name,
    ) from error

import jansen_env
from jansen_env.policy_network import Features, Harmonics, Layer, Normalized
from jansen_env.pretrained import PretrainedPolicy

OPSET, IR_VERSION = 17, 8  # of 2022, which runtimes of today read
SMALL = 16  # numbers; larger constants are stored as float32 where that is exact


class Graph:
    """Nodes and constants as they are added; a value is known by its name.

    Attributes:
        nodes, constants: as a graph has them.
    """

    def __init__(self) -> None:
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def add(self, operator: str, *inputs: Any, **attributes: Any) -> str:
        """The output of a node; inputs that are no names are constants."""
        names = [one if isinstance(one, str) else self.constant(one) for one in inputs]
        output = f"{operator.lower()}_{len(self.nodes)}"
        self.nodes.append(helper.make_node(operator, names, [output], output, **attributes))
        return output

    def constant(self, value: Any) -> str:
        """Numbers: floats as float64."""
        array = np.asarray(value)
        name = f"constant_{len(self.constants)}"
        small = array.astype(np.float32) if array.dtype == np.float64 else array
        exact = array.size > SMALL and np.array_equal(small.astype(array.dtype), array)
        self.constants.append(numpy_helper.from_array(small if exact else array, name))
        if exact and array.dtype == np.float64:
            return self.add("Cast", name, to=TensorProto.DOUBLE)
        return name

    def column(self, values: str, place: int) -> str:
        """(N, 1) of values (N, d)."""
        return self.add("Gather", values, np.array([place]), axis=1)

    def clip(self, values: str, limit: float) -> str:
        """Values between -limit and limit."""
        return self.add("Clip", values, -limit, limit)


def build(policy: PretrainedPolicy, name: str) -> onnx.ModelProto:
    """The model of a policy, checked.

    Args:
        name: of the graph.
    """
    graph = Graph()
    table = "\n".join(
        f"{i}: {seen}, {unit}"
        for i, (seen, unit) in enumerate(zip(policy.observed, policy.units, strict=True))
    )
    shape = ["N", len(policy.observed)]
    inputs = [_value("observation", shape, f"Name and unit of each number:\n{table}")]
    outputs = [
        _value("action", ["N", 1], "Crank torque as a share of torque_limit, -1 to 1."),
        _value("torque", ["N", 1], f"Crank torque, N m, held for {policy.control_dt:g} s."),
    ]
    seen = graph.add("Cast", "observation", to=TensorProto.DOUBLE)
    blocks = [_feature(graph, block, seen) for block in policy.features]
    values = graph.add("Concat", *blocks, axis=1)
    for layer in policy.layers:
        values = _layer(graph, layer, values)
    if np.isfinite(policy.limit):
        values = graph.clip(values, policy.limit)
    if policy.squash == "tanh":
        values = graph.add("Tanh", values)
    values = graph.clip(values, 1.0)
    graph.nodes.append(helper.make_node("Cast", [values], ["action"], "action", to=1))
    torque = graph.add("Mul", values, policy.torque_limit)
    graph.nodes.append(helper.make_node("Cast", [torque], ["torque"], "torque", to=1))
    text = f"{name}: a policy of {policy.env_id}, of an observation the torque on the crank."
    model = helper.make_model(
        helper.make_graph(graph.nodes, name, inputs, outputs, graph.constants, text),
        opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION,
        producer_name="jansen_env", producer_version=jansen_env.__version__, doc_string=text,
    )  # fmt: skip
    helper.set_model_props(model, metadata(policy))
    checker.check_model(model, full_check=True)
    return model


def metadata(policy: PretrainedPolicy) -> dict[str, str]:
    """What a model says of itself, each entry JSON but for the environment's id."""
    rows = zip(policy.observed, policy.units, strict=True)
    return {
        "env_id": policy.env_id,
        "env_kwargs": json.dumps(policy.env_kwargs),
        "control_dt": json.dumps(policy.control_dt),  # s
        "torque_limit": json.dumps(policy.torque_limit),  # N m
        "observation": json.dumps([{"name": name, "unit": unit} for name, unit in rows]),
    }


def _value(name: str, shape: list[Any], text: str) -> Any:
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, shape, text)


def _feature(graph: Graph, block: Features, seen: str) -> str:
    """Features (N, size) of an observation."""
    if isinstance(block, Normalized):
        scaled = graph.add("Div", graph.add("Sub", seen, block.mean), block.deviation)
        return graph.clip(scaled, block.clip)
    if isinstance(block, Harmonics):
        return _harmonics(graph, seen, block.multiples)
    return seen


def _harmonics(graph: Graph, seen: str, multiples: tuple[int, ...]) -> str:
    """cos k psi, sin k psi (N, 2 m) by doubling and adding angles."""
    one = graph.column(seen, 0), graph.column(seen, 1)
    powers = {1: one}

    def power(k: int) -> tuple[str, str]:
        if k == 0:
            zeros = graph.add("Mul", one[0], 0.0)
            return graph.add("Add", zeros, 1.0), zeros
        if k not in powers:
            half = power(k // 2)
            square = _product(graph, half, half)
            powers[k] = _product(graph, square, one) if k % 2 else square
        return powers[k]

    return graph.add("Concat", *(part for k in multiples for part in power(k)), axis=1)


def _product(graph: Graph, x: tuple[str, str], y: tuple[str, str]) -> tuple[str, str]:
    """Of complex numbers."""
    rr, ii = graph.add("Mul", x[0], y[0]), graph.add("Mul", x[1], y[1])
    ri, ir = graph.add("Mul", x[0], y[1]), graph.add("Mul", x[1], y[0])
    return graph.add("Sub", rr, ii), graph.add("Add", ri, ir)


def _layer(graph: Graph, layer: Layer, values: str) -> str:
    # No Gemm, nor Add: onnxruntime before 1.18 fuses them with what follows, for which it has no
    # float64.
    values = graph.add("Sub", graph.add("MatMul", values, layer.weight.T), -layer.bias)
    if layer.activation is None:
        return values
    if layer.activation == "elu":  # not of float64 in onnxruntime
        below = graph.add("Sub", graph.add("Exp", graph.add("Min", values, 0.0)), 1.0)
        return graph.add("Where", graph.add("Greater", values, 0.0), values, below)
    return graph.add({"tanh": "Tanh", "relu": "Relu"}[layer.activation], values)


class OnnxPolicy:
    """A model as a policy, run by any of ``onnxruntime.InferenceSession`` and
    ``onnx.reference.ReferenceEvaluator``.

    Args:
        session: has the method ``run``.
    """

    def __init__(self, session: Any) -> None:
        self._session = session

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[Any, Any]:
        """Actions (n, 1) for observations (n, d), and the state as given."""
        given = {"observation": np.asarray(observation, np.float32)}
        return self._session.run(["action"], given)[0], state
