"""Of a model card how to run each file, with code that is complete and an answer to compare."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents import export_c
from jansen_env.pretrained import PretrainedPolicy


def code(text: Any) -> str:
    """Text of any source as code within a line, also of a table."""
    plain = "".join(c if c.isprintable() else "_" for c in " ".join(str(text).split()))
    return f"`{plain.replace('`', chr(39)).replace('|', '/') or ' '}`"


def examples(
    policy: PretrainedPolicy, name: str, kinds: tuple[str, ...], observation: NDArray[np.float32]
) -> list[str]:
    """How to run each file, in Markdown.

    Args:
        name: of the files. kinds: of them, see :class:`agents.model_card.Export`.
        observation: (d,) to show it with.
    """
    numbers = [float(f"{x:.4g}") for x in observation.tolist()]
    action, _ = policy.predict(np.array([numbers], np.float32))
    found = f"{action[0, 0]:.4f}"
    parts = []
    if "onnx" in kinds:
        parts.append(
            "ONNX, any number of robots at once:\n\n```python\n"
            f"{_onnx_example(name, numbers)}```\n\nprints {found}."
        )
    if "c" in kinds:
        parts.append(
            f"C99, for a microcontroller; {_cost(policy, name)} As a program:\n\n```c\n"
            f"{export_c.example(name)}```\n\n```bash\ncc -std=c99 -O2 -o main main.c {name}.c -lm\n"
            f"echo '{' '.join(map(str, numbers))}' | ./main\n```\n\nprints {found}. Places of "
            f"observations are {code(export_c.places(policy, name)[0])} and so on."
        )
    if "safetensors" in kinds:
        parts.append(
            "Python with jansen_env, which needs nothing but NumPy for it:\n\n```python\n"
            f"{_numpy_example(name, numbers)}```\n\nprints {found}."
        )
    return parts


def _onnx_example(name: str, numbers: list[float]) -> str:
    return (
        "import numpy as np\nimport onnxruntime\n\n"
        f'session = onnxruntime.InferenceSession("{name}.onnx")\n'
        f"observation = np.array([{numbers}], np.float32)  # (robots, numbers)\n"
        'action, torque = session.run(["action", "torque"], {"observation": observation})\n'
        'print(f"{action[0, 0]:.4f}")\n'
    )


def _numpy_example(name: str, numbers: list[float]) -> str:
    return (
        "import numpy as np\nfrom jansen_env import pretrained\n\n"
        f'policy = pretrained.load_file("{name}.json")\n'
        f"observation = np.array([{numbers}], np.float32)\n"
        "action, _ = policy.predict(observation)\n"
        'print(f"{action[0, 0]:.4f}")\n'
    )


def _cost(policy: PretrainedPolicy, name: str) -> str:
    cost = export_c.sizes(policy)
    return (
        f"constants take {cost.constants} bytes of flash and arrays on the stack "
        f"{cost.stack} bytes of RAM (code comes on top); a step takes {cost.multiply_adds} "
        f"multiplications with additions and {cost.functions} calls of functions of math.h. "
        f"Computed in double; with {code(f'-D{name.upper()}_SINGLE_PRECISION')} in float, with "
        "half of the stack."
    )
