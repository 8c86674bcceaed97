"""Training: Stable-Baselines3's PPO on ``JansenWalker-v0`` and on ``Walker2d-v5``, one setting.

The environments stand side by side as each is meant to: ours in one batch, the peer in
Stable-Baselines3's own default. Some rollouts with their updates make a round.
"""

from __future__ import annotations

import time
from statistics import median
from typing import Any

from benchmarks.rounds import Goal, ratio, table, take_turns
from benchmarks.speed_single import MUJOCO, OURS

NEEDS = ("mujoco", "stable_baselines3")
ENVIRONMENTS, QUICK_ENVIRONMENTS = 64, 4
SETTING: dict[str, Any] = {"n_steps": 64, "batch_size": 1024, "n_epochs": 6}
QUICK_SETTING: dict[str, Any] = {"n_steps": 8, "batch_size": 16, "n_epochs": 1}
LAYERS = (64, 64)
ROLLOUTS = 5  # of a round
NEVER = 10**9  # updates between two lines of a log
TORCH_THREADS = 1  # these networks are small, more threads cost more than they bring


class Trainee:
    """A model and its environments.

    Args:
        venv: a vector environment of Stable-Baselines3's. setting: PPO's arguments.
    """

    def __init__(self, venv: Any, setting: dict[str, Any]) -> None:
        from stable_baselines3 import PPO
        from stable_baselines3.common.vec_env import VecEnvWrapper

        class Timed(VecEnvWrapper):
            """Adds up the time spent inside the environments."""

            spent = 0.0

            def reset(self) -> Any:
                return self._time(self.venv.reset)

            def step_async(self, actions: Any) -> None:
                self._time(lambda: self.venv.step_async(actions))

            def step_wait(self) -> Any:
                return self._time(self.venv.step_wait)

            def _time(self, call: Any) -> Any:
                start = time.perf_counter()
                try:
                    return call()
                finally:
                    self.spent += time.perf_counter() - start

        self.timed = Timed(venv)
        self.steps = ROLLOUTS * setting["n_steps"] * venv.num_envs
        self.kind = type(venv.unwrapped).__name__
        self.model = PPO(
            "MlpPolicy", self.timed, policy_kwargs={"net_arch": list(LAYERS)}, seed=0,
            device="cpu", **setting,
        )  # fmt: skip

    def play(self) -> tuple[float, float]:
        """Train some rollouts on; steps/s, and the environments' share of the time."""
        inside, start = self.timed.spent, time.perf_counter()
        self.model.learn(self.steps, log_interval=NEVER, reset_num_timesteps=False)
        elapsed = time.perf_counter() - start
        return self.steps / elapsed, (self.timed.spent - inside) / elapsed


def measure(rounds: int, quick: bool) -> dict[str, Any]:
    """Training rates, and how much of the time the environments take; ready for JSON."""
    import torch
    from stable_baselines3.common.env_util import make_vec_env as peers_vec_env

    from agents.vec_env import make_vec_env

    count, setting = (QUICK_ENVIRONMENTS, QUICK_SETTING) if quick else (ENVIRONMENTS, SETTING)
    threads = torch.get_num_threads()
    torch.set_num_threads(TORCH_THREADS)
    try:
        trainees = {
            OURS: Trainee(make_vec_env(OURS, count, {}), setting),
            MUJOCO: Trainee(peers_vec_env(MUJOCO, count), setting),
        }
        found = take_turns({name: trainee.play for name, trainee in trainees.items()}, rounds)
    finally:
        torch.set_num_threads(threads)
    for trainee in trainees.values():
        trainee.timed.close()
    rates = {name: [rate for rate, _ in plays] for name, plays in found.items()}
    shares = {name: [share for _, share in plays] for name, plays in found.items()}
    return {
        "environments": count,
        "setting": {**setting, "layers": LAYERS, "torch_threads": TORCH_THREADS},
        "steps_per_round": trainees[OURS].steps,
        "trained": {
            name: {
                "vector_environment": trainee.kind,
                "steps_per_second": median(rates[name]),
                "rounds": rates[name],
                "environment_share": median(shares[name]),
                "environment_shares": shares[name],
            }
            for name, trainee in trainees.items()
        },
        **ratio(rates[OURS], rates[MUJOCO]),
    }


def report(result: dict[str, Any]) -> str:
    """The result as a table."""
    rows = [
        (
            name, f"`{run['vector_environment']}`", f"{run['steps_per_second']:,.0f}",
            f"{min(run['rounds']):,.0f}", f"{max(run['rounds']):,.0f}",
            f"{100 * run['environment_share']:.1f}",
        )
        for name, run in result["trained"].items()
    ]  # fmt: skip
    setting = ", ".join(f"{name} {value}" for name, value in result["setting"].items())
    low, high = result["range"]
    return "\n\n".join(
        [
            f"PPO, {result['environments']} environments, {setting}.",
            table(("trained on", "in", "steps/s", "lowest", "highest", "environments' %"), rows),
            f"Ratio of the steps/s {result['ratio']:.2f}, by round {low:.2f} to {high:.2f}.",
        ]
    )


def goals(result: dict[str, Any]) -> list[Goal]:
    """Where the ratio and the environments' share should be."""
    share = 100.0 * result["trained"][OURS]["environment_share"]
    return [
        Goal(f"training steps/s over {MUJOCO}'s", result["ratio"], "at least", 2.0),
        Goal("environments' share of training, %", share, "at most", 10.0),
    ]
