# Closed loop: experiments with the network fly the simulator that carries this study's; the others wait for no training.
import itertools

from ges.study.config import Flights

FLOWN = "results/closed_loop"
PLAIN, FLYING = "build/libges.so", FIRMWARE_NETWORK
CLAMP = f"{FLOWN}/clamp.json"
# Every rule is handed how all flights are flown and the keys of its own, so that no other key runs it again.
HOW_FLOWN = STUDY.closed_loop.model_dump(include=set(Flights.model_fields))
CELLS = [
    f"{FLOWN}/grid/slope{exponent:g}_curvature{factor:g}.csv"
    for exponent, factor in itertools.product(
        STUDY.closed_loop.slope_exponents, STUDY.closed_loop.curvature_factors
    )
]


# Ten minutes, and no part of the study: its result stands in config/, its numbers in config/default.yaml.
rule calibrate:
    input:
        library=PLAIN,
    output:
        calibration="results/calibration.json",
    log:
        "results/logs/closed_loop/calibrate.log",
    params:
        call=call("ges.study.fly.calibrate:calibrate"),
        simulator=part("simulator"),
        plan=HOW_FLOWN,
        pulse=part("closed_loop.pulse"),
        calibration_seeds=part("seeds.calibration"),
    message:
        "fit the simulator's free numbers to published figures"
    script:
        SCRIPT


rule choose_clamp:
    input:
        library=FLYING,
    output:
        flights=f"{FLOWN}/clamp.csv",
        choice=CLAMP,
    log:
        "results/logs/closed_loop/choose_clamp.log",
    benchmark:
        "results/benchmarks/closed_loop/choose_clamp.tsv"
    params:
        call=call("ges.study.fly.clamp:choose_clamp"),
        simulator=part("simulator"),
        plan=HOW_FLOWN,
        clamp_thresholds=part("closed_loop.clamp_thresholds"),
        validation=part("seeds.validation"),
    message:
        "choose the clamp threshold on validation seeds"
    script:
        SCRIPT


rule fly_comparison:
    input:
        library=FLYING,
        clamp=CLAMP,
    output:
        flights=f"{FLOWN}/comparison.csv",
        summary=f"{FLOWN}/comparison_summary.csv",
        restricted=f"{FLOWN}/restricted_summary.csv",
    log:
        "results/logs/closed_loop/fly_comparison.log",
    benchmark:
        "results/benchmarks/closed_loop/fly_comparison.tsv"
    params:
        call=call("ges.study.fly.comparison:fly_comparison"),
        simulator=part("simulator"),
        plan=HOW_FLOWN,
        modes=part("closed_loop.modes"),
        closed_loop_small=part("seeds.closed_loop_small"),
        closed_loop=part("seeds.closed_loop"),
    message:
        "fly the feedforward modes against each other"
    script:
        SCRIPT


rule fly_network:
    input:
        library=NETWORK_LIBRARY,
    output:
        flights=f"{FLOWN}/networks/{{plan}}_training{{training}}.csv",
    log:
        "results/logs/closed_loop/fly_network_{plan}_{training}.log",
    benchmark:
        "results/benchmarks/closed_loop/fly_network_{plan}_{training}.tsv"
    params:
        call=call("ges.study.fly.networks:fly_network"),
        simulator=part("simulator"),
        plan=HOW_FLOWN,
        closed_loop=part("seeds.closed_loop"),
        trained_on=lambda wildcards: wildcards.plan,
        training=lambda wildcards: int(wildcards.training),
    message:
        "fly the network, {wildcards.plan}, seed {wildcards.training}"
    script:
        SCRIPT


rule summarise_networks:
    input:
        networks=expand(
            f"{FLOWN}/networks/{{plan}}_training{{training}}.csv",
            plan=PLANS,
            training=STUDY.models.trainings,
        ),
    output:
        flights=f"{FLOWN}/networks.csv",
        summary=f"{FLOWN}/networks_summary.csv",
    log:
        "results/logs/closed_loop/summarise_networks.log",
    benchmark:
        "results/benchmarks/closed_loop/summarise_networks.tsv"
    params:
        call=call("ges.study.fly.networks:summarise_networks"),
    message:
        "networks of both flight plans in flight"
    script:
        SCRIPT


rule fly_bias:
    input:
        library=PLAIN,
    output:
        flights=f"{FLOWN}/bias.csv",
        summary=f"{FLOWN}/bias_summary.csv",
        tests=f"{FLOWN}/bias_tests.csv",
    log:
        "results/logs/closed_loop/fly_bias.log",
    benchmark:
        "results/benchmarks/closed_loop/fly_bias.tsv"
    params:
        call=call("ges.study.fly.bias:fly_bias"),
        simulator=part("simulator"),
        plan=HOW_FLOWN,
        biases=part("closed_loop.biases"),
        closed_loop=part("seeds.closed_loop"),
    message:
        "fly the oracle under constant biases"
    script:
        SCRIPT


