# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # A notebook: what does this simulator lack?
#
# Four flights of a 1.2 kg quadrotor come with the package (200 kB). They are simulated, by us:
# ground effect and rotor drag were at work, and the vehicle was 3 % heavier than its file says.
# The simulator that we hold against them knows of none of it. Every cell below was run when this
# page was built.

# %%
import logging
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd

import ges
from ges.recordings.published import fetch
from ges.recordings.recording import load_set

logging.getLogger("matplotlib").setLevel(logging.ERROR)
folder = Path(tempfile.mkdtemp())
files = list(fetch("example", folder, None))
flights = load_set(folder / "example")
{flight.name: f"{flight.frame['t_s'].iloc[-1]:.0f} s" for flight in flights.flights}

# %% [markdown]
# ## The vehicle, and how well it is known
#
# Every number has a prior sd. A number that is wrong within it is calibrated; beyond it, it is
# a finding.

# %%
print((folder / "example" / "vehicle.yaml").read_text())

# %% [markdown]
# ## Diagnose
#
# One flight takes no part, chosen by a rule that does not look at it.

# %%
found = ges.diagnose(flights)
print(found.sentence)

# %%
content = found.content()
pd.DataFrame(
    [
        {"name": f["name"], "probability": f["probability"], "parameter": name}
        | {"value": p["value"], "from": p["ci95"][0], "to": p["ci95"][1], "unit": p["unit"]}
        for f in content["findings"]
        for name, p in f["parameters"].items()
    ]
)

# %% [markdown]
# Rotor drag was 6e-5 kg, and the interval holds it.
#
# ## What it is worth
#
# Errors on the flight that took no part: as given, recalibrated within the prior sds, and with the
# findings.

# %%
pd.DataFrame(content["fit"]["channels"]).T[["before", "recalibrated", "after"]]

# %% [markdown]
# Recorded and simulated, on that flight:

# %%
figure, axes = plt.subplots(figsize=(9, 3))
found.plot.over_time("force_y_N", ax=axes)

# %% [markdown]
# `found.plot` has every picture of the page, and `found.save(folder)` writes the page and all files
# of `ges diagnose`. How far to trust it: [results](../results/). What each block of the page
# means: [reading the page](../reading-the-page/).
