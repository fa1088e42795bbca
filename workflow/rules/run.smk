# One job: one algorithm on one batch of worlds. It sees what was observed; only a control sees the truth.


rule run:
    input:
        observed=worlds_file("observed"),
        truth=lambda w: worlds_file("truth")(w) if row_of(w).is_control else [],
        fixes=built_on("fixes"),
        steps=built_on("steps"),
        code=lambda w: code(
            *row_of(w).sources,
            f"positioning/tasks/{row_of(w).task}.py",
            "workflow/scripts/run.py",
        ),
    output:
        f"{RESULTS}/estimates/{{study}}/{{row}}/{{batch}}.npz",
    log:
        f"{RESULTS}/logs/run/{{study}}/{{row}}/{{batch}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/run/{{study}}/{{row}}/{{batch}}.tsv"
    priority: long_first
    conda:
        ENVIRONMENT
    params:
        row=lambda w: row_of(w).settings(),
        first_seed=lambda w: study_of(w).first_seed,
    message:
        "{wildcards.study}: run {wildcards.row} on worlds from {wildcards.batch}"
    script:
        "../scripts/run.py"
