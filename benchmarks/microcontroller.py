"""What a policy as C costs on a microcontroller, and whether it acts as the one in PyTorch.

    python -m benchmarks.microcontroller [--out logs/microcontroller] [--quick]

Compiles the shipped policies for a Cortex-M4 with a floating-point unit of single precision, in
double and in float, and runs each on 1,000 observations on QEMU's board mps2-an386. QEMU counts
instructions; the cycles of a real processor are more. Needs Debian's packages gcc-arm-none-eabi,
libnewlib-arm-none-eabi and qemu-system-arm. Writes ``microcontroller.md``.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from agents.export import agreement, c_source
from agents.pack import in_float64
from agents.tasks import TASKS
from agents.unpack import to_policy
from benchmarks import measure
from jansen_env import pretrained
from jansen_env.pretrained import PretrainedPolicy

COMPILER, SIZE, MACHINE = "arm-none-eabi-gcc", "arm-none-eabi-size", "qemu-system-arm"
CORE = ("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16", "-O2")
BOARD = (
    "-M", "mps2-an386", "-icount", "shift=0", "-nographic", "-monitor", "none", "-serial", "none",
    "-semihosting-config", "enable=on,target=native",
)  # fmt: skip
PACKAGES = ("gcc-arm-none-eabi", "libnewlib-arm-none-eabi", "qemu-system-arm")
PER_TICK = 40  # instructions: one each ns of a clock of 25 MHz
# What the example program lacks on a bare board: where it starts, observations from a file, and
# around each step a look at the system timer, which counts down in 24 bits.
STARTUP = """\
#include <stdint.h>
#include <stdio.h>
#include "policy.h"

#define REGISTER(address) (*(volatile uint32_t *)(address))

extern void _start(void);
int __real_policy_step(const float *, float *);
int __wrap_policy_step(const float *, float *);
static uint32_t ticks, steps;

static void reset(void)
{
    REGISTER(0xE000ED88) |= 0xFu << 20; /* the floating-point unit on */
    __asm volatile("dsb; isb");
    _start();
}

__attribute__((section(".vectors"), used)) static const void *const vectors[2] = {
    (const void *)0x20400000, (const void *)reset};

__attribute__((constructor)) static void begin(void)
{
    freopen("observations.txt", "r", stdin);
    REGISTER(0xE000E014) = 0xFFFFFF;
    REGISTER(0xE000E018) = 0;
    REGISTER(0xE000E010) = 5; /* the timer on, at the processor's clock */
}

int __wrap_policy_step(const float *observation, float *action)
{
    uint32_t before = REGISTER(0xE000E018);
    int found = __real_policy_step(observation, action);

    ticks += (before - REGISTER(0xE000E018)) & 0xFFFFFF;
    ++steps;
    return found;
}

__attribute__((destructor)) static void end(void)
{
    printf("%f\\n", (double)ticks / steps);
}
"""


class Cost(NamedTuple):
    """Of a policy on the microcontroller.

    Attributes:
        flash: bytes, with what it takes of the C library. stack: bytes of a step's own frame.
        instructions: of a step. difference: of an action to PyTorch's in float64.
    """

    flash: int
    stack: int
    instructions: float
    difference: float


def missing() -> list[str]:
    """The programs that are not here."""
    return [name for name in (COMPILER, SIZE, MACHINE) if shutil.which(name) is None]


def cost(policy: PretrainedPolicy, single: bool, count: int) -> Cost:
    """Of a policy in float or in double, on so many observations."""
    cases = agreement.make_cases(policy, count)
    expected = agreement.actions_of(in_float64(to_policy(policy)), cases)
    texts = {
        **c_source.sources(policy, "policy"),
        "main.c": c_source.example(policy, "policy"),
        "startup.c": STARTUP,
        "observations.txt": agreement.as_text(cases),
    }
    options = [COMPILER, *CORE, *(["-DPOLICY_SINGLE_PRECISION"] if single else [])]
    with tempfile.TemporaryDirectory() as folder:

        def run(*words: str) -> str:
            done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
            if done.returncode != 0:
                raise RuntimeError(f"{' '.join(words)} failed: {done.stderr.strip()}")
            return done.stdout

        for name, text in texts.items():
            (Path(folder) / name).write_text(text, encoding="ascii")
        run(*options, "-std=c99", "-fstack-usage", "-c", "policy.c")
        used = (Path(folder) / "policy.su").read_text(encoding="ascii")
        stack = max(int(line.split("\t")[1]) for line in used.splitlines())
        run(*options, "--specs=nosys.specs", "-nostartfiles", "-Wl,--gc-sections",
            "-Wl,--entry=policy_step", "-o", "alone", "policy.o", "-lm")  # fmt: skip
        text_size, data_size = map(int, run(SIZE, "alone").splitlines()[1].split()[:2])
        run(*options, "-std=gnu99", "--specs=rdimon.specs", "-Wl,--wrap=policy_step",
            "-Wl,--section-start=.vectors=0", "-o", "program", "startup.c", "main.c", "policy.o",
            "-lm")  # fmt: skip
        *actions, ticks = run(MACHINE, *BOARD, "-kernel", "program").split()
    difference = agreement.largest_difference(np.array(actions, float), expected)
    return Cost(text_size + data_size, stack, PER_TICK * float(ticks), difference)


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = measure.options(__doc__, "logs/microcontroller")
    found = measure.chosen(parser, arguments)
    if lacking := missing():
        parser.error(f"there is no {', '.join(lacking)}; Debian has them in {', '.join(PACKAGES)}")
    rows = []
    for env_id in TASKS:
        for single in (False, True):
            own = cost(pretrained.load(env_id), single, 100 if found.quick else 1000)
            rows.append((
                f"`{env_id}`", "float" if single else "double", f"{own.flash:,}", f"{own.stack:,}",
                f"{round(own.instructions, -3):,.0f}", f"{own.difference:.1e}",
            ))  # fmt: skip
    head = ("policy of", "arithmetic", "flash", "stack", "instructions", "largest difference")
    measure.report(
        found.out / "microcontroller.md",
        "# Policies on a microcontroller",
        f"`python -m benchmarks.microcontroller`, by {COMPILER} {' '.join(CORE)} on QEMU's "
        "mps2-an386. Of one step: bytes of flash, with what it takes of the C library, and of its "
        "own frame on the stack; instructions; largest difference of an action to PyTorch's in "
        "float64.",
        measure.table(head, rows),
    )


if __name__ == "__main__":
    main()
