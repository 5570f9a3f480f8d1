# The data set: flights in batches, two ways to split them, and the proof that nothing leaks.
from ges.study.config import DataSeeds

PLANS = list(STUDY.data.plans)
SPLITS = ["seedwise", "blockwise"]
DATA_SEEDS = STUDY.seeds.data()
FLIGHTS = [f"results/data/{{plan}}/seed{seed:04d}.parquet" for seed in DATA_SEEDS]
CHECKED_FLIGHTS = "results/splits/{plan}.leakage.json"


wildcard_constraints:
    plan="|".join(PLANS),
    split="|".join(SPLITS),


# The files of a flight bear no trace of its batch, so another batch size runs nothing again.
for number, batch in enumerate(batched(FLIGHTS, STUDY.data.flights_per_batch)):

    rule:
        name:
            f"fly_batch_{number}"
        input:
            library="build/libges.so",
        output:
            flights=batch,
        log:
            f"results/logs/data/fly_{{plan}}_batch{number}.log",
        benchmark:
            f"results/benchmarks/data/fly_{{plan}}_batch{number}.tsv"
        params:
            call=call("ges.study.datasets.flights:fly_batch"),
            simulator=part("simulator"),
            plan=lambda wildcards: part(f"data.plans.{wildcards.plan}"),
            duration_s=part("data.duration_s"),
            rate_hz=part("data.rate_hz"),
        message:
            "fly {wildcards.plan}: {output.flights[0]} and on"
        script:
            SCRIPT


# Some ten minutes, and no part of the study: its result stands in config/, its numbers in config/default.yaml.
rule fit_plan:
    input:
        library="build/libges.so",
    output:
        fitted="results/plan.json",
    log:
        "results/logs/data/fit_plan.log",
    params:
        call=call("ges.study.datasets.plan:fit_plan"),
        simulator=part("simulator"),
        plan=part("data.plans.published"),
        plan_seeds=part("seeds.plan"),
        duration_s=part("data.duration_s"),
        rate_hz=part("data.rate_hz"),
    message:
        "fit the published flight plan to the formula's published errors"
    script:
        SCRIPT


rule split_rows:
    output:
        split="results/splits/rows.{split}.csv",
    log:
        "results/logs/data/split_{split}.log",
    benchmark:
        "results/benchmarks/data/split_{split}.tsv"
    params:
        call=call("ges.study.datasets.split:write_split"),
        kind=lambda wildcards: wildcards.split,
        seeds=STUDY.seeds.model_dump(include=set(DataSeeds.model_fields)),
        duration_s=part("data.duration_s"),
        rate_hz=part("data.rate_hz"),
        block_s=part("models.block_s"),
        seed=part("models.seed"),
    message:
        "split rows {wildcards.split}"
    script:
        SCRIPT


rule check_leakage:
    input:
        flights=FLIGHTS,
        splits=expand("results/splits/rows.{split}.csv", split=SPLITS),
    output:
        report=CHECKED_FLIGHTS,
    log:
        "results/logs/data/leakage_{plan}.log",
    benchmark:
        "results/benchmarks/data/leakage_{plan}.tsv"
    params:
        call=call("ges.study.datasets.leakage:check_leakage"),
        terrain=part("simulator.terrain"),
    message:
        "check {wildcards.plan} for leakage"
    script:
        SCRIPT
