"""Turns the configuration into the plan of the workflow; imported by the Snakefile, light to load."""
