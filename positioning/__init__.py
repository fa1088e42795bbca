"""The Reposition library: positioning algorithms' parts, worlds, evaluation and presentation."""
