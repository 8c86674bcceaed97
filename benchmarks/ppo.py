"""How fast Stable-Baselines3's PPO trains, and the environments' share of the time.

    python -m benchmarks.ppo [--rounds 7] [--out logs/ppo_speed] [--quick]

``JansenWalker-v0`` in one batch, of as many robots and of four times as many, and ``Walker2d-v5``
in Stable-Baselines3's own default, with the same setting, in turns; and the larger batch with the
hyperparameters that ``train.py`` ships. Writes ``ppo.md``.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from statistics import median
from typing import Any

from benchmarks import measure

OURS, PEER = "JansenWalker-v0", "Walker2d-v5"
ENVIRONMENTS, ROLLOUTS = 64, 5  # side by side; of a round, each with its update
SETTING: dict[str, Any] = {"n_steps": 64, "batch_size": 1024, "n_epochs": 6}
LAYERS = (64, 64)
ROUNDS = 7
NEVER = 10**9  # updates between two lines of a log


class Trainee:
    """PPO with some arguments, and the vector environments that it trains in."""

    def __init__(self, venv: Any, setting: dict[str, Any]) -> None:
        from stable_baselines3 import PPO

        self.inside = 0.0  # s spent in the environments
        for name in ("reset", "step_async", "step_wait"):
            setattr(venv, name, self._timed(getattr(venv, name)))
        self.label = type(venv).__name__
        self.steps = ROLLOUTS * setting["n_steps"] * venv.num_envs
        self.model = PPO("MlpPolicy", venv, policy_kwargs={"net_arch": list(LAYERS)}, seed=0,
                         device="cpu", **setting)  # fmt: skip

    def _timed(self, call: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*arguments: Any) -> Any:
            start = time.perf_counter()
            try:
                return call(*arguments)
            finally:
                self.inside += time.perf_counter() - start

        return timed

    def play(self) -> tuple[float, float]:
        """Train some rollouts on; steps/s, and the environments' share of the time."""
        before, start = self.inside, time.perf_counter()
        self.model.learn(self.steps, log_interval=NEVER, reset_num_timesteps=False)
        spent = time.perf_counter() - start
        return self.steps / spent, (self.inside - before) / spent


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    found = measure.chosen(measure.options(__doc__, "logs/ppo_speed", rounds=ROUNDS), arguments)
    measure.require("stable_baselines3", "mujoco")
    import torch
    from stable_baselines3.common.env_util import make_vec_env as peers_vec_env

    from agents.training.config import new_config
    from jansen_env.sb3 import make_vec_env

    count, setting, rounds = ENVIRONMENTS, SETTING, found.rounds
    if found.quick:
        count, setting, rounds = 4, {"n_steps": 8, "batch_size": 16, "n_epochs": 1}, 1
    torch.set_num_threads(1)  # these networks are small, more threads cost more than they bring
    more = 4 * count
    shipped = new_config()["hyperparameters"]
    shipped = {name: shipped[name] for name in ("batch_size", "n_epochs")}
    trainees = {
        (OURS, count, ""): Trainee(make_vec_env(OURS, count), setting),
        (OURS, more, ""): Trainee(make_vec_env(OURS, more), setting),
        (OURS, more, "as shipped"): Trainee(make_vec_env(OURS, more), {**setting, **shipped}),
        (PEER, count, ""): Trainee(peers_vec_env(PEER, count), setting),
    }
    plays = measure.take_turns({name: trainee.play for name, trainee in trainees.items()}, rounds)
    rates = {name: [rate for rate, _ in pairs] for name, pairs in plays.items()}
    shares = {name: [share for _, share in pairs] for name, pairs in plays.items()}
    rows = [
        (*name, f"`{trainee.label}`", *measure.spread(rates[name]), f"{median(shares[name]):.1%}")
        for name, trainee in trainees.items()
    ]
    head = ("trained on", "at once", "hyperparameters", "in", "steps/s", "lowest", "highest",
            "in the environments")  # fmt: skip
    listed = ", ".join(f"{name} {value}" for name, value in setting.items())
    ratio = measure.ratio(rates[OURS, count, ""], rates[PEER, count, ""])
    measure.report(
        found.out / "ppo.md",
        "# Training",
        f"{measure.machine()} Medians of {rounds} rounds in turns.",
        f"PPO, {listed}, layers {LAYERS}, one thread of torch. As shipped: "
        + ", ".join(f"{name} {value}" for name, value in shipped.items())
        + ".",
        measure.table(head, rows),
        f"Ratio of the steps/s, {count} at once: {ratio}.",
    )


if __name__ == "__main__":
    main()
