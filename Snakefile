# Reposition: rebuilds every table and figure of the studies in config/config.yaml.
from snakemake.utils import min_version

min_version("9.0")


configfile: "config/config.yaml"


include: "workflow/rules/common.smk"
include: "workflow/rules/data.smk"
include: "workflow/rules/run.smk"
include: "workflow/rules/score.smk"
include: "workflow/rules/compare.smk"
include: "workflow/rules/report.smk"


wildcard_constraints:
    study=one_of(STUDIES),
    row=one_of(row for study in STUDIES.values() for row in study.rows),
    batch="[0-9]{5}",


rule all:
    default_target: True
    input:
        [file for study in STUDIES for file in study_outputs(study)],
        f"{REPORTS}/index.html",
        f"{REPORTS}/comparison.html",
        f"{REPORTS}/reposition.pdf",
        f"{RESULTS}/accepted.txt",
    message:
        f"all is there: {REPORTS}/index.html"


for name in STUDIES:

    rule:
        name:
            name
        input:
            study_outputs(name),


onsuccess:
    print("Done." + "".join(f" The report: {page}" for page in latest_page()))
