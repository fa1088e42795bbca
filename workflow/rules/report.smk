# For people: one page a study, the front page, the ledger of claims, and what the numbers came from.


report: "../report/workflow.rst"


rule ledger:
    input:
        claims=expand(f"{RESULTS}/claims/{{study}}.csv", study=STUDIES),
        code=code("workflow/scripts/ledger.py"),
    output:
        report(
            f"{RESULTS}/claims.csv",
            caption="../report/ledger.rst",
            category="All studies",
            labels={"title": "All claims and verdicts", "file": "claims.csv"},
        ),
    log:
        f"{RESULTS}/logs/ledger.log",
    benchmark:
        f"{RESULTS}/benchmarks/ledger/ledger.tsv"
    conda:
        ENVIRONMENT
    message:
        "join all claims into one ledger"
    script:
        "../scripts/ledger.py"


rule accepted:
    input:
        ledger=f"{RESULTS}/claims.csv",
        accepted=[path for path in [GOLDEN] if Path(path).is_file()],
        code=code("workflow/scripts/accepted.py"),
    output:
        f"{RESULTS}/accepted.txt",
    log:
        f"{RESULTS}/logs/accepted.log",
    benchmark:
        f"{RESULTS}/benchmarks/accepted/accepted.tsv"
    conda:
        ENVIRONMENT
    message:
        "compare all verdicts with the accepted ones"
    script:
        "../scripts/accepted.py"


rule manifest:
    input:
        tables=expand(f"{RESULTS}/tables/{{study}}.csv", study=STUDIES),
        code=code("workflow/scripts/manifest.py"),
    output:
        f"{RESULTS}/manifest.json",
    log:
        f"{RESULTS}/logs/manifest.log",
    benchmark:
        f"{RESULTS}/benchmarks/manifest/manifest.tsv"
    conda:
        ENVIRONMENT
    params:
        config=config,
        benchmarks=f"{RESULTS}/benchmarks",
        batches=batches_of_rows(),
    message:
        "write down what the numbers came from"
    script:
        "../scripts/manifest.py"


rule study_manifest:
    input:
        tables=f"{RESULTS}/tables/{{study}}.csv",
        code=code("workflow/scripts/manifest.py"),
    output:
        f"{RESULTS}/manifests/{{study}}.json",
    log:
        f"{RESULTS}/logs/manifests/{{study}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/study_manifest/{{study}}.tsv"
    conda:
        ENVIRONMENT
    params:
        config=lambda w: {**config, "studies": {w.study: config["studies"][w.study]}},
        benchmarks=f"{RESULTS}/benchmarks",
        batches=batches_of_rows(),
    message:
        "{wildcards.study}: write down what the numbers came from"
    script:
        "../scripts/manifest.py"


rule page:
    input:
        table=f"{RESULTS}/tables/{{study}}.csv",
        paired=f"{RESULTS}/tables/{{study}}_paired.csv",
        times=f"{RESULTS}/tables/{{study}}_times.csv",
        claims=f"{RESULTS}/claims/{{study}}.csv",
        figures=f"{RESULTS}/figures/{{study}}",
        paper=lambda w: f"data/papers/{study_of(w).paper}.yaml",
        calibration=lambda w: (
            f"{RESULTS}/calibration/{w.study}.json" if study_of(w).calibrate else []
        ),
        manifest=f"{RESULTS}/manifests/{{study}}.json",
        sources=lambda w: "data/sources.csv" if study_of(w).recordings else [],
        accepted="data/algorithms.csv",
        templates=TEMPLATES,
        code=code("workflow/scripts/page.py"),
    output:
        html=f"{REPORTS}/{{study}}.html",
        markdown=f"{RESULTS}/tables/{{study}}.md",
        latex=f"{RESULTS}/tables/{{study}}.tex",
    log:
        f"{RESULTS}/logs/page/{{study}}.log",
    benchmark:
        f"{RESULTS}/benchmarks/page/{{study}}.tsv"
    conda:
        ENVIRONMENT
    params:
        plan=lambda w: PLANS[w.study],
    message:
        "{wildcards.study}: write its page"
    script:
        "../scripts/page.py"


