"""The paper's experiments, with baselines: python -m benchmarks.paper."""
