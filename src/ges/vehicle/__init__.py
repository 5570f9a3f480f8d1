"""The vehicle: nominal parameters of a multirotor with their standard deviations and sources.

``file`` is the vehicle file, ``library`` the vehicles that come with the package. ``formats`` reads
and writes those of other simulators, and ``load`` any of these. ``from_log`` makes a vehicle from a
flight log.
"""

from ges.vehicle.file import (
    Estimate,
    Quantity,
    Vehicle,
    parse_vehicle,
    save_vehicle,
    vehicle_content,
)
from ges.vehicle.load import load_vehicle, vehicle_path

__all__ = [
    "Estimate",
    "Quantity",
    "Vehicle",
    "load_vehicle",
    "parse_vehicle",
    "save_vehicle",
    "vehicle_content",
    "vehicle_path",
]