rule index:
    input:
        claims=f"{RESULTS}/claims.csv",
        tables=expand(f"{RESULTS}/tables/{{study}}.csv", study=STUDIES),
        figures=expand(f"{RESULTS}/figures/{{study}}", study=STUDIES),
        papers=sorted({f"data/papers/{study.paper}.yaml" for study in STUDIES.values()}),
        pages=expand(f"{REPORTS}/{{study}}.html", study=STUDIES),
        manifest=f"{RESULTS}/manifest.json",
        templates=TEMPLATES,
        code=code("workflow/scripts/index.py"),
    output:
        html=f"{REPORTS}/index.html",
        claims=f"{REPORTS}/claims.html",
        method=f"{REPORTS}/method.html",
        csv=f"{REPORTS}/claims.csv",
        markdown=f"{REPORTS}/claims.md",
    log:
        f"{RESULTS}/logs/index.log",
    benchmark:
        f"{RESULTS}/benchmarks/index/index.tsv"
    conda:
        ENVIRONMENT
    params:
        plan=PLANS,
    message:
        "write front page, claims and method"
    script:
        "../scripts/index.py"


rule comparison:
    input:
        table=expand(f"{RESULTS}/tables/{{study}}.csv", study=STUDIES),
        paired=expand(f"{RESULTS}/tables/{{study}}_paired.csv", study=STUDIES),
        times=expand(f"{RESULTS}/tables/{{study}}_times.csv", study=STUDIES),
        measures=expand(f"{RESULTS}/measures/{{study}}.parquet", study=STUDIES),
        accepted="data/algorithms.csv",
        manifest=f"{RESULTS}/manifest.json",
        templates=TEMPLATES,
        code=code("workflow/scripts/comparison.py"),
    output:
        html=f"{REPORTS}/comparison.html",
        folder=report(
            directory(f"{RESULTS}/comparison"),
            patterns=["{figure}.svg"],
            caption="../report/figure.rst",
            category="Comparison of all algorithms",
            subcategory="figures",
            labels=figure_labels,
        ),
    log:
        f"{RESULTS}/logs/comparison.log",
    benchmark:
        f"{RESULTS}/benchmarks/comparison/comparison.tsv"
    conda:
        ENVIRONMENT
    params:
        plan=PLANS,
        captions=Captions(f"{RESULTS}/comparison"),
    message:
        "put all algorithms of a task beside each other"
    script:
        "../scripts/comparison.py"


rule pdf:
    input:
        claims=f"{RESULTS}/claims.csv",
        tables=expand(f"{RESULTS}/tables/{{study}}.csv", study=STUDIES),
        figures=expand(f"{RESULTS}/figures/{{study}}", study=STUDIES),
        papers=sorted({f"data/papers/{study.paper}.yaml" for study in STUDIES.values()}),
        calibration=[
            f"{RESULTS}/calibration/{study.name}.json"
            for study in STUDIES.values()
            if study.calibrate
        ],
        comparison=f"{RESULTS}/comparison",
        manifest=f"{RESULTS}/manifest.json",
        templates=TEMPLATES,
        code=code("workflow/scripts/pdf.py"),
    output:
        pdf=report(
            f"{REPORTS}/reposition.pdf",
            caption="../report/pdf.rst",
            category="All studies",
            labels={"title": "The whole report", "file": "reposition.pdf"},
        ),
        latex=f"{RESULTS}/tables/claims.tex",
    log:
        f"{RESULTS}/logs/pdf.log",
    benchmark:
        f"{RESULTS}/benchmarks/pdf/pdf.tsv"
    conda:
        ENVIRONMENT
    params:
        plan=PLANS,
    message:
        "set the whole report as a PDF"
    script:
        "../scripts/pdf.py"
