# The simulator, twice: with the network that is committed, and with the one that this study has trained.
SIM_SOURCES = project("sim_c/**/*.[ch]", "sim_c/**/*.def")


rule build_simulator:
    input:
        makefile=project("sim_c/Makefile"),
        sources=SIM_SOURCES,
    output:
        library="build/libges.so",
    log:
        "results/logs/build_simulator.log",
    threads: 2
    params:
        folder=lambda wildcards, input: os.path.dirname(input.makefile[0]),
    shell:
        "compiler=${{CC:-cc}}; command -v ${{compiler%% *}} > {log} || {{ echo 'no C compiler; install gcc or clang, or set CC' | tee {log}; exit 2; }}; "
        "make --no-print-directory -C {params.folder} -j{threads} BUILD=$PWD/build > {log} 2>&1"
