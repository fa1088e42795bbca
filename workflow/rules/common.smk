# Helper functions of the rules: the plan of the configuration, and which code a job depends on.
import re
import shlex
import sys
from pathlib import Path

sys.path.insert(0, str(Path(workflow.basedir) / "workflow"))

from planning.code import code_of
from planning.config import resolve
from planning.recordings import drop_absent, files_of
from planning.values import check_options, check_values
from positioning.errors import InputError
from positioning.files import read_yaml
from positioning.presentation.captions import Captions, label
from snakemake.exceptions import WorkflowError

# Snakemake hands the interpreter's path to a shell without quotes (its issue 2645).
sys.executable = shlex.quote(sys.executable)

try:
    planned = resolve(config)
    check_options(planned)
    STUDIES = drop_absent(planned, Path(config["folders"]["realdata"]))
    # A job of a cluster reads this file, too: what the first start has tried need not be tried again.
    if workflow.is_main_process:
        check_values(STUDIES, config["studies"])
except InputError as error:
    raise WorkflowError(str(error)) from None

DATA, RESULTS, REPORTS, REALDATA = (
    config["folders"][folder] for folder in ("data", "results", "reports", "realdata")
)
ENVIRONMENT = "../envs/reposition.yaml"
GOLDEN = "tests/golden/claims.csv"
TEMPLATES = sorted(
    str(path) for path in Path("positioning/presentation/templates").iterdir()
)
# What the pages tell of each study.
PLANS = {
    name: study.describe() | {"quick": bool(config.get("quick"))}
    for name, study in STUDIES.items()
}


def one_of(names):
    return "|".join(sorted({re.escape(name) for name in names})) or "(?!)"


def code(*sources):
    """Existing source files and all local modules that they import, as a job's input."""
    return code_of(*(source for source in sources if Path(source).is_file()))


def extra_measures(study):
    """What a study's own measures need beside the errors: their code and the worlds; often nothing."""
    source = f"positioning/evaluation/studies/{study}.py"
    if not Path(source).is_file():
        return []
    kind, batches = STUDIES[study].kind, STUDIES[study].batches()
    sides = [
        f"{DATA}/{kind}/{study}/{b}/{side}.npz"
        for b in batches
        for side in ("observed", "truth")
    ]
    return [*code(source), *sides]


def study_of(wildcards):
    return STUDIES[wildcards.study]


def title_of(wildcards):
    """The heading of a study in the provenance report."""
    return label(study_of(wildcards).title)


def figure_labels(wildcards):
    """Title and file of a figure in the provenance report; figures of no study compare all of them."""
    study = wildcards.get("study")
    folder = f"{RESULTS}/figures/{study}" if study else f"{RESULTS}/comparison"
    title = Captions(folder).title(wildcards.figure)
    return {"title": label(title), "file": f"{wildcards.figure}.svg"}


def row_of(wildcards):
    return STUDIES[wildcards.study].rows[wildcards.row]


def long_first(wildcards):
    """Long jobs start first, so that no core waits for one at the end: refits, then sweeps."""
    row = row_of(wildcards)
    shortcut = row.source and "def leave_one_out" in Path(row.source).read_text(
        encoding="utf-8"
    )
    return (0 if shortcut else 2) + (1 if row.over else 0)


def worlds_file(name):
    """The observed or the true side of a batch, made or recorded."""
    return lambda w: f"{DATA}/{study_of(w).kind}/{w.study}/{w.batch}/{name}.npz"


def built_on(option):
    """The estimates of the row whose fixes or steps a tracking row builds on; often none."""

    def files(wildcards):
        row = row_of(wildcards).options.get(option)
        return (
            f"{RESULTS}/estimates/{wildcards.study}/{row}/{wildcards.batch}.npz"
            if row
            else []
        )

    return files


def of_all_rows(pattern):
    """A file of every row and batch of a study."""
    return lambda w: [
        pattern.format(study=w.study, row=row, batch=batch)
        for row in study_of(w).rows
        for batch in study_of(w).batches(row)
    ]


def first_of_table_rows(pattern):
    """A file of the first batch of every row of a study's table, for figures of single worlds."""
    return lambda w: [
        pattern.format(study=w.study, row=row, batch=study_of(w).batches(row)[0])
        for row in study_of(w).entries
    ]


def batches_of_rows():
    """Which batches each row of each study has now: older builds may have left others behind."""
    return {
        name: {row: study.batches(row) for row in study.rows}
        for name, study in STUDIES.items()
    }


def study_outputs(study):
    estimates = [
        f"{RESULTS}/estimates/{study}/{row}/{batch}.npz"
        for row in STUDIES[study].rows
        for batch in STUDIES[study].batches(row)
    ]
    return [
        *estimates,
        f"{RESULTS}/errors/{study}",
        f"{RESULTS}/tables/{study}.csv",
        f"{RESULTS}/claims/{study}.csv",
        f"{RESULTS}/figures/{study}",
        f"{REPORTS}/{study}.html",
    ]


def latest_page():
    """The page that was written last, in a list; the front page comes after those of all studies."""
    names = [*STUDIES, "index"]
    there = [page for n in names if (page := Path(REPORTS) / f"{n}.html").is_file()]
    return sorted(there, key=lambda page: page.stat().st_mtime)[-1:]


def claims_of_paper(study):
    return read_yaml(Path("data/papers") / f"{STUDIES[study].paper}.yaml")["claims"]


def claims_of(study):
    return [claim for claim in claims_of_paper(study) if claim["study"] == study]


onstart:
    # A limit of submissions is for clusters. The default one, 100 a second, leaves a timer for every job that has
    # run, and each wakes the scheduler once a second until the end (Snakemake's issue 2967).
    limiter = workflow.scheduler.job_rate_limiter
    if workflow.local_exec and (limiter.max_jobs, limiter.timespan) == (100, 1):
        workflow.scheduler.job_rate_limiter = None
