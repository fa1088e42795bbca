"""Checks the configuration and resolves it into studies."""

import ast
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from planning.checks import check_known, check_schema
from planning.entries import BUILT_ON, check_built_on, read_entries
from planning.study import Study
from positioning.errors import InputError
from positioning.files import read_yaml

SCHEMAS = Path("workflow/schemas")
PAPERS = Path("data/papers")


@cache
def read_paper(root: Path, key: str) -> dict[str, Any]:
    """Return what a paper reports; read and checked once, however many studies are of it.

    Raises
    ------
    InputError
        Where its file does not follow the schema, or the limits of a claim ask for what cannot be.
    """
    paper: dict[str, Any] = read_yaml(root / PAPERS / f"{key}.yaml")
    check_schema(paper, root / SCHEMAS / "paper.schema.yaml", f"data/papers/{key}.yaml")
    for claim in paper["claims"]:
        check_limits(claim, f"data/papers/{key}.yaml.claims.{claim['id']}")
    return paper


def check_limits(claim: Mapping[str, Any], where: str) -> None:
    """Check that the limits of a claim ask one thing, and that it can be so.

    Raises
    ------
    InputError
        Where ``outside`` stands beside ``at_least`` or ``at_most``, or two limits descend.
    """
    sides = [key for key in ("at_least", "at_most") if key in claim]
    if "outside" in claim and sides:
        raise InputError(f"{where}.outside", f"{sides[0]} stands beside it", "Keep one of them")
    limits = claim.get("outside") or [claim[key] for key in sides]
    if len(limits) == 2 and float(limits[0]) > float(limits[1]):
        raise InputError(where, f"its limits {limits[0]} and {limits[1]} descend", "Give the smaller first")


def resolve(config: Mapping[str, Any], root: Path = Path()) -> dict[str, Study]:
    """Check a configuration and return its studies.

    Parameters
    ----------
    config
        The configuration as read from ``config/config.yaml`` and overlays.
    root
        The project's folder.

    Raises
    ------
    InputError
        For the first thing that is wrong, before any job starts.
    """
    config = in_order(config, read_yaml(root / "config/config.yaml"))
    for name, study in config.get("studies", {}).items():
        if isinstance(study, Mapping) and "paper" not in study:
            raise InputError(
                f"studies.{name}",
                "it names no paper; is it in an overlay only",
                "Add the study to config/config.yaml, or take it out of the overlay",
            )
    check_schema(config, root / SCHEMAS / "config.schema.yaml", "config")
    papers = sorted(path.stem for path in (root / PAPERS).glob("*.yaml"))
    studies = {}
    for name, values in config["studies"].items():
        key = f"studies.{name}"
        check_known(values["paper"], papers, f"{key}.paper", "paper of data/papers/")
        paper = read_paper(root, values["paper"])
        entries = read_entries(values["algorithms"], f"{key}.algorithms", root)
        sweeps = read_entries(values.get("sweeps", {}), f"{key}.sweeps", root)
        for twice in entries.keys() & sweeps.keys():
            raise InputError(f"{key}.sweeps.{twice}", "a row of the table has this name", "Rename the sweep")
        check_built_on({**entries, **sweeps}, entries, f"{key}.algorithms", root)
        reference = values.get("reference", next(iter(entries)))
        check_known(reference, entries, f"{key}.reference", "row of algorithms")
        study = Study(
            name=name,
            title=values.get("title", name),
            paper=values["paper"],
            batch=values["batch"],
            entries=entries,
            sweeps=sweeps,
            reference=reference,
            worlds=values.get("worlds", 0),
            first_seed=values.get("first_seed", 0),
            recordings={k: v for k, v in values.get("recordings", {}).items() if v is not None},
            calibrate=[
                {**step, "worlds": min(step["worlds"], config.get("calibration_worlds", step["worlds"]))}
                for step in values.get("calibrate", [])
            ],
            families={} if "recordings" in values else _families(values, paper, name),
            figure=values.get("figure", ""),
            scene="" if "recordings" in values else _told(root / f"positioning/simulation/{name}.py"),
            meanings=_meanings(values, key, root),
        )
        for row in study.rows.values():
            for family in row.families:
                known = study.families or study.recordings
                part = "algorithms" if row.name in entries else "sweeps"
                check_known(family, known, f"{key}.{part}.{row.name}.families", "family of worlds")
        if "recordings" not in values:
            _check_synthetic(study, paper, root)
        studies[name] = study
    return studies


