"""A reader of LS-DYNA keyword files of its own: fixed columns as the manual has them, nothing from the writer."""

from __future__ import annotations

from dataclasses import dataclass, field

#: Widths of the fields in a card: eight of ten columns, except points of a curve.
_POINT = (20, 20)


@dataclass
class Deck:
    """What a keyword file defines, by identifier."""

    sections: dict[int, list[list[str]]] = field(default_factory=dict)
    parts: dict[int, tuple[str, int, int]] = field(default_factory=dict)
    materials: dict[int, tuple[str, list[str]]] = field(default_factory=dict)
    curves: dict[int, list[tuple[float, float]]] = field(default_factory=dict)
    curve_heads: dict[int, list[str]] = field(default_factory=dict)
    comments: list[str] = field(default_factory=list)


def _fields(line: str) -> list[str]:
    return [line[i : i + 10].strip() for i in range(0, len(line), 10)]


def read_deck(text: str) -> Deck:
    """Read a keyword file; raises ValueError on lines that LS-DYNA would not take."""
    deck = Deck()
    lines = text.splitlines()
    if lines[0] != "*KEYWORD" or lines[-1] != "*END":
        raise ValueError("*KEYWORD ... *END")
    blocks: list[tuple[str, list[str]]] = []
    for line in lines:
        if len(line) > 80 or not line.isascii():
            raise ValueError(line)
        if line.startswith("$"):
            deck.comments.append(line[1:].strip())
        elif line.startswith("*"):
            blocks.append((line, []))
        else:
            blocks[-1][1].append(line)
    for name, cards in blocks:
        _read_block(deck, name, cards)
    return deck


def _read_block(deck: Deck, name: str, cards: list[str]) -> None:
    if name == "*PART":
        identifier, section, material = (int(f) for f in _fields(cards[1]))
        deck.parts[identifier] = (cards[0], section, material)
    elif name == "*SECTION_DISCRETE":
        deck.sections[int(_fields(cards[0])[0])] = [_fields(c) for c in cards]
    elif name.startswith("*MAT_"):
        (card,) = cards
        identifier, *values = _fields(card)
        deck.materials[int(identifier)] = (name, values)
    elif name == "*DEFINE_CURVE":
        head = _fields(cards[0])
        deck.curve_heads[int(head[0])] = head
        deck.curves[int(head[0])] = [(float(c[: _POINT[0]]), float(c[_POINT[0] : sum(_POINT)])) for c in cards[1:]]
    elif name not in ("*KEYWORD", "*END"):
        raise ValueError(name)
