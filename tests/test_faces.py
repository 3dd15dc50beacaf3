"""The names that users import from the package itself."""

import subprocess
import sys

import pytest

import firmware_sim


def test_the_faces_are_there():
    assert firmware_sim.Board.__name__ == "Board"
    image = firmware_sim.assemble("        .text\nstart:  LDI 5,R0\n        BR start\n")
    assert list(image.sections[".text"].words) == [0x08600005, 0x60000000]
    assert firmware_sim.disassemble(0x08600005) == "LDI 5,R0"


def test_an_assembled_program_runs_on_the_bare_processor():
    cpu = firmware_sim.Cpu()
    cpu.load(firmware_sim.assemble("        .text\n        LDI 5,R0\n        ADDI 2,R0\nloop:   BR loop\n"))
    cpu.pc = 0
    cpu.step()
    cpu.step()
    assert cpu.r[0] & 0xFFFFFFFF == 7
    assert cpu.pc == 2


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'Bord'"):
        _ = firmware_sim.Bord


def test_importing_the_package_alone_does_not_import_numba():
    command = "import sys, firmware_sim, firmware_sim.pytest_plugin; print('numba' in sys.modules)"
    found = subprocess.run([sys.executable, "-c", command], capture_output=True, text=True, check=True)
    assert found.stdout == "False\n"
