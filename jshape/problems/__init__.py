"""Problem files that come with jshape: ``jshape tune paper_001`` finds them by name."""
