"""Problem files: ``schema`` and ``problem`` check and read them; ``jshape tune paper_001`` finds the shipped ones."""
