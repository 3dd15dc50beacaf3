"""The printed page of chapter 13 of TI's TMS320C3x User's Guide (SPRU031) on which an instruction's description begins.

The whole chapter was not at hand. Its descriptions are in alphabetical order and take one to four pages, so the pages
that were read fix many of the others. Each table says how far its pages can be trusted.
"""

from typing import Final, NamedTuple


class Pages(NamedTuple):
    """The first and the last page on which a description may begin: the same where it is known."""

    first: int
    last: int


# fmt: off
READ: Final = {
    "ADDI": 57, "AND": 62, "ANDN": 67, "ASH": 71, "ASH3": 73, "ASH3||STI": 76, "B{c}": 79, "B{c}D": 81,
    "CALL{c}": 86, "CMPI3": 93, "DB{c}": 95, "FIX": 99, "FLOAT": 103, "LDE": 112, "LSH": 136, "LSH3": 138,
    "LSH3||STI": 141, "MPYI": 159, "NEGB": 173, "NEGI": 178, "NORM": 182, "NOT": 184, "POP": 194, "PUSH": 196,
    "RND": 202, "ROL": 204, "ROLC": 205, "ROR": 207, "RORC": 208, "SUBB": 223, "SUBC": 226, "SUBI3": 235,
    "SUBRB": 239, "SUBRI": 241, "TRAP{c}": 243, "TSTB": 245, "TSTB3": 247, "XOR": 249,
}
"""The page itself, or the one behind it, was read."""

BRACKETED: Final = {
    "ADDI3": 58, "ADDI3||STI": 60, "AND3": 63, "AND3||STI": 65, "ANDN3": 69, "BR": 83, "BRD": 84, "CALL": 85,
    "CMPF": 88, "DB{c}D": 97, "FIX||STI": 101, "FLOAT||STF": 105, "LDF": 114, "MAXSPEED": 144, "MPYI3": 161,
    "NEGF": 174, "NEGF||STF": 176, "NEGI||STI": 179, "NOP": 181, "NOT||STI": 186, "POPF": 195, "PUSHF": 197,
    "RPTB": 209, "SUBB3": 224, "SUBF": 228, "SUBI3||STI": 237, "SUBRF": 240, "SWI": 242, "XOR3": 250,
}
"""Its neighbours were read and leave one place, if three operands and a parallel pair take two pages each (shifts were
read to take three); no two neighbours that were read contradict that."""

PLACED: Final = {
    "ADDF3": 53, "ADDF3||STF": 55, "CMPF3": 90, "CMPI": 92, "IACK": 107, "LOPOWER": 135, "MPYF": 145, "MPYF3": 147,
    "MPYF3||ADDF3": 149, "MPYF3||STF": 153, "MPYF3||SUBF3": 155, "MPYI3||ADDI3": 163, "MPYI3||STI": 167,
    "MPYI3||SUBI3": 169, "OR": 188, "OR3": 190, "OR3||STI": 192, "RETI{c}": 198, "RETS{c}": 200, "SUBF3": 230,
    "SUBF3||STF": 232, "SUBI": 234, "XOR3||STI": 252,
}
"""The likeliest place in a gap of several: an integer operation takes one page, one of floats two, a multiplication
with an addition four. It may be a page off."""

BETWEEN: Final = {
    **dict.fromkeys(("ABSF", "ABSF||STF", "ABSI", "ABSI||STI", "ADDC", "ADDC3", "ADDF"), Pages(32, 52)),
    **dict.fromkeys(("IDLE", "IDLE2"), Pages(108, 111)),
    **dict.fromkeys(
        ("LDF||LDF", "LDF||STF", "LDFI", "LDF{c}", "LDI", "LDI||LDI", "LDI||STI", "LDII", "LDI{c}", "LDM", "LDP"),
        Pages(115, 134),
    ),
    **dict.fromkeys(("RPTS", "SIGI", "STF", "STF||STF", "STFI", "STI", "STI||STI", "STII"), Pages(210, 222)),
}
"""The first and the last page on which the description may begin: none of these was read, and some take two pages."""
# fmt: on

_UNSURE: Final = 1

PAGES: Final = {
    **{name: Pages(page, page) for name, page in {**READ, **BRACKETED}.items()},
    **{name: Pages(page - _UNSURE, page + _UNSURE) for name, page in PLACED.items()},
    **BETWEEN,
}
