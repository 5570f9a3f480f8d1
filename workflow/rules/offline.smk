# Offline experiments: horizons, importances, errors by ground and clearance, learning curves.
OFFLINE_PARTS = {
    "horizons": [f"results/offline/parts/horizons_{plan}.csv" for plan in PLANS],
    "importances": [
        f"results/offline/parts/importances_{plan}.csv"
        for plan in PLANS
        if "random_forest" in MODELS
    ],
    "ground_quartiles": [
        f"results/offline/parts/ground_quartiles_{plan}.csv" for plan in PLANS
    ],
    "clearance_bins": [
        f"results/offline/parts/clearance_bins_{plan}.csv" for plan in PLANS
    ],
    "learning_curves": [
        f"results/offline/parts/curve_{model}.csv"
        for model in MODELS
        if model != "analytical"
    ],
}
OFFLINE_TABLES = [f"results/offline/{name}.csv" for name in OFFLINE_PARTS]
NETWORKS = ["mlp", "lstm", "transformer"]
CURVE_PLAN = STUDY.models.firmware_plan
SEEDWISE = "results/splits/rows.seedwise.csv"
TABLED = {"split": "seedwise", "training": STUDY.models.seed}
SEEDWISE_PREDICTIONS = [
    trained(".predictions.parquet", **TABLED, model=model) for model in MODELS
]


wildcard_constraints:
    table="|".join(OFFLINE_PARTS),


rule sweep_horizons:
    input:
        library="build/libges.so",
        flights=CHECKED_FLIGHTS,
        split=SEEDWISE,
    output:
        table="results/offline/parts/horizons_{plan}.csv",
    log:
        "results/logs/offline/horizons_{plan}.log",
    benchmark:
        "results/benchmarks/offline/horizons_{plan}.tsv"
    params:
        call=call("ges.study.offline.horizons:sweep_horizons"),
        plan=lambda wildcards: wildcards.plan,
        horizons_s=part("offline.horizons_s"),
        fit=part("models.random_forest"),
        sweep_rows=part("offline.sweep_rows"),
        window=part("models.window"),
        vehicle=part("simulator.vehicle"),
        rate_hz=part("data.rate_hz"),
        test_rows=part("models.test_rows"),
        resamples=part("models.resamples"),
        seed=part("models.seed"),
    message:
        "horizons, {wildcards.plan}"
    script:
        SCRIPT


rule importances:
    input:
        flights=CHECKED_FLIGHTS,
        split=SEEDWISE,
        model=trained(".joblib", **TABLED, model="random_forest"),
    output:
        table="results/offline/parts/importances_{plan}.csv",
    log:
        "results/logs/offline/importances_{plan}.log",
    benchmark:
        "results/benchmarks/offline/importances_{plan}.tsv"
    params:
        call=call("ges.study.offline.importances:write_importances"),
        plan=lambda wildcards: wildcards.plan,
        window=part("models.window"),
        rate_hz=part("data.rate_hz"),
        horizon_s=part("models.horizon_s"),
        rows=part("offline.importance_rows"),
        repeats=part("offline.importance_repeats"),
        seed=part("models.seed"),
    message:
        "importance of features, {wildcards.plan}"
    script:
        SCRIPT


rule ground_quartiles:
    input:
        predictions=SEEDWISE_PREDICTIONS,
    output:
        table="results/offline/parts/ground_quartiles_{plan}.csv",
    log:
        "results/logs/offline/ground_quartiles_{plan}.log",
    benchmark:
        "results/benchmarks/offline/ground_quartiles_{plan}.tsv"
    params:
        call=call("ges.study.offline.bins:write_ground_quartiles"),
        plan=lambda wildcards: wildcards.plan,
        terrain=part("simulator.terrain"),
        resamples=part("models.resamples"),
        seed=part("models.seed"),
    message:
        "errors by slope and curvature, {wildcards.plan}"
    script:
        SCRIPT


rule clearance_bins:
    input:
        predictions=SEEDWISE_PREDICTIONS,
    output:
        table="results/offline/parts/clearance_bins_{plan}.csv",
    log:
        "results/logs/offline/clearance_bins_{plan}.log",
    benchmark:
        "results/benchmarks/offline/clearance_bins_{plan}.tsv"
    params:
        call=call("ges.study.offline.bins:write_clearance_bins"),
        plan=lambda wildcards: wildcards.plan,
        edges_m=part("offline.clearance_edges_m"),
        resamples=part("models.resamples"),
        seed=part("models.seed"),
    message:
        "errors by clearance, {wildcards.plan}"
    script:
        SCRIPT


rule learning_curve:
    input:
        library="build/libges.so",
        flights=CHECKED_FLIGHTS.format(plan=CURVE_PLAN),
        split=SEEDWISE,
        at_cap=trained(".joblib", **TABLED, plan=CURVE_PLAN),
    output:
        table="results/offline/parts/curve_{model}.csv",
    log:
        "results/logs/offline/curve_{model}.log",
    benchmark:
        "results/benchmarks/offline/curve_{model}.tsv"
    params:
        call=call("ges.study.offline.curves:learning_curve"),
        name=lambda wildcards: wildcards.model,
        plan=CURVE_PLAN,
        fit=lambda wildcards: part("models")[wildcards.model],
        shares=lambda wildcards: part(
            "offline.network_curve_shares"
            if wildcards.model in NETWORKS
            else "offline.curve_shares"
        ),
        window=part("models.window"),
        vehicle=part("simulator.vehicle"),
        horizon_s=part("models.horizon_s"),
        rate_hz=part("data.rate_hz"),
        validation_rows=part("models.validation_rows"),
        resamples=part("models.resamples"),
        seed=part("models.seed"),
    message:
        "learning curve of {wildcards.model}"
    script:
        SCRIPT


rule offline_table:
    input:
        parts=lambda wildcards: OFFLINE_PARTS[wildcards.table],
    output:
        table="results/offline/{table}.csv",
    log:
        "results/logs/offline/offline_{table}.log",
    benchmark:
        "results/benchmarks/offline/offline_{table}.tsv"
    params:
        call=call("ges.study.offline.tables:join_tables"),
    message:
        "offline table {wildcards.table}"
    script:
        SCRIPT


# No part of the study, since it takes flights without sensor noise (docs/study.md): its result stands in config/.
rule score_without_noise:
    input:
        metrics=expand(
            f"{TRAINED}.metrics.json",
            plan="published",
            split="blockwise",
            training=STUDY.models.seed,
            model=MODELS,
        ),
    output:
        table="results/without_noise.csv",
    log:
        "results/logs/offline/score_without_noise.log",
    params:
        call=call("ges.study.models.train:write_table1"),
    message:
        "scores for config/without_noise.csv"
    script:
        SCRIPT


rule quote_without_noise:
    input:
        table=str(ROOT / "config/without_noise.csv"),
    output:
        table="results/offline/without_noise.csv",
    log:
        "results/logs/offline/quote_without_noise.log",
    benchmark:
        "results/benchmarks/offline/quote_without_noise.tsv"
    message:
        "scores of flights without sensor noise"
    shell:
        "cp {input.table} {output.table} 2> {log}"
