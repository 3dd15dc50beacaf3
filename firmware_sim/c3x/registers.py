"""Registers (SPRU031 table 13-10) and conditions (table 13-12, page 13-30): their names and codes."""

from typing import Final

REGISTER_NAMES: Final = (
    *(f"R{n}" for n in range(8)),
    *(f"AR{n}" for n in range(8)),
    *("DP", "IR0", "IR1", "BK", "SP", "ST", "IE", "IF", "IOF", "RS", "RE", "RC"),
)
"""The name of each register by its five-bit code; the codes 28 to 31 name nothing."""

AR0: Final = 8
DP: Final = 16

REGISTER_CODES: Final = {name: code for code, name in enumerate(REGISTER_NAMES)}
"""The code of each register by its name in capitals."""

FLOAT_ALIASES: Final = {f"F{n}": n for n in range(8)}
"""Second names of R0 to R7, as compilers write them where they hold floats; a program may use them otherwise."""

_NAMES_OF_CONDITIONS: Final = {
    0: ("U",),
    1: ("LO", "C"),
    2: ("LS",),
    3: ("HI",),
    4: ("HS", "NC"),
    5: ("EQ", "Z"),
    6: ("NE", "NZ"),
    7: ("LT", "N"),
    8: ("LE",),
    9: ("GT", "P"),
    10: ("GE", "NN"),
    12: ("NV",),
    13: ("V",),
    14: ("NUF",),
    15: ("UF",),
    16: ("NLV",),
    17: ("LV",),
    18: ("NLUF",),
    19: ("LUF",),
    20: ("ZUF",),
}

CONDITION_NAMES: Final = {code: names[0] for code, names in _NAMES_OF_CONDITIONS.items()}
"""The name of each condition by its code; 11 and 21 to 31 are reserved."""

CONDITION_CODES: Final = {name: code for code, names in _NAMES_OF_CONDITIONS.items() for name in names}
"""The code of each condition by any of its names, in capitals."""
