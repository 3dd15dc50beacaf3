"""Assembler, disassembler and COFF object files of the TMS320C3x: source text to image, image to file and back."""
