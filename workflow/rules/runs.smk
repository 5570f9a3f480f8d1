# The record of the run: where every table and figure comes from, and the manifest, written after everything else.
from ges import runs

RUN_FILES = project(
    "Snakefile",
    "workflow/**/*",
    "src/ges/**/*",
    "sim_c/**/*",
    "paper/**/*",
    "requirements.lock",
)
COMMIT, MODIFIED = runs.commit(ROOT)
CODE = {"commit": COMMIT, "modified": MODIFIED, "sha256": tree_hash(ROOT, RUN_FILES)}
RUN_ID = runs.run_id(STUDY.model_dump(mode="json"), CODE["sha256"])


def makers(files):
    """Name of the rule that makes each file."""
    return {
        str(f): next(r.name for r in workflow.rules if r.is_producer(f)) for f in files
    }
