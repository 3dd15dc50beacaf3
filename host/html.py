"""A page of HTML that stands alone: no address in it leads outside. Every text is escaped here and nowhere else."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from html import escape

_STYLE = """
:root { color-scheme: light dark; --ground: #fff; --ink: #1c1f23; --faint: #5b636d; --line: #d5dae0; --tile: #f3f5f7;
  --bad: #b3261e; }
@media screen and (prefers-color-scheme: dark) { :root { --ground: #16191d; --ink: #e4e7ea; --faint: #9aa4af;
  --line: #363c44; --tile: #20252b; --bad: #ff8a80; } }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 1.2rem; max-width: 72rem; background: var(--ground); color: var(--ink);
  font: 1rem/1.5 system-ui, sans-serif; overflow-wrap: anywhere; }
h1 { font-size: 1.6rem; line-height: 1.25; margin: 0 0 .2rem; }
h2 { font-size: 1.2rem; margin: 2.2rem 0 .6rem; border-bottom: 1px solid var(--line); padding-bottom: .2rem; }
p { margin: .3rem 0; }
.faint { color: var(--faint); }
.tiles { display: grid; grid-template-columns: repeat(auto-fill, minmax(9.5rem, 1fr)); gap: .6rem; margin: 1rem 0; }
.tile { background: var(--tile); border-radius: .4rem; padding: .6rem .8rem; }
.tile b { display: block; font-size: 1.25rem; font-variant-numeric: tabular-nums; overflow-wrap: normal; }
.tile span { color: var(--faint); font-size: .85rem; }
.bad b { color: var(--bad); }
.wide { overflow-x: auto; margin: .6rem 0; }
table { border-collapse: collapse; width: max-content; font-size: .9rem; font-variant-numeric: tabular-nums; }
th, td { text-align: left; vertical-align: top; padding: .25rem 1rem .25rem 0; border-bottom: 1px solid var(--line); }
th { color: var(--faint); font-weight: 600; white-space: nowrap; }
td { overflow-wrap: break-word; max-width: 26rem; }
td:first-child { overflow-wrap: normal; white-space: nowrap; }
td.n, th.n { text-align: right; white-space: nowrap; }
figure { margin: 1.2rem 0; }
figure img { display: block; width: 100%; min-width: 40rem; }
figure.square img { width: auto; max-width: min(100%, 40rem); min-width: 32rem; }
summary { cursor: pointer; color: var(--faint); margin: .4rem 0; }
nav a { color: inherit; margin-right: 1rem; }
@media print {
  @page { margin: 14mm; }
  :root { font-size: 12px; }
  body { max-width: none; padding: 0; }
  nav, summary { display: none; }
  figure, tr, .tile { break-inside: avoid; }
  h2 { break-after: avoid; }
  figure img, figure.square img { min-width: 0; max-width: 100%; max-height: 240mm; object-fit: contain; }
  .wide { overflow: visible; }
  table { width: auto; max-width: 100%; }
  td { max-width: none; }
}
"""
# The browser itself refuses whatever would be fetched or run.
_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"


def text(value: object) -> str:
    """A text as the page may hold it, whatever the line made of it."""
    return escape("".join(letter if letter.isprintable() else "\ufffd" for letter in str(value)))


def page(title: str, parts: Iterable[str]) -> str:
    """The whole page; the parts are HTML."""
    body = "\n".join(parts)
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{text(title)}</title>\n<style>{_STYLE}</style></head>\n<body>\n{body}\n</body></html>\n"
    )


def section(name: str, title: str, parts: Sequence[str]) -> str:
    """A titled section that a link `#name` leads to; nothing when it has no parts."""
    return f'<section id="{text(name)}"><h2>{text(title)}</h2>\n' + "\n".join(parts) + "</section>" if parts else ""


def paragraph(value: object, faint: bool = False) -> str:
    return f'<p class="faint">{text(value)}</p>' if faint else f"<p>{text(value)}</p>"


def tile(name: str, value: object, bad: bool = False) -> str:
    """A number with its name; `bad` ones catch the eye."""
    return f'<div class="tile{" bad" if bad else ""}"><b>{text(value)}</b><span>{text(name)}</span></div>'


def table(heads: Sequence[str], rows: Iterable[Sequence[object]], numbers: Iterable[int] = ()) -> str:
    """A table; the columns with these places hold numbers and stand to the right."""
    right = set(numbers)
    kind = [' class="n"' if place in right else "" for place in range(len(heads))]
    head = "".join(f"<th{each}>{text(title)}</th>" for title, each in zip(heads, kind, strict=True))
    body = "".join(
        "<tr>" + "".join(f"<td{each}>{text(cell)}</td>" for cell, each in zip(row, kind, strict=True)) + "</tr>\n"
        for row in rows
    )
    return f'<div class="wide"><table><thead><tr>{head}</tr></thead>\n<tbody>{body}</tbody></table></div>'


def folded(title: str, part: str) -> str:
    """A part of HTML that a click unfolds."""
    return f"<details><summary>{text(title)}</summary>{part}</details>"


def figure(name: str, light_svg: bytes, dark_svg: bytes, square: bool = False) -> str:
    """A picture for a light page (and for paper), and one for a dark page; a square one is less wide."""
    return (
        f'<figure class="wide{" square" if square else ""}"><picture>'
        f'<source media="screen and (prefers-color-scheme: dark)" srcset="{_data_uri(dark_svg)}">'
        f'<img alt="{text(name)}" src="{_data_uri(light_svg)}"></picture></figure>'
    )


def _data_uri(svg: bytes) -> str:
    return "data:image/svg+xml;base64," + base64.b64encode(svg).decode()
