"""What was assembled, beside its source."""

from __future__ import annotations

from firmware_sim.toolchain.assembler import assemble
from firmware_sim.toolchain.listing import listing


def test_a_listing_shows_address_word_cycles_and_source() -> None:
    lines = listing(assemble("start LDI 1,R0\n BNZ start ; back\n* end\n .word 1,2\n")).splitlines()
    assert lines[0].split() == ["address", "word", "cycles", "source"]
    assert lines[1:6] == [
        "000000   08600001 1       start LDI 1,R0",
        "000001   6A06FFFE 4        BNZ start ; back",
        "                          * end",
        "000002   00000001          .word 1,2",
        "000003   00000002",
    ]


def test_a_listing_shows_the_call_of_a_macro_above_what_it_makes() -> None:
    source = "twice .macro n\n LDI n,R0\n ADDI n,R0\n .endm\nback: twice 7 ; here\n BU back\n"
    lines = listing(assemble(source)).splitlines()
    assert lines[1:5] == [
        "                          back: twice 7 ; here",
        "000000   08600007 1        LDI 7,R0",
        "000001   02600007 1        ADDI 7,R0",
        "000002   6A00FFFD 4        BU back",
    ]
