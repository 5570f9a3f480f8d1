# The checked configuration, the project's files, and the sources that a function depends on.
import os
from pathlib import Path

from ges import config as ges_config
from ges.errors import GesError
from ges.sources import sources
from snakemake.exceptions import WorkflowError

try:
    STUDY = ges_config.validate(config)
except GesError as error:
    raise WorkflowError(str(error))

SCRIPT = f"{workflow.basedir}/workflow/scripts/call.py"


def project(*patterns):
    """Files of the project by glob patterns, relative to the folder that the workflow runs in."""
    root = Path(workflow.basedir)
    found = sorted(
        path for pattern in patterns for path in root.glob(pattern) if path.is_file()
    )
    return [os.path.relpath(path) for path in found]


def code(call):
    """Source files that the function ``module:name`` depends on."""
    return [os.path.relpath(path) for path in sources(call.partition(":")[0])]


def part(key):
    """A part of the configuration, by its dotted key, as plain values."""
    value = STUDY.model_dump()
    for name in key.split("."):
        value = value[name]
    return value