def in_order(config: Mapping[str, Any], base: Mapping[str, Any]) -> dict[str, Any]:
    """Return a configuration in the order of the file that it extends, without what is set to null.

    Snakemake puts the keys of an overlay in front. Order matters: the first family of worlds is the
    one that calibrates and that claims speak of, and rows stand in the table as they stand here.
    """
    keys = [*(key for key in base if key in config), *(key for key in config if key not in base)]
    ordered = {}
    for key in keys:
        value, below = config[key], base.get(key)
        if isinstance(value, Mapping):
            value = in_order(value, below if isinstance(below, Mapping) else {})
        ordered[key] = value
    for part in ("studies", "families", "recordings", "algorithms", "sweeps"):
        if isinstance(ordered.get(part), Mapping):
            ordered[part] = {name: entry for name, entry in ordered[part].items() if entry is not None}
    return ordered


def _families(values: Mapping[str, Any], paper: Mapping[str, Any], study: str) -> dict[str, dict[str, Any]]:
    """Settings of every world family: the paper's, over these the study's, over these the family's."""
    reported = {name: setting["value"] for name, setting in paper["settings"].get(study, {}).items()}
    shared = values.get("world", {})
    families = {
        family: {name: value for name, value in (own or {}).items() if name != "meaning"}
        for family, own in (values.get("families") or {"worlds": {}}).items()
    }
    for where, names in (("world", shared), *((f"families.{f}", v) for f, v in families.items())):
        for name in names:
            check_known(
                name,
                reported,
                f"studies.{study}.{where}.{name}",
                f"setting of data/papers/{values['paper']}.yaml",
            )
    return {family: {**reported, **shared, **own} for family, own in families.items()}


def _meanings(values: Mapping[str, Any], key: str, root: Path) -> dict[str, str]:
    """Return what is said of families, and of recordings what the adapter's first line says, by name."""
    found = {}
    for name, family in values.get("families", {}).items():
        text = (family or {}).get("meaning", "")
        if not isinstance(text, str):
            raise InputError(f"{key}.families.{name}.meaning", f"{text!r} is no text", "Say it in words")
        found[name] = text
    for name, options in values.get("recordings", {}).items():
        found[name] = _told(root / f"positioning/recordings/{(options or {}).get('adapter')}.py")
    return found


def _told(module: Path) -> str:
    """Return the first line of a module's docstring without importing it; empty where there is none."""
    if not module.is_file():
        return ""
    return (ast.get_docstring(ast.parse(module.read_text(encoding="utf-8"))) or "").partition("\n")[0]


def _check_synthetic(study: Study, paper: Mapping[str, Any], root: Path) -> None:
    key = f"studies.{study.name}"
    simulation = Path("positioning/simulation") / f"{study.name}.py"
    if not (root / simulation).is_file():
        raise InputError(
            key, f"there is no {simulation}", "Add the module that simulates this study's worlds"
        )
    claims = {claim["id"]: claim for claim in paper["claims"]}
    ranges = [(f"{key}.worlds", study.first_seed, study.worlds)]
    for number, calibration in enumerate(study.calibrate):
        where = f"{key}.calibrate[{number}]"
        check_known(calibration["algorithm"], study.entries, f"{where}.algorithm", "row of algorithms")
        if BUILT_ON.keys() & study.entries[calibration["algorithm"]].options.keys():
            raise InputError(
                f"{where}.algorithm",
                f"{calibration['algorithm']} builds on another row",
                "Calibrate on a row that stands alone",
            )
        check_known(calibration["claim"], claims, f"{where}.claim", "claim of the paper")
        if "family" in calibration:
            check_known(calibration["family"], study.families, f"{where}.family", "family of worlds")
        claim = claims[calibration["claim"]]
        hits = {k: calibration[k] for k in ("algorithm", "metric", "family") if k in calibration}
        if hits.get("family") == next(iter(study.families)) and "family" not in claim.get("quantity", {}):
            del hits["family"]
        if claim["kind"] != "value" or claim["quantity"] != hits:
            raise InputError(
                f"{where}.claim",
                f"{claim['id']} speaks of {claim.get('quantity')}, the calibration of {hits}",
                "Name the claim whose printed number the calibration shall reach",
            )
        settings = next(iter(study.families.values()))
        check_known(calibration["setting"], settings, f"{where}.setting", "setting")
        for name in calibration.get("settings", {}):
            others = [other for other in settings if other != calibration["setting"]]
            check_known(name, others, f"{where}.settings", "other setting")
        ranges.append((where, calibration["first_seed"], calibration["worlds"]))
    for i, (name, first, count) in enumerate(ranges):
        for other, other_first, other_count in ranges[i + 1 :]:
            if first < other_first + other_count and other_first < first + count:
                raise InputError(
                    other,
                    f"its seeds {other_first} to {other_first + other_count - 1} overlap with"
                    f" {first} to {first + count - 1} of {name}",
                    "Choose a first_seed outside: worlds that calibrate must not be worlds that judge",
                )