rule table2:
    input:
        comparison=f"{FLOWN}/comparison_summary.csv",
        bias=f"{FLOWN}/bias_summary.csv",
    output:
        table="results/table2.csv",
    log:
        "results/logs/closed_loop/table2.log",
    benchmark:
        "results/benchmarks/closed_loop/table2.tsv"
    params:
        call=call("ges.study.fly.comparison:write_table2"),
    message:
        "Table 2"
    script:
        SCRIPT


rule fly_pulse:
    input:
        library=FLYING,
    output:
        flights=f"{FLOWN}/pulse.csv",
        tests=f"{FLOWN}/pulse_tests.csv",
        trace=f"{FLOWN}/pulse_trace.csv",
        response=f"{FLOWN}/pulse_response.json",
    log:
        "results/logs/closed_loop/fly_pulse.log",
    benchmark:
        "results/benchmarks/closed_loop/fly_pulse.tsv"
    params:
        call=call("ges.study.fly.pulse:fly_pulse"),
        simulator=part("simulator"),
        plan=HOW_FLOWN,
        pulse=part("closed_loop.pulse"),
        closed_loop=part("seeds.closed_loop"),
    message:
        "fly the bias pulse"
    script:
        SCRIPT


rule fly_pulse_map:
    input:
        library=PLAIN,
    output:
        flights=f"{FLOWN}/pulse_map.csv",
        summary=f"{FLOWN}/pulse_map_summary.csv",
        limits=f"{FLOWN}/pulse_map_limits.csv",
    log:
        "results/logs/closed_loop/fly_pulse_map.log",
    benchmark:
        "results/benchmarks/closed_loop/fly_pulse_map.tsv"
    params:
        call=call("ges.study.fly.pulse:fly_pulse_map"),
        simulator=part("simulator"),
        plan=HOW_FLOWN,
        start_s=part("closed_loop.pulse.start_s"),
        pulse_map=part("closed_loop.pulse_map"),
        closed_loop=part("seeds.closed_loop"),
    message:
        "map the pulses that the vehicle recovers from"
    script:
        SCRIPT


rule write_poles:
    input:
        library=PLAIN,
    output:
        poles=f"{FLOWN}/poles.csv",
        summary=f"{FLOWN}/poles_summary.csv",
    log:
        "results/logs/closed_loop/write_poles.log",
    benchmark:
        "results/benchmarks/closed_loop/write_poles.tsv"
    params:
        call=call("ges.study.fly.poles:write_poles"),
        simulator=part("simulator"),
        pole_factors=part("closed_loop.pole_factors"),
    message:
        "poles of the height loop"
    script:
        SCRIPT


rule fly_grid_cell:
    input:
        library=FLYING,
        clamp=CLAMP,
    output:
        flights=f"{FLOWN}/grid/slope{{exponent}}_curvature{{factor}}.csv",
    log:
        "results/logs/closed_loop/fly_grid_slope{exponent}_curvature{factor}.log",
    benchmark:
        "results/benchmarks/closed_loop/fly_grid_slope{exponent}_curvature{factor}.tsv"
    params:
        call=call("ges.study.fly.grid:fly_grid_cell"),
        simulator=part("simulator"),
        plan=HOW_FLOWN,
        modes=part("closed_loop.modes"),
        closed_loop=part("seeds.closed_loop"),
        slope_exponent=lambda wildcards: float(wildcards.exponent),
        curvature_factor=lambda wildcards: float(wildcards.factor),
    message:
        "fly slope exponent {wildcards.exponent}, curvature gain x {wildcards.factor}"
    script:
        SCRIPT


rule summarise_grid:
    input:
        cells=CELLS,
    output:
        flights=f"{FLOWN}/grid.csv",
        summary=f"{FLOWN}/grid_summary.csv",
    log:
        "results/logs/closed_loop/summarise_grid.log",
    benchmark:
        "results/benchmarks/closed_loop/summarise_grid.tsv"
    params:
        call=call("ges.study.fly.grid:summarise_grid"),
    message:
        "the grid of slope exponents and curvature gains"
    script:
        SCRIPT


rule fly_causes:
    input:
        library=PLAIN,
    output:
        flights=f"{FLOWN}/causes.csv",
        summary=f"{FLOWN}/causes_summary.csv",
        tests=f"{FLOWN}/causes_tests.csv",
    log:
        "results/logs/closed_loop/fly_causes.log",
    benchmark:
        "results/benchmarks/closed_loop/fly_causes.tsv"
    params:
        call=call("ges.study.fly.causes:fly_causes"),
        simulator=part("simulator"),
        plan=HOW_FLOWN,
        closed_loop=part("seeds.closed_loop"),
    message:
        "take away what may keep the oracle from winning"
    script:
        SCRIPT


