# The only place where estimates meet the truth. Raw errors are kept; metrics come later.


rule score:
    # One job a study: scoring a row takes less time than starting a Python for it.
    input:
        estimates=of_all_rows(f"{RESULTS}/estimates/{{study}}/{{row}}/{{batch}}.npz"),
        truths=lambda w: [
            f"{DATA}/{study_of(w).kind}/{w.study}/{batch}/truth.npz"
            for batch in study_of(w).batches()
        ],
        code=lambda w: code(
            *(
                f"positioning/tasks/{task}.py"
                for task in sorted({row.task for row in study_of(w).rows.values()})
            ),
            "workflow/scripts/score.py",
        ),
    output:
        directory(f"{RESULTS}/errors/{{study}}"),
    log:
        f"{RESULTS}/logs/score/{{study}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/score/{{study}}.tsv"
    conda:
        ENVIRONMENT
    params:
        tasks=lambda w: {name: row.task for name, row in study_of(w).rows.items()},
    message:
        "{wildcards.study}: score all rows"
    script:
        "../scripts/score.py"
