"""The vehicle file: numbers of a multirotor with the doubt in each."""

from ges.vehicle.file import (
    Estimate,
    Quantity,
    Vehicle,
    load_vehicle,
    parse_vehicle,
    save_vehicle,
    vehicle_content,
)

__all__ = [
    "Estimate",
    "Quantity",
    "Vehicle",
    "load_vehicle",
    "parse_vehicle",
    "save_vehicle",
    "vehicle_content",
]