rule fly_worlds:
    input:
        library=FLYING,
        clamp=CLAMP,
        forms="results/real/forms.csv",
    output:
        flights=f"{FLOWN}/worlds.csv",
        summary=f"{FLOWN}/worlds_summary.csv",
        tests=f"{FLOWN}/worlds_bias_tests.csv",
    log:
        "results/logs/closed_loop/fly_worlds.log",
    benchmark:
        "results/benchmarks/closed_loop/fly_worlds.tsv"
    params:
        call=call("ges.study.fly.forms:fly_worlds"),
        simulator=part("simulator"),
        plan=HOW_FLOWN,
        modes=part("closed_loop.modes"),
        biases=part("closed_loop.biases"),
        closed_loop=part("seeds.closed_loop"),
    message:
        "fly other forms of the ground effect, and the historical mapping"
    script:
        SCRIPT


rule choose_gains:
    input:
        library=FLYING,
        clamp=CLAMP,
    output:
        flights=f"{FLOWN}/gains.csv",
        choice=f"{FLOWN}/gains.json",
    log:
        "results/logs/closed_loop/choose_gains.log",
    benchmark:
        "results/benchmarks/closed_loop/choose_gains.tsv"
    params:
        call=call("ges.study.fly.winner:choose_gains"),
        simulator=part("simulator"),
        plan=HOW_FLOWN,
        modes=part("closed_loop.modes"),
        retune=part("closed_loop.retune"),
        validation=part("seeds.validation"),
    message:
        "choose gains for every mode on validation seeds"
    script:
        SCRIPT


rule fly_winner:
    input:
        library=FLYING,
        clamp=CLAMP,
        choice=f"{FLOWN}/gains.json",
    output:
        flights=f"{FLOWN}/winner.csv",
        summary=f"{FLOWN}/winner_summary.csv",
        tests=f"{FLOWN}/winner_tests.csv",
    log:
        "results/logs/closed_loop/fly_winner.log",
    benchmark:
        "results/benchmarks/closed_loop/fly_winner.tsv"
    params:
        call=call("ges.study.fly.winner:fly_winner"),
        simulator=part("simulator"),
        plan=HOW_FLOWN,
        modes=part("closed_loop.modes"),
        closed_loop=part("seeds.closed_loop"),
    message:
        "fly every mode with its own gains"
    script:
        SCRIPT


rule fly_ensemble:
    input:
        library=PLAIN,
        calibration=str(ROOT / "config/calibration.json"),
    output:
        flights=f"{FLOWN}/ensemble.csv",
        summary=f"{FLOWN}/ensemble_summary.csv",
    log:
        "results/logs/closed_loop/fly_ensemble.log",
    benchmark:
        "results/benchmarks/closed_loop/fly_ensemble.tsv"
    params:
        call=call("ges.study.fly.ensemble:fly_ensemble"),
        simulator=part("simulator"),
        plan=HOW_FLOWN,
        pulse=part("closed_loop.pulse"),
        ensemble=part("closed_loop.ensemble"),
        calibration_seeds=part("seeds.calibration"),
    message:
        "fly simulators that fit the published figures as well"
    script:
        SCRIPT


# Ten minutes, and no part of the study: its result stands in config/.
rule fit_profile:
    input:
        library=PLAIN,
        calibration=str(ROOT / "config/calibration.json"),
    output:
        profile="results/gain_profile.json",
    log:
        "results/logs/closed_loop/fit_profile.log",
    params:
        call=call("ges.study.fly.profile:fit_profile"),
        simulator=part("simulator"),
        plan=HOW_FLOWN,
        pulse=part("closed_loop.pulse"),
        profile_gains_m=part("closed_loop.profile_gains_m"),
        calibration_seeds=part("seeds.calibration"),
    message:
        "refit the simulator's free numbers at fixed curvature gains"
    script:
        SCRIPT


rule fly_profile:
    input:
        library=PLAIN,
        calibration=str(ROOT / "config/calibration.json"),
        profile=str(ROOT / "config/gain_profile.json"),
    output:
        misfits=f"{FLOWN}/gain_profile.csv",
    log:
        "results/logs/closed_loop/fly_profile.log",
    benchmark:
        "results/benchmarks/closed_loop/fly_profile.tsv"
    params:
        call=call("ges.study.fly.profile:fly_profile"),
        simulator=part("simulator"),
        plan=HOW_FLOWN,
        pulse=part("closed_loop.pulse"),
        calibration_seeds=part("seeds.calibration"),
    message:
        "fly the simulators of fixed curvature gains"
    script:
        SCRIPT


CLOSED_LOOP = [
    "results/table2.csv",
    *(
        f"{FLOWN}/{name}"
        for name in (
            "restricted_summary.csv",
            "bias_tests.csv",
            "pulse_tests.csv",
            "pulse_map_limits.csv",
            "poles_summary.csv",
            "grid_summary.csv",
            "causes_tests.csv",
            "winner_tests.csv",
            "ensemble_summary.csv",
            "gain_profile.csv",
            "worlds_summary.csv",
            "networks_summary.csv",
        )
    ),
]
