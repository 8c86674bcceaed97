"""Train with Stable-Baselines3: configuration, models, callbacks, runs."""
