"""Structures and unions: names for offsets (SPRU035, .struct, .union and .tag), one inside another."""

from __future__ import annotations

from dataclasses import dataclass, field

from firmware_sim.toolchain.diagnostics import SourceError


@dataclass
class Layout:
    """A structure, or a union: the offsets of its members by name, and its size so far, both in words."""

    name: str = ""
    is_union: bool = False
    members: dict[str, int] = field(default_factory=dict)
    size: int = 0

    def add(self, name: str, size: int, layout: Layout | None = None) -> None:
        """Add a member of ``size`` words; one of another ``layout`` brings the names of its members."""
        at = 0 if self.is_union else self.size
        for inner, offset in (layout.members if layout else {}).items():
            self._add_name(f"{name}.{inner}" if name else inner, at + offset)
        if name:
            self._add_name(name, at)
        self.size = max(self.size, size) if self.is_union else self.size + size

    def _add_name(self, name: str, offset: int) -> None:
        if name in self.members:
            raise SourceError(f"a new name was expected, found {name}, which is already a member", name)
        self.members[name] = offset


class Structures:
    """The structures of a source: finished ones by name, and those that are being read, innermost last."""

    def __init__(self) -> None:
        self.layouts: dict[str, Layout] = {}
        self._open: list[Layout] = []

    def __bool__(self) -> bool:
        """Whether one is being read."""
        return bool(self._open)

    def begin(self, name: str, start: int, *, is_union: bool) -> None:
        """Begin a structure, inside another one if that is open; its first member is at ``start``."""
        self._open.append(Layout(name, is_union, size=start))

    def add(self, name: str, size: int, layout: Layout | None) -> None:
        """Add a member to the innermost one."""
        self._open[-1].add(name, size, layout)

    def end(self, *, is_union: bool) -> dict[str, int]:
        """End the innermost one: names for the source, with their values; those of an inner one go to the outer one."""
        if not self._open or self._open[-1].is_union != is_union:
            opener, closer = (".union", ".endunion") if is_union else (".struct", ".endstruct")
            raise SourceError(f"{opener} was expected before {closer}", closer)
        layout = self._open.pop()
        if self._open:
            self._open[-1].add(layout.name, layout.size, layout)
            return {}
        if not layout.name:
            return layout.members
        self.layouts[layout.name] = layout
        members = {f"{layout.name}.{name}": offset for name, offset in layout.members.items()}
        return {**members, layout.name: layout.size}

    @property
    def size(self) -> int:
        """The size of the innermost one so far, in words."""
        return self._open[-1].size if self._open else 0

    def closer(self) -> str:
        """The directive that ends the innermost one."""
        return ".endunion" if self._open[-1].is_union else ".endstruct"
