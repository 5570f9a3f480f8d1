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


# Networks of both flight plans, each trained several times: what the published study flew, and what the luck of a
# training does.
NETWORK_OF = "results/networks/{plan}/training{training}"
NETWORK_LIBRARY = "build/networks/{plan}_training{training}/libges.so"


wildcard_constraints:
    training=r"\d+",


rule train_network:
    input:
        library="build/libges.so",
        flights=CHECKED_FLIGHTS,
        split="results/splits/rows.seedwise.csv",
    output:
        predictions=f"{NETWORK_OF}.predictions.parquet",
        metrics=f"{NETWORK_OF}.metrics.json",
        model=f"{NETWORK_OF}.joblib",
    log:
        "results/logs/models/train_network_{plan}_{training}.log",
    benchmark:
        "results/benchmarks/models/train_network_{plan}_{training}.tsv"
    params:
        call=call("ges.study.models.train:train_model"),
        name="mlp",
        plan=lambda wildcards: wildcards.plan,
        kind="seedwise",
        fit=part("models.mlp"),
        window=part("models.window"),
        vehicle=part("simulator.vehicle"),
        horizon_s=part("models.horizon_s"),
        rate_hz=part("data.rate_hz"),
        validation_rows=part("models.validation_rows"),
        test_rows=part("models.test_rows"),
        resamples=part("models.resamples"),
        seed=lambda wildcards: int(wildcards.training),
    message:
        "train the network, {wildcards.plan}, seed {wildcards.training}"
    script:
        SCRIPT


rule export_network:
    input:
        model=f"{NETWORK_OF}.joblib",
    output:
        header_file=f"{NETWORK_OF}/ge_ff_mlp_weights.h",
    log:
        "results/logs/models/export_network_{plan}_{training}.log",
    benchmark:
        "results/benchmarks/models/export_network_{plan}_{training}.tsv"
    params:
        call=call("ges.study.models.export:export_mlp"),
        plan=lambda wildcards: wildcards.plan,
    message:
        "write the firmware's network, {wildcards.plan}, seed {wildcards.training}"
    script:
        SCRIPT


rule build_network:
    input:
        header=f"{NETWORK_OF}/ge_ff_mlp_weights.h",
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
