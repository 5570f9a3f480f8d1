"""Call the function that a rule names with the rule's files and its own part of the configuration.

Named inputs, outputs and parameters become keyword arguments, converted to what the function's
annotations say. The parameter ``call`` names the function and, behind an @, the state of its
sources; the input ``library`` is the simulator that it flies with. Half of a short job is its start
and end: imports run without the collector of garbage, and at the end the system takes the memory
back as a whole. Processes that a function starts import this file again, and call nothing.
"""

import gc
import importlib
import logging
import os
import sys
import time

import pydantic

from ges.errors import GesError

if __name__ == "__main__":
    gc.disable()
    logging.basicConfig(
        filename=snakemake.log[0],
        filemode="w",
        level=logging.INFO,
        format="%(levelname)s %(message)s",
    )
    logging.captureWarnings(True)
    arguments = {
        k: v
        for named in (snakemake.input, snakemake.output, snakemake.params)
        for k, v in named.items()
    }
    os.environ["OMP_NUM_THREADS"] = "1"  # the same bytes whatever the number of cores
    os.environ["GES_LIBRARY"] = os.path.abspath(arguments.pop("library", "build/libges.so"))
    module, _, name = arguments.pop("call").partition("@")[0].partition(":")
    try:
        function = pydantic.validate_call(getattr(importlib.import_module(module), name))
        logging.info("%.2f s of processor time to start", time.process_time())
        gc.freeze()
        gc.enable()
        function(**arguments)
        logging.info("%.2f s of processor time in all", sum(os.times()[:4]))
    except GesError as error:
        logging.error("%s", error)
        sys.exit(f"{snakemake.rule}: {error}")
    except Exception:
        logging.exception("%s failed", snakemake.rule)
        raise
    logging.shutdown()
    sys.stdout.flush()
    os._exit(0)
