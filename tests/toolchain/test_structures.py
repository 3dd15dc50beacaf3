"""Structures, unions and tags: names for offsets, seen by what they make of operands."""

from __future__ import annotations

import pytest

from firmware_sim.toolchain.assembler import assemble
from firmware_sim.toolchain.diagnostics import AssemblyError

POINT = "point .struct\nx .int\ny .int\nlength .endstruct\n"


def words(source: str, **options: object) -> list[int]:
    return assemble(source, **options).sections[".text"].words  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("source", "values"),
    [
        pytest.param(
            "s .struct\na .int\nb .float 2\nc .ldouble\nn .endstruct\n .word s.b,s.c,n,s\n", [1, 3, 5, 5], id="sizes"
        ),
        pytest.param("s .struct 4\na .int\nb .int\n .endstruct\n .word s.a,s.b\n", [4, 5], id="first offset"),
        pytest.param(" .struct\na .int\nb .int\n .endstruct\n .word a,b\n", [0, 1], id="no name"),
        pytest.param("s .struct\na .string\nb .string 3\nn .endstruct\n .word s.b,n\n", [1, 4], id="strings"),
        pytest.param("u .union\na .int\nb .float 3\nn .endunion\n .word u.a,u.b,n\n", [0, 0, 3], id="union"),
        pytest.param(
            POINT + "line .struct\nid .int\nfrom .tag point\nto .tag point,2\nlast .int\n .endstruct\n"
            " .word line.from.y,line.to,line.to.x,line.last,line\n",
            [2, 3, 3, 7, 8],
            id="tags inside",
        ),
        pytest.param(
            "s .struct\na .int\nin .struct\nx .int\ny .int\nlen .endstruct\nb .int\n .endstruct\n"
            " .word s.in.y,s.b,s,len\n",
            [2, 3, 4, 2],
            id="structure in a structure",
        ),
        pytest.param(
            "s .struct\na .int\n .union\ni .int\nf .float 2\n .endunion\nb .int\n .endstruct\n .word s.i,s.f,s.b\n",
            [1, 1, 3],
            id="union without a name in a structure",
        ),
    ],
)
def test_names_of_offsets(source: str, values: list[int]) -> None:
    assert words(source) == values


def test_a_tag_outside_names_addresses() -> None:
    source = POINT + "here .tag point\n .bss here,length\n LDI @here.y,R0\n ADDI @here.x,R0\n"
    assert words(source, addresses={".bss": 0x80_9800}) == [0x0820_9801, 0x0220_9800]


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("s .struct\na .int\na .int\n", "3:1: a new name was expected, found a, which is already a member"),
        ("s .struct\na .int\n .endunion\n", "3:2: .union was expected before .endunion"),
        ("u .union\na .int", "2:1: .endunion was expected, found the end of the source"),
        ("v .tag nothing\n", "1:8: a name and a structure were expected around .tag, found nothing"),
        ("s .struct\n .tag\n", "2:2: the name of a structure was expected after .tag"),
    ],
)
def test_errors(source: str, message: str) -> None:
    with pytest.raises(AssemblyError) as caught:
        assemble(source)
    assert message in str(caught.value)
