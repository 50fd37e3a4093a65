"""Studies of adaptive strategies."""
