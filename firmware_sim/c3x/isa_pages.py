"""The printed page of chapter 13 of TI's TMS320C3x User's Guide (SPRU031) on which an instruction is described.

The descriptions are in alphabetical order, so the pages given bracket the others, which were not at hand.
"""

from typing import Final

PAGES: Final = {
    "ASH": 71,
    "ASH3": 73,
    "CMPI3": 93,
    "DB{c}": 95,
    "DB{c}D": 97,
    "FIX": 99,
    "LSH": 136,
    "LSH3": 138,
    "LSH3||STI": 141,
    "NORM": 182,
    "RND": 202,
    "ROL": 204,
    "SUBB": 223,
    "SUBC": 226,
}
