# The first diagnosis of real flights, whose simulator does not know of the ground; docs/diagnosis.md reads the page.
DIAGNOSIS = ["results/diagnosis/appius/report.html"]


rule diagnose_published:
    input:
        **LIBRARY,
        recordings=REAL_FLIGHTS,
        vehicle=APPIUS_VEHICLE,
        mapping=APPIUS_MAP,
    output:
        report=DIAGNOSIS[0],
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
