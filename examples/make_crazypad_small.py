"""Convert the real flights that the package ships from a copy of CrazyPAD.

    ges recordings fetch crazypad --out recordings
    python examples/make_crazypad_small.py recordings

Of each condition the first flights by number are taken, so that no result chose them. Columns
keep the single precision of the log, the clock its double; nothing is resampled or left out.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from ges.files import replacing
from ges.recordings.published import check, sources
from ges.recordings.readers import Options, open_log
from ges.vehicle.file import save_vehicle
from ges.vehicle.load import load_vehicle

FOLDER = Path(__file__).resolve().parents[1] / "src/ges/recordings/crazypad-small"
SOURCE = "crazypad"
# the set that is shipped: folder of the data set, its airframe and the numbers of the flights
SETS = {
    "healthy_e9": ("normal_flight", "E9", (0, 1, 2, 4)),
    "cut_propeller_3": ("cut_propeller_M3_3mm", "E9", (0, 1)),
    "weight_at_motor_3": ("add_weight_W1_near_M3", "E9", (4, 5)),
    "reference_of_the_pair": ("cut_propellers_M2_0.5mm_M1_0.5mm_reference", "E9", (0, 1)),
    "cut_propellers_1_2": ("cut_propellers_M2_4mm_M1_4mm", "E9", (3, 4)),
    "healthy_e8": ("normal_flight", "E8", (0, 1)),
    "weight_on_string": ("weight_on_string_W3_near_M3", "E8", (0, 1)),
}


def convert(recordings: Path) -> None:
    """Write every set and its vehicle file; each log is checked against its published SHA-256."""
    published = sources()[SOURCE].files
    for name, (folder, airframe, numbers) in SETS.items():
        for number in numbers:
            local = f"{SOURCE}/{folder}/{airframe}_log{number:02d}"
            check((recordings / local).read_bytes(), published[local][1], local)
            frame = open_log(recordings / local, Options()).frame()
            write(FOLDER / name / f"{airframe.lower()}_log{number:02d}.parquet", frame)
        save_vehicle(load_vehicle("crazyflie-2.1"), FOLDER / name / "vehicle.yaml")


def write(path: Path, frame: pd.DataFrame) -> None:
    """Write a flight in a third less room than usual: bytes of a number stand in columns."""
    single = frame.astype({c: "float32" for c in frame.columns if c != "t_s"})
    table = pa.Table.from_pandas(single, preserve_index=False).replace_schema_metadata(None)
    with replacing(path) as new:
        pq.write_table(
            table,
            new,
            compression="zstd",
            compression_level=19,
            use_dictionary=False,
            column_encoding="BYTE_STREAM_SPLIT",
        )


if __name__ == "__main__":
    convert(Path(sys.argv[1]))
