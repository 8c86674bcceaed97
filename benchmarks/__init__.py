"""Speed benchmarks; run one of them with ``python -m benchmarks.NAME``."""
