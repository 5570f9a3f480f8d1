# The record of the run: where every table and figure comes from, and the manifest, written after everything else.
from ges.provenance import runs
from ges.files import sha256

RUN_FILES = project(
    "Snakefile",
    "workflow/**/*",
    "src/ges/**/*",
    "sim_c/**/*",
    "paper/**/*",
    "config/**/*.yaml",
    "requirements.lock",
)
COMMIT, MODIFIED = runs.commit(ROOT)
CODE = {"commit": COMMIT, "modified": MODIFIED, "sha256": tree_hash(ROOT, RUN_FILES)}
RUN_ID = runs.run_id(STUDY.model_dump(mode="json"), CODE["sha256"])


MANIFEST = f"results/runs/{RUN_ID}/manifest.json"


rule write_manifest:
    input:
        made=lambda wildcards: RESULTS,
        numbers="results/numbers.json",
    output:
        manifest=MANIFEST,
    log:
        "results/logs/runs/write_manifest.log",
    params:
        call=call("ges.provenance.runs:write_manifest"),
        study=STUDY.model_dump(mode="json"),
        makers=lambda wildcards, input: makers(input.made),
        read={f.relative_to(ROOT).as_posix(): sha256(f) for f in RUN_FILES},
        code=CODE,
        benchmarks="results/benchmarks",
        logs="results/logs",
    message:
        "record of the run"
    script:
        SCRIPT
