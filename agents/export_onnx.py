"""A policy as an ONNX graph: scaling, network, clipping and torque limit in one file.

Inputs are ``observation`` (N, d) float32 and, of a policy with a history, ``memory`` (N, steps, d)
float32 and ``episode_start`` (N,) bool; outputs ``action`` (N, 1), from -1 to 1, ``torque`` (N, 1),
N m, and ``next_memory``. N is free. All is computed in float64 and rounded to float32 at the end,
as :meth:`jansen_env.pretrained.PretrainedPolicy.predict` does.
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
    graph, size, steps = Graph(), len(policy.observed), policy.history.steps
    remembers = policy.history.length > 1
    table = "\n".join(
        f"{i}: {seen}, {unit}"
        for i, (seen, unit) in enumerate(zip(policy.observed, policy.units, strict=True))
    )
    inputs = [_value("observation", ["N", size], f"Name and unit of each number:\n{table}")]
    outputs = [
        _value("action", ["N", 1], "Crank torque as a share of torque_limit, -1 to 1."),
        _value("torque", ["N", 1], f"Crank torque, N m, held for {policy.control_dt:g} s."),
    ]
    own = graph.add("Cast", "observation", to=TensorProto.DOUBLE)
    seen = own
    if remembers:
        inputs += [
            _value("memory", ["N", steps, size], "next_memory of the step before; any at a start."),
            _value("episode_start", ["N"], "Whether an episode starts.", TensorProto.BOOL),
        ]
        outputs.append(_value("next_memory", ["N", steps, size], "The last observations."))
        seen = _remember(graph, policy)
    blocks = [_feature(graph, block, seen, own) for block in policy.features]
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
    history = policy.history
    rows = zip(policy.observed, policy.units, strict=True)
    return {
        "env_id": policy.env_id,
        "env_kwargs": json.dumps(policy.env_kwargs),
        "control_dt": json.dumps(policy.control_dt),  # s
        "torque_limit": json.dumps(policy.torque_limit),  # N m
        "observation": json.dumps([{"name": name, "unit": unit} for name, unit in rows]),
        "history": json.dumps({"length": history.length, "every": history.every}),
    }


def _value(name: str, shape: list[Any], text: str, kind: int = TensorProto.FLOAT) -> Any:
    return helper.make_tensor_value_info(name, kind, shape, text)


def _remember(graph: Graph, policy: PretrainedPolicy) -> str:
    """(N, length d) what is seen, as :meth:`jansen_env.history.History.extend`; and next_memory."""
    steps, every = policy.history.steps, policy.history.every
    present = graph.add("Unsqueeze", "observation", np.array([1]))
    kept = graph.add("Slice", "memory", *(np.array([n]) for n in (0, steps - 1, 1)))
    later = graph.add("Concat", present, kept, axis=1)
    first = graph.add("Expand", present, np.array([1, steps, 1]))
    starts = graph.add("Reshape", "episode_start", np.array([-1, 1, 1]))
    graph.nodes.append(
        helper.make_node("Where", [starts, first, later], ["next_memory"], "next_memory")
    )
    seen = graph.add("Gather", "next_memory", np.arange(0, steps, every), axis=1)
    return graph.add("Cast", graph.add("Flatten", seen, axis=1), to=TensorProto.DOUBLE)


def _feature(graph: Graph, block: Features, seen: str, own: str) -> str:
    """Features (N, size) of what is seen; own: the present observation alone."""
    if isinstance(block, Normalized):
        scaled = graph.add("Div", graph.add("Sub", seen, block.mean), block.deviation)
        return graph.clip(scaled, block.clip)
    if isinstance(block, Harmonics):
        return _harmonics(graph, own, block.multiples)
    return seen


def _harmonics(graph: Graph, own: str, multiples: tuple[int, ...]) -> str:
    """cos k psi, sin k psi (N, 2 m) by doubling and adding angles."""
    one = graph.column(own, 0), graph.column(own, 1)
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
        session: has the method ``run``. policy: that the model was built of.
    """

    def __init__(self, session: Any, policy: PretrainedPolicy) -> None:
        self._session = session
        self._memory = policy.history.steps, len(policy.observed)
        self._remembers = policy.history.length > 1

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = True,
    ) -> tuple[Any, Any]:
        """Actions (n, 1) for observations (n, d), and the memory to pass back."""
        given = {"observation": np.asarray(observation, np.float32)}
        if not self._remembers:
            return self._session.run(["action"], given)[0], state
        n = len(given["observation"])
        given["memory"] = np.zeros((n, *self._memory), np.float32) if state is None else state
        starts = np.ones(n, bool) if state is None else np.asarray(episode_start, bool)
        given["episode_start"] = np.broadcast_to(starts, n)
        actions, memory = self._session.run(["action", "next_memory"], given)
        return actions, memory
