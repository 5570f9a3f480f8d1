# The checked configuration, the project's files, and the code that a job depends on.
import os
from pathlib import Path

from ges.study import config as ges_config
from ges.errors import GesError
from ges.files import tree_hash
from ges.provenance.sources import sources
from snakemake.exceptions import WorkflowError


# Not needed to run: an image that has all that make asks for, for those who want one (--software-deployment-method).
container: "docker://python:3.11-bookworm"


try:
    STUDY = ges_config.validate(config)
except GesError as error:
    raise WorkflowError(str(error))

ROOT = Path(workflow.basedir)
# Published flights, and sets that others made; what is not there is left out and said.
RECORDINGS = Path(os.environ.get("GES_RECORDINGS", "recordings"))
GIVEN_WORLDS = Path(os.environ.get("GES_WORLDS", "worlds"))
SCRIPT = f"{workflow.basedir}/workflow/scripts/call.py"


def project(*patterns):
    """Files of the project by glob patterns."""
    found = {path for pattern in patterns for path in ROOT.glob(pattern)}
    return sorted(
        path for path in found if path.is_file() and "__pycache__" not in path.parts
    )


def call(function):
    """The function ``module:name`` with a hash of the sources it depends on, so that a change of them runs it again."""
    return f"{function}@{tree_hash(ROOT, sources(function.partition(':')[0]))[:12]}"


def batched(items, size):
    """Items in lists of at most ``size``."""
    return [items[i : i + size] for i in range(0, len(items), size)]


def part(key):
    """A part of the configuration, by its dotted key, as plain values."""
    value = STUDY.model_dump()
    for name in key.split("."):
        value = value[name]
    return value


def closed_loop(name):
    """The input of a figure that shows one summary of the closed loop."""
    return {"summary": f"results/closed_loop/{name}.csv"}


def makers(files):
    """Name of the rule that makes each file."""
    return {
        str(f): next(r.name for r in workflow.rules if r.is_producer(f)) for f in files
    }


def folder_of(wildcards, output):
    """The folder that a rule writes into."""
    return os.path.dirname(output[0])
