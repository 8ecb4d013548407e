"""The paper's experiments with the baselines beside them: python -m benchmarks.paper."""
