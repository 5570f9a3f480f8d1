# Models: one training job a model, split and flight plan; Table 1; the network that the firmware flies.
MODELS = STUDY.models.names
TRAINED = "results/models/{plan}/{split}/{model}"
FIRMWARE_MLP = f"results/models/{STUDY.models.firmware_plan}/seedwise/mlp.joblib"


wildcard_constraints:
    model="|".join(MODELS),


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
        "results/logs/models/train_{plan}_{split}_{model}.log",
    benchmark:
        "results/benchmarks/models/train_{plan}_{split}_{model}.tsv"
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
        seed=part("models.seed"),
    message:
        "train {wildcards.model}, {wildcards.plan}, {wildcards.split}"
    script:
        SCRIPT


rule table1:
    input:
        metrics=expand(
            f"{TRAINED}.metrics.json", plan=PLANS, split=SPLITS, model=MODELS
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


rule export_mlp:
    input:
        model=FIRMWARE_MLP,
    output:
        header_file="results/models/ge_ff_mlp_weights.h",
    log:
        "results/logs/models/export_mlp.log",
    benchmark:
        "results/benchmarks/models/export_mlp.tsv"
    params:
        call=call("ges.study.models.export:export_mlp"),
        plan=part("models.firmware_plan"),
    message:
        "write the firmware's network"
    script:
        SCRIPT


rule build_simulator_ml:
    input:
        header="results/models/ge_ff_mlp_weights.h",
        plain="build/libges.so",
    output:
        library="build/ml/libges.so",
    log:
        "results/logs/models/build_simulator_ml.log",
    benchmark:
        "results/benchmarks/models/build_simulator_ml.tsv"
    threads: 2
    params:
        sources=SIM_HASH,
        make=MAKE_SIM,
    message:
        "compile the simulator with the network of this study"
    shell:
        "({params.make} -j{threads} WEIGHTS=$PWD/results/models SHARED=$PWD/build BUILD=$PWD/build/ml) > {log} 2>&1"
