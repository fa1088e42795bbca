# Worlds: made from settings and seeds, or read from real recordings. Truth goes to a file of its own.


rule calibrate:
    input:
        code=lambda w: code(
            f"positioning/simulation/{w.study}.py",
            *(
                source
                for c in study_of(w).calibrate
                for source in study_of(w).entries[c["algorithm"]].sources
            ),
            f"positioning/evaluation/studies/{w.study}.py",
            *(
                f"positioning/tasks/{study_of(w).entries[c['algorithm']].task}.py"
                for c in study_of(w).calibrate
            ),
            "workflow/scripts/calibrate.py",
        ),
    output:
        f"{RESULTS}/calibration/{{study}}.json",
    log:
        f"{RESULTS}/logs/calibrate/{{study}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/calibrate/{{study}}.tsv"
    conda:
        ENVIRONMENT
    threads: 2
    params:
        families=lambda w: study_of(w).families,
        steps=lambda w: study_of(w).calibration_steps(claims_of_paper(w.study)),
    message:
        "{wildcards.study}: calibrate on worlds of its own"
    script:
        "../scripts/calibrate.py"


rule simulate:
    input:
        calibration=lambda w: (
            f"{RESULTS}/calibration/{w.study}.json" if study_of(w).calibrate else []
        ),
        code=lambda w: code(
            f"positioning/simulation/{w.study}.py", "workflow/scripts/simulate.py"
        ),
    output:
        observed=f"{DATA}/synthetic/{{study}}/{{batch}}/observed.npz",
        truth=f"{DATA}/synthetic/{{study}}/{{batch}}/truth.npz",
    log:
        f"{RESULTS}/logs/simulate/{{study}}/{{batch}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/simulate/{{study}}/{{batch}}.tsv"
    conda:
        ENVIRONMENT
    params:
        members=lambda w: study_of(w).members(w.batch),
    message:
        "{wildcards.study}: simulate worlds from {wildcards.batch}"
    script:
        "../scripts/simulate.py"


rule record:
    input:
        files=lambda w: [
            file
            for r in study_of(w).members(w.batch).values()
            for file in files_of(r["source"], Path(REALDATA))
        ],
        register="data/sources.csv",
        code=lambda w: code(
            *(
                f"positioning/recordings/{r['adapter']}.py"
                for r in study_of(w).members(w.batch).values()
            ),
            "workflow/scripts/record.py",
        ),
    output:
        observed=f"{DATA}/recorded/{{study}}/{{batch}}/observed.npz",
        truth=f"{DATA}/recorded/{{study}}/{{batch}}/truth.npz",
    log:
        f"{RESULTS}/logs/record/{{study}}/{{batch}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/record/{{study}}/{{batch}}.tsv"
    conda:
        ENVIRONMENT
    params:
        members=lambda w: study_of(w).members(w.batch),
        realdata=REALDATA,
    message:
        "{wildcards.study}: read real recordings from {wildcards.batch}"
    script:
        "../scripts/record.py"
