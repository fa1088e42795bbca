"""Figures and pages that one study has for itself; a study without a module gets the common ones."""
