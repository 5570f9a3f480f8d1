# Claims, numbers and the paper: everything that is printed is read from results.
SHOWN_TABLES = [
    "results/table1.csv",
    "results/table2.csv",
    "results/claims.csv",
    "results/real/forms.csv",
    "results/changes/changes.csv",
    "results/closed_loop/poles_summary.csv",
    "results/closed_loop/pulse_map_limits.csv",
    "results/closed_loop/ensemble_summary.csv",
    "results/closed_loop/gain_profile.csv",
]
PROVEN_TABLES = [f for f in PROOF if f.endswith(".csv")]
PROVEN_FIGURES = [f for f in PROOF if f.endswith(".pdf")]
CLAIMED_TABLES = [
    "results/table1.csv",
    *OFFLINE_TABLES,
    *(
        f"results/closed_loop/{name}"
        for name in (
            "clamp.json",
            "comparison_summary.csv",
            "restricted_summary.csv",
            "bias_summary.csv",
            "bias_tests.csv",
            "pulse_tests.csv",
            "pulse_response.json",
            "pulse_map_limits.csv",
            "poles_summary.csv",
            "grid_summary.csv",
            "causes_tests.csv",
            "worlds_summary.csv",
            "networks_summary.csv",
            "worlds_bias_tests.csv",
        )
    ),
]
QUOTED_TABLES = [
    *CLAIMED_TABLES,
    "results/closed_loop/winner_summary.csv",
    "results/closed_loop/winner_tests.csv",
    "results/closed_loop/causes_summary.csv",
    "results/closed_loop/ensemble_summary.csv",
    "results/closed_loop/gain_profile.csv",
    "results/offline/without_noise.csv",
    "results/real/blocks.csv",
    "results/real/forms.csv",
    "results/figures/real_thrust.csv",
    "results/figures/fig02.csv",
    *PROVEN_TABLES,
]
SHOWN_FIGURES = [f.replace(".pdf", ".csv") for f in FIGURES]
PAPER_SOURCES = project("paper/main.typ", "paper/lib.typ", "paper/refs.bib")


rule write_claims:
    input:
        listed=str(ROOT / "src/ges/study/claims.yaml"),
        tables=CLAIMED_TABLES,
    output:
        table=report("results/claims.csv", category="Tables"),
        rules="results/claims_rules.json",
    log:
        "results/logs/paper/write_claims.log",
    benchmark:
        "results/benchmarks/paper/write_claims.tsv"
    params:
        call=call("ges.study.claims:write_claims"),
        results=folder_of,
        seeds=part("seeds"),
    message:
        "the paper's claims beside ours"
    script:
        SCRIPT


rule write_numbers:
    input:
        listed=str(ROOT / "src/ges/study/numbers.yaml"),
        claims="results/claims.csv",
        tables=QUOTED_TABLES,
    output:
        numbers="results/numbers.json",
    log:
        "results/logs/paper/write_numbers.log",
    benchmark:
        "results/benchmarks/paper/write_numbers.tsv"
    params:
        call=call("ges.study.claims_text:write_numbers"),
        results=folder_of,
    message:
        "numbers of the text"
    script:
        SCRIPT


rule write_settings:
    output:
        settings="results/config.json",
    log:
        "results/logs/paper/write_settings.log",
    benchmark:
        "results/benchmarks/paper/write_settings.tsv"
    params:
        call=call("ges.paper.paper:write_settings"),
        study=STUDY.model_dump(mode="json"),
    message:
        "the configuration for the text"
    script:
        SCRIPT


rule write_facts:
    input:
        made=[*SHOWN_TABLES, *SHOWN_FIGURES, *PROVEN_TABLES],
    output:
        facts="results/facts.json",
    log:
        "results/logs/paper/write_facts.log",
    benchmark:
        "results/benchmarks/paper/write_facts.tsv"
    params:
        call=call("ges.paper.paper:write_facts"),
        makers=lambda wildcards, input: makers(input.made),
        code=CODE,
    message:
        "origin of every table and figure"
    script:
        SCRIPT


rule write_latex:
    input:
        table="results/{table}.csv",
        facts="results/facts.json",
    output:
        fragment="results/latex/{table}.tex",
    log:
        "results/logs/paper/write_latex_{table}.log",
    benchmark:
        "results/benchmarks/paper/write_latex_{table}.tsv"
    wildcard_constraints:
        table="table1|table2|claims",
    params:
        call=call("ges.paper.paper:write_latex"),
    message:
        "LaTeX fragment of {wildcards.table}"
    script:
        SCRIPT


rule check_paper:
    input:
        sources=[str(f) for f in PAPER_SOURCES if f.name == "main.typ"],
    output:
        checked="results/paper.checked.json",
    log:
        "results/logs/paper/check_paper.log",
    benchmark:
        "results/benchmarks/paper/check_paper.tsv"
    params:
        call=call("ges.paper.paper:check_source"),
    message:
        "no number is typed into the paper"
    script:
        SCRIPT


rule render_paper:
    input:
        "results/paper.checked.json",
        "results/numbers.json",
        "results/config.json",
        "results/facts.json",
        "results/claims_rules.json",
        SHOWN_TABLES,
        FIGURES,
        PROVEN_TABLES,
        PROVEN_FIGURES,
        [str(f) for f in PAPER_SOURCES],
        main=str(ROOT / "paper/main.typ"),
        citation=str(ROOT / "CITATION.cff"),
    output:
        pdf=report("results/paper.pdf", category="Paper"),
    log:
        "results/logs/paper/render_paper.log",
    benchmark:
        "results/benchmarks/paper/render_paper.tsv"
    params:
        call=call("ges.paper.paper:render"),
        results=folder_of,
    message:
        "render the paper"
    script:
        SCRIPT


PAPER = [
    "results/paper.pdf",
    "results/claims.csv",
    *expand("results/latex/{table}.tex", table=["table1", "table2", "claims"]),
]
RESULTS = sorted(
    {
        *FIGURES,
        *SHOWN_FIGURES,
        *SHOWN_TABLES,
        *QUOTED_TABLES,
        *PROVEN_FIGURES,
        *DIAGNOSIS,
        *PAPER,
    }
)
