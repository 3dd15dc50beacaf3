"""Sampled blocks with declared sizes, and the diagram that wires them: what a block-diagram tool does, in a page.

A block declares its discrete states, its inputs and outputs with their sizes, its tunable parameters and its sample
time. Outputs follow from the states and from those inputs that it declares as *direct*; the next states follow from
states and all inputs. A diagram checks each wire when it is drawn and the whole before it runs.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from firmware_sim.plant.source import Floats

Signals = Mapping[str, Floats]


class DiagramError(Exception):
    """A diagram that cannot run: one sentence that says which block or wire, what was expected and what was found."""


@dataclass(frozen=True)
class Port:
    """A named input or output of ``size`` numbers; ``is_direct``: this input acts on the outputs at once."""

    name: str
    size: int
    is_direct: bool = False


class SampledBlock(ABC):
    """One block. Subclasses declare the class attributes and give outputs and next states."""

    states: int = 0
    inputs: tuple[Port, ...] = ()
    outputs: tuple[Port, ...] = ()
    parameters: tuple[str, ...] = ()

    def __init__(self, name: str, sample_time_s: float, values: Sequence[float] = ()) -> None:
        """``values`` of the parameters, in their order. Raises DiagramError for another number of them."""
        if len(values) != len(self.parameters):
            wanted = f"{len(self.parameters)} parameters ({', '.join(self.parameters)})"
            raise DiagramError(f"{name}: expected {wanted}, found {len(values)}")
        self.name, self.sample_time_s = name, sample_time_s
        self.values = np.array(values, dtype=float)

    def initial_state(self) -> Floats:
        """The states at time 0, (states,)."""
        return np.zeros(self.states)

    @abstractmethod
    def output(self, state: Floats, signals: Signals) -> dict[str, Floats]:
        """Each output by its name, from the states and the direct inputs."""

    def update(self, state: Floats, signals: Signals) -> Floats:
        """The states of the next sample, from the states and all inputs."""
        return state

    def port(self, name: str, of_inputs: bool) -> Port:
        """A port by its name. Raises DiagramError."""
        ports, kind = (self.inputs, "input") if of_inputs else (self.outputs, "output")
        for port in ports:
            if port.name == name:
                return port
        known = ", ".join(port.name for port in ports) or "none"
        raise DiagramError(f"{self.name}: expected an {kind} of {known}, found {name!r}")

    def describe(self) -> str:
        """Its sizes in a sentence."""
        ports = [
            f"{kind} of {' and '.join(f'{port.size} ({port.name})' for port in ports)}"
            for kind, ports in (("inputs", self.inputs), ("outputs", self.outputs))
            if ports
        ]
        named = f" ({', '.join(self.parameters)})" if self.parameters else ""
        parts = [f"{self.states} discrete states", *ports, f"{len(self.parameters)} tunable parameters{named}"]
        return f"{self.name}: {', '.join(parts)}, sample time {self.sample_time_s:g} s"


class Diagram:
    """Blocks of one sample time and the wires between them; ``sources`` are outputs that come from outside."""

    def __init__(self, sample_time_s: float, sources: Sequence[Port]) -> None:
        self.sample_time_s = sample_time_s
        self.blocks: dict[str, SampledBlock] = {}
        self._sources = {port.name: port for port in sources}
        # (block, input) -> (block, output); the outside has no name.
        self._wires: dict[tuple[str, str], tuple[str, str]] = {}

    def add(self, block: SampledBlock) -> SampledBlock:
        """Take a block. Raises DiagramError for a name that is taken, and for another sample time."""
        if block.name in self.blocks:
            raise DiagramError(f"{block.name}: expected a name of its own, found a block of this name")
        if block.sample_time_s != self.sample_time_s:
            raise DiagramError(
                f"{block.name}: expected the diagram's sample time of {self.sample_time_s:g} s,"
                f" found {block.sample_time_s:g} s"
            )
        self.blocks[block.name] = block
        return block

    def wire(self, start: str, end: str) -> None:
        """Draw a wire from ``block.output``, or a source, to ``block.input``. Raises DiagramError where that fails."""
        from_block, _, from_port = start.rpartition(".")
        to_block, _, to_port = end.rpartition(".")
        size = self._output(from_block, from_port, start).size
        wanted = self._block(to_block, end).port(to_port, of_inputs=True).size
        if size != wanted:
            raise DiagramError(f"{start} -> {end}: expected {wanted} numbers, found {size}")
        if (to_block, to_port) in self._wires:
            raise DiagramError(f"{start} -> {end}: expected a free input, found one that is wired")
        self._wires[to_block, to_port] = from_block, from_port

    def run(
        self, steps: int, sources: Callable[[int], Signals], seen: Sequence[str], stride: int = 1
    ) -> dict[str, Floats]:
        """Run from the start; ``sources(k)`` are the outside's signals of step k.

        Gives the outputs ``block.output`` in ``seen`` at the end of every ``stride``-th step, (steps // stride, size).
        Raises DiagramError for an input without a wire, and for an algebraic loop.
        """
        order = self._order()
        states = {name: block.initial_state() for name, block in self.blocks.items()}
        histories: dict[str, list[Floats]] = {name: [] for name in seen}
        for step in range(steps):
            outside = sources(step)
            self._update(states, self._outputs(order, states, outside))
            if (step + 1) % stride:
                continue
            # At its end, with the outside as it was in the step.
            after = self._outputs(order, states, outside)
            for name, history in histories.items():
                block, _, port = name.rpartition(".")
                history.append(after[block][port])
        return {name: np.array(history) for name, history in histories.items()}

    def _outputs(
        self, order: Sequence[str], states: Mapping[str, Floats], outside: Signals
    ) -> dict[str, Mapping[str, Floats]]:
        found: dict[str, Mapping[str, Floats]] = {"": outside}
        for name in order:
            block = self.blocks[name]
            direct = {port.name: self._signal(found, name, port.name) for port in block.inputs if port.is_direct}
            found[name] = block.output(states[name], direct)
        return found

    def _update(self, states: dict[str, Floats], outputs: Mapping[str, Mapping[str, Floats]]) -> None:
        for name, block in self.blocks.items():
            if block.states:
                signals = {port.name: self._signal(outputs, name, port.name) for port in block.inputs}
                states[name] = block.update(states[name], signals)

    def _signal(self, outputs: Mapping[str, Mapping[str, Floats]], block: str, port: str) -> Floats:
        start = self._wires[block, port]
        return outputs[start[0]][start[1]]

    def _order(self) -> list[str]:
        """Blocks so that each comes after those whose outputs its own outputs need."""
        for name, block in self.blocks.items():
            for port in block.inputs:
                if (name, port.name) not in self._wires:
                    raise DiagramError(f"{name}.{port.name}: expected a wire, found none")
        needs = {
            name: {self._wires[name, port.name][0] for port in block.inputs if port.is_direct} - {""}
            for name, block in self.blocks.items()
        }
        order: list[str] = []
        while len(order) < len(self.blocks):
            ready = [name for name in self.blocks if name not in order and needs[name] <= set(order)]
            if not ready:
                loop = ", ".join(name for name in self.blocks if name not in order)
                raise DiagramError(f"{loop}: expected a state somewhere between them, found an algebraic loop")
            order += ready
        return order

    def _output(self, block: str, port: str, wire: str) -> Port:
        if block:
            return self._block(block, wire).port(port, of_inputs=False)
        if port not in self._sources:
            raise DiagramError(f"{wire}: expected a source of {', '.join(self._sources)}, found {port!r}")
        return self._sources[port]

    def _block(self, name: str, wire: str) -> SampledBlock:
        if name not in self.blocks:
            raise DiagramError(f"{wire}: expected a block of {', '.join(self.blocks) or 'none yet'}, found {name!r}")
        return self.blocks[name]
