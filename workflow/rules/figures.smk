# Figures: one rule each, made from the table below; a PDF for the paper, a PNG for the screen, a CSV of what is shown.
APPIUS = ["HOVERING", "VERTICAL_SPEEDS", "NO_COMPENSATION_V_050", "HIGH_ALTITUDE_V_050"]
PUBLISHED = (RECORDINGS / "appius-ground-effect" / f"{name}.csv" for name in APPIUS)
REAL_FLIGHTS = [str(f) for f in PUBLISHED if f.is_file()]
APPIUS_VEHICLE = str(ROOT / "src/ges/vehicle/library/appius.yaml")
APPIUS_MAP = str(ROOT / "src/ges/recordings/readers/presets/appius.yaml")
LIBRARY = {"library": "build/libges.so"}
NETWORK = {"library": FIRMWARE_NETWORK}
QUARTILES = {"quartiles": "results/offline/ground_quartiles.csv"}
CLEARANCE_BINS = {"bins": "results/offline/clearance_bins.csv"}
SHOWN_SEED = STUDY.seeds.closed_loop.first
SHOWN_FLIGHT = {"simulator": part("simulator"), "plan": HOW_FLOWN}


# Published recordings are read where they are; without them the tables have headings only, and the paper says so.
rule real_flights:
    input:
        **LIBRARY,
        recordings=REAL_FLIGHTS,
        vehicle=APPIUS_VEHICLE,
        mapping=APPIUS_MAP,
    output:
        blocks="results/real/blocks.csv",
    log:
        "results/logs/figures/real_flights.log",
    benchmark:
        "results/benchmarks/figures/real_flights.tsv"
    params:
        call=call("ges.study.figures.flights:thrust_blocks"),
    message:
        "thrust ratio of real flights"
    script:
        SCRIPT


rule real_forms:
    input:
        **LIBRARY,
        blocks="results/real/blocks.csv",
        vehicle=APPIUS_VEHICLE,
    output:
        forms="results/real/forms.csv",
    log:
        "results/logs/figures/real_forms.log",
    benchmark:
        "results/benchmarks/figures/real_forms.tsv"
    params:
        call=call("ges.study.figures.flights:fit_forms"),
    message:
        "forms of the ground effect fitted to real flights"
    script:
        SCRIPT


rule real_dispersion:
    input:
        **LIBRARY,
        recordings=REAL_FLIGHTS,
        vehicle=APPIUS_VEHICLE,
        mapping=APPIUS_MAP,
    output:
        scatter="results/real/dispersion.csv",
    log:
        "results/logs/figures/real_dispersion.log",
    benchmark:
        "results/benchmarks/figures/real_dispersion.tsv"
    params:
        **SHOWN_FLIGHT,
        call=call("ges.study.figures.flights:hover_dispersion"),
        seed=SHOWN_SEED,
    message:
        "dispersion in hover, real and simulated"
    script:
        SCRIPT


