"""The closed loop: strategies on a sampled flexible link whose load changes, and their metrics."""
