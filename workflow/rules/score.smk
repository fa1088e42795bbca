# The only place where estimates meet the truth. Raw errors are kept; metrics come later.


rule score:
    input:
        estimates=f"{RESULTS}/estimates/{{study}}/{{row}}/{{batch}}.npz",
        truth=worlds_file("truth"),
        code=lambda w: code(
            f"positioning/tasks/{row_of(w).task}.py", "workflow/scripts/score.py"
        ),
    output:
        f"{RESULTS}/errors/{{study}}/{{row}}/{{batch}}.parquet",
    log:
        f"{RESULTS}/logs/score/{{study}}/{{row}}/{{batch}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/score/{{study}}/{{row}}/{{batch}}.tsv"
    conda:
        ENVIRONMENT
    params:
        task=lambda w: row_of(w).task,
    message:
        "{wildcards.study}: score {wildcards.row} on worlds from {wildcards.batch}"
    script:
        "../scripts/score.py"