# name of the figure: function of ges.study.figures, its inputs, its parameters
FIGURE_RULES = {
    "fig05": ("diagrams:system", {}, {}),
    "fig20": ("diagrams:decision", {}, {}),
    "pipeline": ("diagrams:pipeline", {}, {}),
    "terrain": (
        "ground:terrain",
        LIBRARY,
        {"simulator": part("simulator"), "seed": SHOWN_SEED},
    ),
    "fig02": ("real:dispersion", {"scatter": "results/real/dispersion.csv"}, {}),
    "fig03": ("ground:track", LIBRARY, {**SHOWN_FLIGHT, "seed": SHOWN_SEED}),
    "fig04": (
        "ground:curve",
        {
            **LIBRARY,
            "flights": [
                f"results/data/{{plan}}/seed{s:04d}.parquet".format(plan=PLANS[-1])
                for s in STUDY.seeds.test.list()
            ],
        },
        {"simulator": part("simulator")},
    ),
    "real_thrust": (
        "real:thrust",
        {
            **LIBRARY,
            "blocks": "results/real/blocks.csv",
            "forms": "results/real/forms.csv",
            "vehicle": APPIUS_VEHICLE,
        },
        {},
    ),
    "real_changes": (
        "real:changes",
        {"errors": "results/changes/errors.csv"},
        {},
    ),
    "fig06": ("offline:models", {"table1": "results/table1.csv"}, {}),
    "fig07": (
        "offline:splits",
        {"table1": "results/table1.csv"},
        {"plan": PLANS[0]},
    ),
    "fig08": (
        "offline:predicted",
        {
            "table1": "results/table1.csv",
            "predictions": [
                trained(
                    ".predictions.parquet",
                    plan=PLANS[0],
                    split="blockwise",
                    training=STUDY.models.seed,
                    model=model,
                )
                for model in MODELS
            ],
        },
        {"plan": PLANS[0]},
    ),
    "fig09": ("offline:horizons", {"horizons": "results/offline/horizons.csv"}, {}),
    "fig10": (
        "offline:importances",
        {"importances": "results/offline/importances.csv"},
        {"plan": PLANS[0]},
    ),
    "fig11": ("offline:ground_quartiles", QUARTILES, {"quantity": "slope"}),
    "fig12": ("offline:ground_quartiles", QUARTILES, {"quantity": "curvature"}),
    "fig13": ("offline:clearance", CLEARANCE_BINS, {}),
    "fig14": ("offline:reduction", CLEARANCE_BINS, {}),
    "learning_curves": (
        "offline:learning_curves",
        {"curves": "results/offline/learning_curves.csv"},
        {},
    ),
    "fig15": ("closed_loop:traces", NETWORK, {**SHOWN_FLIGHT, "seed": SHOWN_SEED}),
    "fig16": ("closed_loop:small", closed_loop("comparison_summary"), {}),
    "fig17": ("closed_loop:modes", closed_loop("comparison_summary"), {}),
    "fig18": ("closed_loop:bias", closed_loop("bias_summary"), {}),
    "fig19": (
        "closed_loop:pulse",
        {
            "trace": "results/closed_loop/pulse_trace.csv",
            "tests": "results/closed_loop/pulse_tests.csv",
        },
        {},
    ),
    "fig21": (
        "closed_loop:ablation",
        NETWORK,
        {
            **SHOWN_FLIGHT,
            "seeds": part("seeds.closed_loop_small"),
            "narrow": part("simulator.controller.trust_band") / 10,
        },
    ),
    "fig22": ("closed_loop:restricted", closed_loop("restricted_summary"), {}),
    "fig23": ("closed_loop:grid", closed_loop("grid_summary"), {}),
    "poles": (
        "closed_loop:poles",
        {"poles": "results/closed_loop/poles.csv"},
        {},
    ),
    "causes": (
        "closed_loop:causes",
        {"tests": "results/closed_loop/causes_tests.csv"},
        {},
    ),
    "winner": ("closed_loop:winner", closed_loop("winner_summary"), {}),
    "worlds": ("closed_loop:worlds", closed_loop("worlds_summary"), {}),
    "pulse_map": ("closed_loop:pulse_map", closed_loop("pulse_map_summary"), {}),
}

for figure, (function, inputs, parameters) in FIGURE_RULES.items():

    rule:
        name:
            f"figure_{figure}"
        input:
            **inputs,
        output:
            data=f"results/figures/{figure}.csv",
            pdf=f"results/figures/{figure}.pdf",
            png=report(f"results/figures/{figure}.png", category="Figures"),
        log:
            f"results/logs/figures/figure_{figure}.log",
        benchmark:
            f"results/benchmarks/figures/figure_{figure}.tsv"
        params:
            **parameters,
            call=call(f"ges.study.figures.{function}"),
        message:
            f"figure {figure}"
        script:
            SCRIPT


FIGURES = [f"results/figures/{name}.pdf" for name in FIGURE_RULES]
