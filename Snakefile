# The whole study, from configuration to PDF:   snakemake --cores 2 all
# Another configuration over the default one:   snakemake --cores 2 all --configfile config/tiny.yaml
from snakemake.utils import min_version

min_version("9.0")


configfile: f"{workflow.basedir}/config/default.yaml"


include: "workflow/rules/common.smk"
include: "workflow/rules/build.smk"
include: "workflow/rules/data.smk"
include: "workflow/rules/models.smk"
include: "workflow/rules/offline.smk"
include: "workflow/rules/closed_loop.smk"
include: "workflow/rules/proof.smk"
include: "workflow/rules/figures.smk"
include: "workflow/rules/diagnosis.smk"
include: "workflow/rules/runs.smk"
include: "workflow/rules/paper.smk"


rule all:
    default_target: True
    input:
        OFFLINE_TABLES,
        CLOSED_LOOP,
        PROOF,
        WORLDS_SCORES,
        DIAGNOSIS,
        RESULTS,
        MANIFEST,
