# Models: one training job a model, split, flight plan and seed of training; Table 1; the networks that the firmware
# flies, of both flight plans and several trainings: what the published study flew, and what the luck of a training does.
MODELS = STUDY.models.names
FLOWN_TRAININGS = sorted({STUDY.models.seed, *STUDY.models.trainings})
TRAINED = "results/models/{plan}/{split}/training{training}/{model}"
NETWORK_LIBRARY = "build/networks/{plan}_training{training}/libges.so"
FIRMWARE_NETWORK = NETWORK_LIBRARY.format(
    plan=STUDY.models.firmware_plan, training=STUDY.models.seed
)


def trained(ending, **known):
    """Path of what a training leaves, the given wildcards filled in."""
    return expand(TRAINED + ending, **known, allow_missing=True)[0]


wildcard_constraints:
    model="|".join([*MODELS, "mlp"]),
    training=r"\d+",


rule train_model:
    input:
        library="build/libges.so",
        flights=CHECKED_FLIGHTS,
        split="results/splits/rows.{split}.csv",
    output:
        predictions=f"{TRAINED}.predictions.parquet",
        metrics=f"{TRAINED}.metrics.json",
        model=f"{TRAINED}.joblib",
    log:
        "results/logs/models/train_{plan}_{split}_{model}_{training}.log",
    benchmark:
        "results/benchmarks/models/train_{plan}_{split}_{model}_{training}.tsv"
    params:
        call=call("ges.study.models.train:train_model"),
        name=lambda wildcards: wildcards.model,
        plan=lambda wildcards: wildcards.plan,
        kind=lambda wildcards: wildcards.split,
        fit=lambda wildcards: part("models").get(wildcards.model),
        window=part("models.window"),
        vehicle=part("simulator.vehicle"),
        horizon_s=part("models.horizon_s"),
        rate_hz=part("data.rate_hz"),
        validation_rows=part("models.validation_rows"),
        test_rows=part("models.test_rows"),
        resamples=part("models.resamples"),
        seed=lambda wildcards: int(wildcards.training),
    message:
        "train {wildcards.model}, {wildcards.plan}, {wildcards.split}, seed {wildcards.training}"
    script:
        SCRIPT


rule table1:
    input:
        metrics=expand(
            f"{TRAINED}.metrics.json",
            plan=PLANS,
            split=SPLITS,
            training=STUDY.models.seed,
            model=MODELS,
        ),
    output:
        table="results/table1.csv",
    log:
        "results/logs/models/table1.log",
    benchmark:
        "results/benchmarks/models/table1.tsv"
    params:
        call=call("ges.study.models.train:write_table1"),
    message:
        "Table 1"
    script:
        SCRIPT


# All of a plan in one job: to import PyTorch takes longer than to write a header.
rule export_networks:
    input:
        models=[
            trained(".joblib", split="seedwise", model="mlp", training=training)
            for training in FLOWN_TRAININGS
        ],
    output:
        headers=[
            f"results/networks/{{plan}}/training{training}/ge_ff_mlp_weights.h"
            for training in FLOWN_TRAININGS
        ],
    log:
        "results/logs/models/export_networks_{plan}.log",
    benchmark:
        "results/benchmarks/models/export_networks_{plan}.tsv"
    params:
        call=call("ges.study.models.export:export_mlps"),
        plan=lambda wildcards: wildcards.plan,
    message:
        "write the firmware's networks, {wildcards.plan}"
    script:
        SCRIPT


rule build_network:
    input:
        header="results/networks/{plan}/training{training}/ge_ff_mlp_weights.h",
        plain="build/libges.so",
    output:
        library=NETWORK_LIBRARY,
    log:
        "results/logs/models/build_network_{plan}_{training}.log",
    benchmark:
        "results/benchmarks/models/build_network_{plan}_{training}.tsv"
    threads: 2
    params:
        sources=SIM_HASH,
        make=MAKE_SIM,
    message:
        "compile the simulator with the network, {wildcards.plan}, seed {wildcards.training}"
    shell:
        "({params.make} -j{threads} WEIGHTS=$PWD/$(dirname {input.header}) SHARED=$PWD/build BUILD=$PWD/$(dirname {output.library})) > {log} 2>&1"
