# The proof: concealed effects are made and sealed, diagnosed blind in batches, and scored.
from ges.blind.generator.grid import COMPOSITIONS
from ges.blind.protocol.run import SIMPLE

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


WORLDS = "results/worlds"
WORLDS_SEAL = f"{WORLDS}/sealed/SHA256SUMS"
WORLDS_BATCHES = [f"{k:03d}" for k in range(STUDY.proof.worlds.batches)]
# simple baselines cost as much as the diagnosis, so they come with the other methods
WORLDS_METHODS = ["ges", *(SIMPLE if STUDY.proof.methods else [])]
WORLDS_SCORES = []
if STUDY.proof.worlds.every:
    WORLDS_SCORES = [f"{WORLDS}/scores.json"]


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


# Sets of other simulators, of real flights and of a second author: what cannot be made here is skipped with a reason.
rule make_worlds:
    input:
        library="build/libges.so",
    output:
        sums=WORLDS_SEAL,
    log:
        "results/logs/proof/make_worlds.log",
    benchmark:
        "results/benchmarks/proof/make_worlds.tsv"
    threads: 2
    params:
        call=call("ges.blind.foreign.worlds:make_and_seal"),
        seed=STUDY.proof.worlds.seed,
        every=STUDY.proof.worlds.every,
        recordings=str(RECORDINGS),
        given=str(GIVEN_WORLDS),
    message:
        "make sets of other worlds and seal the truth"
    script:
        SCRIPT


rule diagnose_worlds:
    input:
        library="build/libges.so",
        sums=WORLDS_SEAL,
    output:
        verdicts=f"{WORLDS}/verdicts/{{method}}/batch{{batch}}.json",
    log:
        "results/logs/proof/worlds_{method}_batch{batch}.log",
    benchmark:
        "results/benchmarks/proof/worlds_{method}_batch{batch}.tsv"
    params:
        call=call("ges.blind.protocol.run:run_batch"),
        batch=lambda wildcards: int(wildcards.batch),
        batches=len(WORLDS_BATCHES),
        method=lambda wildcards: wildcards.method,
    message:
        "diagnose other worlds by {wildcards.method}, batch {wildcards.batch}"
    script:
        SCRIPT


rule score_worlds:
    input:
        library="build/libges.so",
        sums=WORLDS_SEAL,
        verdicts=expand(
            f"{WORLDS}/verdicts/{{method}}/batch{{batch}}.json",
            method=WORLDS_METHODS,
            batch=WORLDS_BATCHES,
        ),
    output:
        scores=f"{WORLDS}/scores.json",
    log:
        "results/logs/proof/score_worlds.log",
    benchmark:
        "results/benchmarks/proof/score_worlds.tsv"
    params:
        call=call("ges.blind.score.by_world:score_batches"),
    message:
        "open the seal of other worlds and score"
    script:
        SCRIPT


rule proof:
    input:
        PROOF,
        WORLDS_SCORES,
