# The first diagnosis of real flights; docs/diagnosis.md and README read the page. The flights that the package ships
# are always there, those of a vehicle near the ground where they were fetched.
SHIPPED = ROOT / "src/ges/recordings/crazypad-small"
CHANGES = "results/changes"
CHANGES_SEAL = f"{CHANGES}/sealed/SHA256SUMS"
CHANGES_BATCHES = ["000", "001"]
DIAGNOSIS = ["results/diagnosis/crazypad-small/report.html"]
if REAL_FLIGHTS:
    DIAGNOSIS.append("results/diagnosis/appius/report.html")


rule diagnose_changed:
    input:
        **LIBRARY,
        reference=sorted(str(f) for f in (SHIPPED / "healthy_e9").iterdir()),
        flights=sorted(str(f) for f in (SHIPPED / "cut_propeller_3").iterdir()),
    output:
        report=DIAGNOSIS[0],
    log:
        "results/logs/diagnosis/diagnose_changed.log",
    benchmark:
        "results/benchmarks/diagnosis/diagnose_changed.tsv"
    params:
        call=call("ges.diagnose.published:diagnose_changed"),
    message:
        "calibrate on healthy flights, diagnose later ones"
    script:
        SCRIPT


rule diagnose_published:
    input:
        **LIBRARY,
        recordings=REAL_FLIGHTS,
        vehicle=APPIUS_VEHICLE,
        mapping=APPIUS_MAP,
    output:
        report="results/diagnosis/appius/report.html",
    log:
        "results/logs/diagnosis/diagnose_published.log",
    benchmark:
        "results/benchmarks/diagnosis/diagnose_published.tsv"
    params:
        call=call("ges.diagnose.published:diagnose_published"),
    message:
        "diagnose real flights"
    script:
        SCRIPT


# Real flights of one vehicle, healthy and with one labelled change: sealed, diagnosed blind, and scored.
rule make_changes:
    input:
        [str(f) for f in project("src/ges/recordings/crazypad-small/*/*")],
        **LIBRARY,
    output:
        sums=CHANGES_SEAL,
    log:
        "results/logs/diagnosis/make_changes.log",
    benchmark:
        "results/benchmarks/diagnosis/make_changes.tsv"
    params:
        call=call("ges.blind.foreign.shipped:make_and_seal"),
    message:
        "seal what was done to real vehicles"
    script:
        SCRIPT


rule diagnose_changes:
    input:
        **LIBRARY,
        sums=CHANGES_SEAL,
    output:
        verdicts=f"{CHANGES}/verdicts/ges/batch{{batch}}.json",
    log:
        "results/logs/diagnosis/changes_batch{batch}.log",
    benchmark:
        "results/benchmarks/diagnosis/changes_batch{batch}.tsv"
    params:
        call=call("ges.blind.protocol.run:run_batch"),
        batch=lambda wildcards: int(wildcards.batch),
        batches=len(CHANGES_BATCHES),
    message:
        "diagnose changed vehicles blind, batch {wildcards.batch}"
    script:
        SCRIPT


rule score_changes:
    input:
        **LIBRARY,
        sums=CHANGES_SEAL,
        verdicts=expand(
            f"{CHANGES}/verdicts/ges/batch{{batch}}.json", batch=CHANGES_BATCHES
        ),
    output:
        changes=f"{CHANGES}/changes.csv",
        errors=f"{CHANGES}/errors.csv",
    log:
        "results/logs/diagnosis/score_changes.log",
    benchmark:
        "results/benchmarks/diagnosis/score_changes.tsv"
    params:
        call=call("ges.blind.score.shipped:score_changes"),
    message:
        "open the seal of changed vehicles"
    script:
        SCRIPT
