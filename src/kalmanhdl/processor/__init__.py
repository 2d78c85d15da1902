"""The programmable matrix processor of bhatia2012: instruction set, assembler, simulator and hardware."""
