"""Search hyperparameters with Optuna, which ends poor trials early.

Run the example as follows. It writes best.yml.

    python examples/tune_with_optuna.py [ALGO] [TRIALS] [STEPS]

The defaults are ppo and 16 trials of 800,000 steps, which take half an hour. For the other
algorithms, the configurations in the package were found with 12 trials; see docs/studies.md.

The example requires the extra `design`, which installs Optuna.
"""

import sys
from dataclasses import asdict, replace
from pathlib import Path

import optuna
import yaml
from stable_baselines3.common.callbacks import BaseCallback

from agents.training.config import new_config
from agents.training.runs import read_evaluations, record_run
from agents.training.train_model import prepare, train

algo, trials, steps = (sys.argv[1:] + ["ppo", "16", "800000"][len(sys.argv) - 1 :])[:3]


class Pruning(BaseCallback):
    """Callback that reports each evaluation to Optuna and ends a poor trial."""

    def __init__(self, trial: optuna.Trial, folder: Path) -> None:
        super().__init__()
        self.trial, self.folder, self.seen = trial, folder, 0

    def _on_rollout_start(self) -> None:
        rows = read_evaluations(self.folder)
        if len(rows) > self.seen:
            self.seen = len(rows)
            self.trial.report(max(row["return"] for row in rows), self.seen)
            if self.trial.should_prune():  # below the median of the previous trials
                raise optuna.TrialPruned

    def _on_step(self) -> bool:
        return True


def searched(trial: optuna.Trial) -> tuple[dict, dict, dict]:
    """Return hyperparameters, policy arguments and further configuration entries of a trial."""
    pick, real = trial.suggest_categorical, trial.suggest_float
    lowest, highest = (5e-3, 0.1) if algo == "ars" else (1e-4, 3e-3)
    found = {"learning_rate": f"linear_{real('learning_rate', lowest, highest, log=True):.3g}"}
    if algo == "ppo":
        units = pick("units", [32, 64, 128])
        found["n_epochs"] = trial.suggest_int("n_epochs", 3, 12)
        return found, {"net_arch": [units, units]}, {}
    if algo == "ars":
        found["delta_std"] = real("delta_std", 0.02, 0.3, log=True)
        return {**found, "n_delta": pick("n_delta", [8, 16, 32])}, {}, {}
    found["gamma"] = pick("gamma", [0.98, 0.99, 0.995])
    found["gradient_steps"] = pick("gradient_steps", [2, 4, 8])
    if algo != "crossq":
        found["tau"] = pick("tau", [0.005, 0.01, 0.02])
    if algo == "td3":
        found["action_noise"] = pick("action_noise", [0.3, 0.5, 0.8])
    else:
        found["ent_coef"] = pick("ent_coef", ["auto_0.01", "auto_0.1"])
    return found, {}, {"reward_scale": pick("reward_scale", [0.1, 0.3, 1.0])}


def objective(trial: optuna.Trial) -> float:
    """Train the configuration of a trial and return the best return of its evaluations."""
    folder = Path("tune") / algo / str(trial.number)
    hyperparameters, network, entries = searched(trial)
    config = new_config(
        None, algo, timesteps=int(steps), hyperparameters=hyperparameters, policy_kwargs=network
    )
    config = replace(config, **entries)
    record_run(folder, config, "tune_with_optuna.py")
    # Evaluations that are more frequent than rollouts are useless.
    rollout = config.n_envs * config.hyperparameters.get("n_steps", 1)
    train(
        prepare(config),
        config,
        folder,
        eval_every=max(int(steps) // 8, rollout),
        save_every=0,
        progress=False,
        more_callbacks=[Pruning(trial, folder)],
    )
    trial.set_user_attr("config", asdict(config))
    return max(row["return"] for row in read_evaluations(folder))


study = optuna.create_study(
    storage="sqlite:///tune.db", study_name=algo, direction="maximize", load_if_exists=True
)
study.optimize(objective, n_trials=max(int(trials) - len(study.trials), 0))
Path("best.yml").write_text(yaml.safe_dump(study.best_trial.user_attrs["config"]))
print(f"best return {study.best_value:.0f}, for train.py --config best.yml: {study.best_params}")
