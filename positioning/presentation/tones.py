"""What pages and figures share without drawing: controls, and the tones of verdicts."""

CONTROL = "control_"
"""How the names of rows begin that may see the truth."""

GROUPS: dict[str, tuple[str, ...]] = {
    "agrees": ("exact", "reproduced", "holds"),
    "depends on the world": ("depends",),
    "undecided": ("undecided",),
    "differs": ("not reproduced", "fails"),
    "contradicts itself": ("contradicts itself",),
    "not judged": ("calibrated", "none given", "not testable"),
}
"""Verdicts by what they come to; each verdict stands once."""

TONES: dict[str, str] = {
    "exact": "good",
    "reproduced": "good",
    "holds": "good",
    "depends": "mixed",
    "undecided": "mixed",
    "not reproduced": "bad",
    "fails": "bad",
    "contradicts itself": "bad",
    "calibrated": "plain",
    "none given": "plain",
    "not testable": "plain",
}
"""The tone in which a verdict is coloured; the word always stands beside it."""

PALETTES: dict[str, dict[str, tuple[str, str]]] = {
    "light": {
        "good": ("#1b5e20", "#e6f3e7"),
        "bad": ("#8e1b1b", "#fbe9e7"),
        "mixed": ("#6b4a00", "#fff3d1"),
        "plain": ("#37474f", "#eceff1"),
    },
    "dark": {
        "good": ("#a5d6a7", "#14301a"),
        "bad": ("#f6b8b2", "#3b1614"),
        "mixed": ("#ffd98a", "#382b08"),
        "plain": ("#cfd8dc", "#263238"),
    },
}
"""Text and background of each tone, on light and on dark pages."""


def is_control(name: str) -> bool:
    """Say whether a row is a control, which may see the truth and competes with nobody."""
    return name.startswith(CONTROL)
