"""The faults of a stage, by the short names in status, logs and documents."""

from enum import StrEnum, unique


@unique
class Fault(StrEnum):
    """A fault of `docs/faults.md`; `control.faults.table` has the reaction to each.

    The index of a fault in this list is its bit in the masks of a record, so the order must stay.
    """

    # Sensor.
    S1 = "S1"
    S2 = "S2"
    S3 = "S3"
    S4 = "S4"
    S5 = "S5"
    S6 = "S6"
    S7 = "S7"
    S8 = "S8"
    S9 = "S9"
    S10 = "S10"
    S11 = "S11"
    S12 = "S12"
    S13 = "S13"
    # Amplifier.
    A1 = "A1"
    A2 = "A2"
    A3 = "A3"
    A4 = "A4"
    A5 = "A5"
    A6 = "A6"
    A7 = "A7"
    A8 = "A8"
    A9 = "A9"
    A10 = "A10"
    A11 = "A11"
    A12 = "A12"
    A13 = "A13"
    # Bus.
    B1 = "B1"
    B2 = "B2"
    B3 = "B3"
    B4 = "B4"
    B5 = "B5"
    B6 = "B6"
    B7 = "B7"
    B8 = "B8"
    B9 = "B9"
    B10 = "B10"
    B11 = "B11"
    B12 = "B12"
    B13 = "B13"
    B14 = "B14"
    B15 = "B15"
    # Loop.
    L1 = "L1"
    L2 = "L2"
    L3 = "L3"
    L4 = "L4"
    L5 = "L5"
    L6 = "L6"
    L7 = "L7"
    L8 = "L8"
    L9 = "L9"
    # Adaptation.
    D1 = "D1"
    D2 = "D2"
    D3 = "D3"
    D4 = "D4"
    D5 = "D5"
    D6 = "D6"
    D7 = "D7"
    D8 = "D8"
    D9 = "D9"
    D10 = "D10"
    # Process.
    P2 = "P2"
    P3 = "P3"
    P4 = "P4"
    P6 = "P6"
    P7 = "P7"
    P11 = "P11"
    P15 = "P15"
    # Emergency stop.
    E1 = "E1"
    # Supervisor.
    H1 = "H1"
    # Of later versions: the bits of those before stay.
    D11 = "D11"
