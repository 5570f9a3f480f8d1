# The simulator, with the network that is committed; those with networks of this study are built by models.smk.
SIM_HASH = tree_hash(
    ROOT, project("sim_c/Makefile", "sim_c/**/*.[ch]", "sim_c/**/*.def")
)
CHECK_CC = "compiler=${CC:-cc}; command -v ${compiler%% *} > /dev/null || { echo 'no C compiler; install gcc or clang, or set CC' >&2; exit 2; }"
MAKE_SIM = f"{CHECK_CC}; make --no-print-directory -C {os.path.relpath(ROOT / 'sim_c')}"


rule build_simulator:
    output:
        library="build/libges.so",
    log:
        "results/logs/build/build_simulator.log",
    benchmark:
        "results/benchmarks/build/build_simulator.tsv"
    threads: 2
    params:
        sources=SIM_HASH,
        make=MAKE_SIM,
    message:
        "compile the simulator"
    shell:
        "({params.make} -j{threads} BUILD=$PWD/build) > {log} 2>&1"
