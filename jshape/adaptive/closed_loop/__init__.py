"""The closed loop: strategies on a sampled flexible link whose load changes, and how they are judged."""
