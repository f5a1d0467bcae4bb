"""A figure as one inline SVG element: small, without style attributes, identifiers that do not clash on a page."""

from __future__ import annotations

import io
import re
import xml.etree.ElementTree as ET
from typing import IO, Any

import matplotlib as mpl
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from sysid.plot.style import SETTINGS
from sysid.wording import plain_line

_SVG = "{http://www.w3.org/2000/svg}"
_XLINK_HREF = "{http://www.w3.org/1999/xlink}href"
_FONT = re.compile(r"(?:(?P<style>italic|oblique)\s+)?(?:(?P<weight>bold|\d{3})\s+)?(?P<size>[\d.]+)px\s")
_DECIMALS = re.compile(r"-?\d+\.\d{2,}(?:e-?\d+)?")
_FAMILY = "DejaVu Sans, Verdana, Arial, sans-serif"
_NUMERIC_ATTRIBUTES = ("d", "x", "y", "width", "height", "transform", "points")


def svg_element(figure: Figure, prefix: str, description: str) -> str:
    """The figure as an `<svg>` element for a page; `description` is what a screen reader says instead.

    `prefix` (letters, digits, ``-``) starts every identifier inside.  Style attributes become presentation attributes,
    so that a page may forbid inline styles; coordinates are rounded to 0.01 pt.
    """
    # The figure's text is written as text, so an XML parser of the standard library reads our own output only.
    stream = io.BytesIO()
    _save(figure, stream, {"Date": None, "Creator": None, "Format": None, "Type": None})
    root = ET.fromstring(stream.getvalue())
    for parent in list(root.iter()):
        for child in list(parent):
            # A style sheet inside a figure would apply to the whole page.
            if child.tag == f"{_SVG}style":
                parent.remove(child)
    names = {e.get("id", ""): f"{prefix}-{i}" for i, e in enumerate(e for e in root.iter() if e.get("id"))}
    linked = _linked(root)
    for element in root.iter():
        _simplify(element, names, linked)
    width, height = figure.get_size_inches() * 72.0
    for key in ("width", "height", "version"):
        root.attrib.pop(key, None)
    root.set("viewBox", f"0 0 {width:g} {height:g}")
    root.set("role", "img")
    root.set("aria-label", plain_line(description))
    root.set("class", "figure")
    _collapse(root)
    return ET.tostring(root, encoding="unicode")


def svg_file(figure: Figure) -> str:
    """The figure as the text of an SVG file of its own, the same each time."""
    stream = io.StringIO()
    _save(figure, stream, {"Date": None})
    return stream.getvalue()


def _save(figure: Figure, stream: IO[Any], metadata: dict[str, None]) -> None:
    layout = figure.get_layout_engine()
    with mpl.rc_context(SETTINGS):
        if layout is not None:
            # The axes are placed here as for a vector drawing: for that alone matplotlib would draw all twice.
            dpi, canvas = figure.dpi, figure.canvas
            FigureCanvasSVG(figure)
            layout.execute(figure)
            figure.set_dpi(dpi)
            figure.set_canvas(canvas)
        figure.set_layout_engine(None)
        figure.savefig(stream, format="svg", metadata=metadata)
    figure.set_layout_engine(layout)


def _linked(root: ET.Element) -> set[str]:
    """Identifiers that something inside the drawing refers to."""
    linked = set()
    for element in root.iter():
        for value in element.attrib.values():
            linked.update(re.findall(r"url\(#([^)]+)\)", value))
        if element.get(_XLINK_HREF, "").startswith("#"):
            linked.add(element.attrib[_XLINK_HREF][1:])
    return linked


def _simplify(element: ET.Element, names: dict[str, str], linked: set[str]) -> None:
    element.tag = element.tag.removeprefix(_SVG)
    if element.text is not None and not element.text.strip():
        element.text = None
    element.tail = None
    attributes = element.attrib
    if (identifier := attributes.pop("id", None)) in linked:
        attributes["id"] = names[identifier or ""]
    if (target := attributes.pop(_XLINK_HREF, None)) is not None:
        attributes["href"] = "#" + names[target[1:]] if target.startswith("#") else re.sub(r"\s+", "", target)
    for declaration in attributes.pop("style", "").split(";"):
        key, _, value = declaration.partition(":")
        key, value = key.strip(), value.strip()
        if key == "font":
            _set_font(attributes, value)
        elif key:
            attributes[key] = value
    for key in list(attributes):
        attributes[key] = re.sub(r"url\(#([^)]+)\)", lambda m: f"url(#{names[m[1]]})", attributes[key])
    for key in _NUMERIC_ATTRIBUTES:
        if key in attributes:
            attributes[key] = _DECIMALS.sub(_round, attributes[key])
    if element.tag == "path" and "d" in attributes:
        attributes["d"] = _compact_path(attributes["d"])


def _set_font(attributes: dict[str, str], value: str) -> None:
    match = _FONT.match(value)
    if match is None:
        return
    attributes["font-size"] = match["size"]
    attributes["font-family"] = _FAMILY
    if match["weight"]:
        attributes["font-weight"] = match["weight"]
    if match["style"]:
        attributes["font-style"] = match["style"]


def _round(match: re.Match[str]) -> str:
    text = f"{float(match[0]):.2f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text


def _compact_path(commands: str) -> str:
    # After "M x y" or "L x y" further pairs mean "L", so the letter need not be repeated for every point.
    parts: list[str] = []
    previous = ""
    for letter, numbers in re.findall(r"([A-Za-z])([^A-Za-z]*)", commands):
        text = " ".join(numbers.split())
        parts.append(f" {text}" if letter == "L" and previous in ("M", "L") else letter + text)
        previous = letter
    return "".join(parts)


def _collapse(parent: ET.Element) -> None:
    """Replace groups without attributes by their children."""
    children: list[ET.Element] = []
    for child in list(parent):
        _collapse(child)
        if child.tag == "g" and not child.attrib:
            children += list(child)
        else:
            children.append(child)
    parent[:] = children
