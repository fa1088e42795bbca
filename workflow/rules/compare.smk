# From raw errors to tables, claims and figures of a study, and to the ledger of all claims.


rule compare:
    input:
        errors=f"{RESULTS}/errors/{{study}}",
        estimates=of_all_rows(f"{RESULTS}/estimates/{{study}}/{{row}}/{{batch}}.npz"),
        paper=lambda w: f"data/papers/{study_of(w).paper}.yaml",
        extra=lambda w: extra_measures(w.study),
        code=code("workflow/scripts/compare.py"),
    output:
        table=report(
            f"{RESULTS}/tables/{{study}}.csv",
            caption="../report/table.rst",
            category=title_of,
            subcategory="tables",
            labels={"title": "Errors of all rows", "file": "{study}.csv"},
        ),
        paired=report(
            f"{RESULTS}/tables/{{study}}_paired.csv",
            caption="../report/paired.rst",
            category=title_of,
            subcategory="tables",
            labels={"title": "Paired differences", "file": "{study}_paired.csv"},
        ),
        times=f"{RESULTS}/tables/{{study}}_times.csv",
        measures=f"{RESULTS}/measures/{{study}}.parquet",
    log:
        f"{RESULTS}/logs/compare/{{study}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/compare/{{study}}.tsv"
    conda:
        ENVIRONMENT
    params:
        rows=lambda w: {name: row.settings() for name, row in study_of(w).rows.items()},
        table=lambda w: list(study_of(w).entries),
        families=lambda w: list(study_of(w).families or study_of(w).recordings),
    message:
        "{wildcards.study}: compare all algorithms"
    script:
        "../scripts/compare.py"


rule claims:
    input:
        measures=f"{RESULTS}/measures/{{study}}.parquet",
        times=f"{RESULTS}/tables/{{study}}_times.csv",
        calibration=lambda w: (
            f"{RESULTS}/calibration/{w.study}.json" if study_of(w).calibrate else []
        ),
        paper=lambda w: f"data/papers/{study_of(w).paper}.yaml",
        code=code("workflow/scripts/claims.py"),
    output:
        report(
            f"{RESULTS}/claims/{{study}}.csv",
            caption="../report/claims.rst",
            category=title_of,
            subcategory="claims",
            labels={"title": "Claims and verdicts", "file": "{study}.csv"},
        ),
    log:
        f"{RESULTS}/logs/claims/{{study}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/claims/{{study}}.tsv"
    conda:
        ENVIRONMENT
    params:
        paper=lambda w: study_of(w).paper,
        family=lambda w: next(iter(study_of(w).families or study_of(w).recordings)),
    message:
        "{wildcards.study}: judge the paper's claims"
    script:
        "../scripts/claims.py"


rule figures:
    input:
        measures=f"{RESULTS}/measures/{{study}}.parquet",
        errors=f"{RESULTS}/errors/{{study}}",
        estimates=first_of_table_rows(
            f"{RESULTS}/estimates/{{study}}/{{row}}/{{batch}}.npz"
        ),
        worlds=lambda w: [
            f"{DATA}/{study_of(w).kind}/{w.study}/{study_of(w).batches()[0]}/{side}.npz"
            for side in ("observed", "truth")
        ],
        paper=lambda w: f"data/papers/{study_of(w).paper}.yaml",
        code=lambda w: code(
            f"positioning/presentation/studies/{w.study}.py",
            "workflow/scripts/figures.py",
        ),
    output:
        report(
            directory(f"{RESULTS}/figures/{{study}}"),
            patterns=["{figure}.svg"],
            caption="../report/figure.rst",
            category=title_of,
            subcategory="figures",
            labels=figure_labels,
        ),
    log:
        f"{RESULTS}/logs/figures/{{study}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/figures/{{study}}.tsv"
    conda:
        ENVIRONMENT
    params:
        rows=lambda w: list(study_of(w).entries),
        sweeps=lambda w: {
            name: row.settings()["over"] for name, row in study_of(w).sweeps.items()
        },
        settings=lambda w: {
            name: row.in_full() for name, row in study_of(w).entries.items()
        },
        captions=lambda w: Captions(f"{RESULTS}/figures/{w.study}"),
    message:
        "{wildcards.study}: draw the figures"
    script:
        "../scripts/figures.py"
