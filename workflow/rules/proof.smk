# The proof: concealed effects are made and sealed, diagnosed blind in batches, and scored.
from ges.blind.generator.grid import COMPOSITIONS

PROVEN = "results/proof"
SEAL = f"{PROVEN}/sealed/SHA256SUMS"
N_BATCHES = len(
    batched(
        range(sum(COMPOSITIONS[STUDY.proof.grid].values())), STUDY.proof.cases_per_batch
    )
)
METHODS = ["ges", *STUDY.proof.methods]
BATCHES = [f"{k:03d}" for k in range(N_BATCHES)]
PROOF_TABLES = expand(
    f"{PROVEN}/{{table}}.csv",
    table=[
        "cases",
        "scores",
        "singles",
        "categories",
        "confusion",
        "reliability",
        "oracle",
    ],
)
PROOF_FIGURES = expand(
    f"{PROVEN}/{{figure}}.{{kind}}",
    figure=[
        "confusion_matrix",
        "detection",
        "detection_limit",
        "calibration",
        "outcomes",
    ],
    kind=["pdf", "png"],
)
PROOF = [f"{PROVEN}/scores.json", *PROOF_TABLES, *PROOF_FIGURES]
if STUDY.proof.methods:
    PROOF.append(f"{PROVEN}/methods.csv")


rule make_cases:
    output:
        sums=SEAL,
    log:
        "results/logs/proof/make_cases.log",
    benchmark:
        "results/benchmarks/proof/make_cases.tsv"
    threads: 2
    params:
        call=call("ges.blind.generator.make:make_and_seal"),
        grid=STUDY.proof.grid,
        seed=STUDY.proof.seed,
    message:
        "make concealed cases and seal the truth"
    script:
        SCRIPT


rule diagnose_batch:
    input:
        library="build/libges.so",
        sums=SEAL,
    output:
        verdicts=f"{PROVEN}/verdicts/{{method}}/batch{{batch}}.json",
    log:
        "results/logs/proof/diagnose_{method}_batch{batch}.log",
    benchmark:
        "results/benchmarks/proof/diagnose_{method}_batch{batch}.tsv"
    params:
        call=call("ges.blind.protocol.run:run_batch"),
        batch=lambda wildcards: int(wildcards.batch),
        batches=N_BATCHES,
        method=lambda wildcards: wildcards.method,
    message:
        "diagnose concealed cases by {wildcards.method}, batch {wildcards.batch}"
    script:
        SCRIPT


rule score_proof:
    input:
        library="build/libges.so",
        sums=SEAL,
        verdicts=expand(f"{PROVEN}/verdicts/ges/batch{{batch}}.json", batch=BATCHES),
    output:
        PROOF_TABLES,
        PROOF_FIGURES,
        scores=f"{PROVEN}/scores.json",
    log:
        "results/logs/proof/score_proof.log",
    benchmark:
        "results/benchmarks/proof/score_proof.tsv"
    threads: 2
    params:
        call=call("ges.blind.score.score:score_batches"),
    message:
        "open the seal and score"
    script:
        SCRIPT


rule compare_methods:
    input:
        library="build/libges.so",
        sums=SEAL,
        verdicts=expand(
            f"{PROVEN}/verdicts/{{method}}/batch{{batch}}.json",
            method=METHODS,
            batch=BATCHES,
        ),
    output:
        table=f"{PROVEN}/methods.csv",
    log:
        "results/logs/proof/compare_methods.log",
    benchmark:
        "results/benchmarks/proof/compare_methods.tsv"
    threads: 2
    params:
        call=call("ges.blind.score.score:compare_methods"),
        methods=METHODS,
    message:
        "score the baselines on the same cases"
    script:
        SCRIPT


rule proof:
    input:
        PROOF,
